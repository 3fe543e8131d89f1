"""CDFX: ASAM's calibration data format 2.0, an XML whose schema fixes the order of all elements."""

import pathlib
import xml.etree.ElementTree as ET
from collections.abc import Iterator

import numpy as np

from vgtjax import InputError

from .base import TOOL, Characteristic, DataSet, Found, identifier, number

HEAD = (
    '<?xml version="1.0" encoding="UTF-8"?>\n'
    '<!DOCTYPE MSRSW PUBLIC "-//ASAM//DTD CALIBRATION DATA FORMAT:V2.0.0:LAI:IAI:XML:CDF200.XSD//EN" '
    '"cdf_v2.0.0.sl.dtd">\n'
)


def to_cdfx(data: DataSet) -> bytes:
    """A data set as the text of a CDFX file."""
    root = ET.Element("MSRSW", {"CREATOR": TOOL, "CREATOR-VERSION": data.version})
    _add(root, "SHORT-NAME", "calibration")
    _add(root, "CATEGORY", "CDF20")
    system = _add(_add(root, "SW-SYSTEMS"), "SW-SYSTEM")
    _add(system, "SHORT-NAME", "actuator")
    tree = _add(_add(system, "SW-INSTANCE-SPEC"), "SW-INSTANCE-TREE")
    _add(tree, "SHORT-NAME", "parameters")
    _add(tree, "LONG-NAME", data.model_text)
    _add(tree, "CATEGORY", "NO_VCD")  # no variants of a value
    for each in data.characteristics:
        _add_instance(tree, each, data)
    ET.indent(root)
    return HEAD.encode() + ET.tostring(root, encoding="utf-8") + b"\n"


def _add(parent: ET.Element, tag: str, text: str | None = None, **attributes: str) -> ET.Element:
    element = ET.SubElement(parent, tag, attributes)
    element.text = text
    return element


def _add_instance(tree: ET.Element, each: Characteristic, data: DataSet) -> None:
    instance = _add(tree, "SW-INSTANCE")
    _add(instance, "SHORT-NAME", identifier(each.name))
    _add(instance, "LONG-NAME", each.long_name)
    _add(instance, "CATEGORY", each.category)
    _add_values(_add(instance, "SW-VALUE-CONT"), each)
    if each.axes:
        axes = _add(instance, "SW-AXIS-CONTS")
        for axis_name in reversed(each.axes):  # columns are the first axis of a file, x
            axis = _add(axes, "SW-AXIS-CONT")
            _add(axis, "CATEGORY", "COM_AXIS")
            _add(axis, "SW-INSTANCE-REF", identifier(axis_name))
    _add_history(instance, each, data)


def _add_values(container: ET.Element, each: Characteristic) -> None:
    _add(container, "UNIT-DISPLAY-NAME", each.unit, **{"xml:space": "preserve"})
    if each.category == "VAL_BLK":
        _add(_add(container, "SW-ARRAYSIZE"), "V", str(each.values.size))
    values = _add(container, "SW-VALUES-PHYS")
    for row in each.values if each.category == "MAP" else [each.values]:
        group = _add(values, "VG") if each.category == "MAP" else values
        for value in np.ravel(row):
            _add(group, "V", number(value))


def _add_history(instance: ET.Element, each: Characteristic, data: DataSet) -> None:
    entry = _add(_add(instance, "SW-CS-HISTORY"), "CS-ENTRY")
    _add(entry, "STATE", each.state)
    _add(entry, "DATE", f"{data.date}T00:00:00")
    _add(entry, "CSTO", TOOL)
    _add(entry, "CSTV", data.version)
    remark = _add(entry, "REMARK")
    for text in each.remarks:
        _add(remark, "P", text)
    for trace, digest in data.hashes.items():
        _add(entry, "SD", digest, GID=f"SHA-256 of {trace}")


def read_cdfx(path: pathlib.Path) -> tuple[str, list[Found]]:
    """The line of a CDFX file that names the model, and what it holds."""
    try:
        root = ET.parse(path).getroot()
    except (ET.ParseError, ValueError, LookupError) as error:  # the latter two of an encoding that is not known
        raise InputError(f"{path.name}: this is not valid XML ({error}); write it again") from error
    if root.tag != "MSRSW":
        raise InputError(f"{path.name}: a CDFX file begins with MSRSW, but this has {root.tag}; give a CDFX file")
    return root.findtext(".//SW-INSTANCE-TREE/LONG-NAME") or "", list(_instances(path, root))


def _instances(path: pathlib.Path, root: ET.Element) -> Iterator[Found]:
    for instance in root.iter("SW-INSTANCE"):
        name, category = instance.findtext("SHORT-NAME") or "", instance.findtext("CATEGORY")
        container = instance.find("SW-VALUE-CONT")
        found = None if container is None else container.find("SW-VALUES-PHYS")
        if container is None or found is None:
            raise InputError(f"{path.name}: '{name}' has no SW-VALUES-PHYS; write physical values")
        values = [value.text or "" for value in found.iter() if value.tag in ("V", "VT", "VF", "VH")]
        unit = container.findtext("UNIT-DISPLAY-NAME")
        yield Found(name, values, category == "VALUE", None if unit is None else unit.strip())
