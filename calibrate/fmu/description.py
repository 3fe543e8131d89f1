"""`modelDescription.xml` of an FMU."""

import math
import xml.etree.ElementTree as ET

from .unit import Unit
from .variables import Variable


def describe(unit: Unit, name: str, guid: str, version: str, date: str) -> bytes:
    """The text of the file, in the order that the schema of FMI 2.0 demands."""
    root = ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": "2.0",
            "modelName": name,
            "guid": guid,
            "description": unit.says,
            "generationTool": f"vgtjax {version}",
            "generationDateAndTime": f"{date}T00:00:00Z",
            "variableNamingConvention": "structured",
            "numberOfEventIndicators": "0",
        },
    )
    _add_kinds(root, unit)
    units = ET.SubElement(root, "UnitDefinitions")
    for each in dict.fromkeys(variable.unit for variable in unit.variables if variable.unit is not None):
        ET.SubElement(units, "Unit", {"name": each})
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", {"name": "logStatusError"})
    ET.SubElement(root, "DefaultExperiment", {"startTime": "0", "stopTime": "10", "stepSize": str(unit.step)})
    listed = ET.SubElement(root, "ModelVariables")
    for reference, variable in enumerate(unit.variables):
        _add_variable(listed, reference, variable)
    _add_structure(root, unit)
    ET.indent(root)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="utf-8") + b"\n"


def _add_kinds(root: ET.Element, unit: Unit) -> None:
    both = {"modelIdentifier": unit.identifier, "canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true"}
    kinds = {
        "ModelExchange": {"completedIntegratorStepNotNeeded": "true"},
        "CoSimulation": {"canHandleVariableCommunicationStepSize": "true", "canInterpolateInputs": "true"},
    }
    for tag in ["CoSimulation"] if unit.is_sampled else kinds:
        files = ET.SubElement(ET.SubElement(root, tag, both | kinds[tag]), "SourceFiles")
        ET.SubElement(files, "File", {"name": unit.source})


def _add_variable(parent: ET.Element, reference: int, variable: Variable) -> None:
    attributes = {
        "name": variable.name,
        "valueReference": str(reference),
        "description": variable.description,
        "causality": variable.causality,
        "variability": variable.variability,
    }
    element = ET.SubElement(parent, "ScalarVariable", attributes)
    if variable.is_boolean:
        ET.SubElement(element, "Boolean", {"start": str(bool(variable.start)).lower()})
        return
    derivative = None if variable.derivative_of is None else variable.derivative_of + 1
    fields = {"unit": variable.unit, "nominal": variable.nominal, "start": variable.start, "derivative": derivative}
    ET.SubElement(element, "Real", {key: _text(value) for key, value in fields.items() if value is not None})


def _text(value: str | float) -> str:
    """As XML has it, where the number without end is `INF`."""
    return "INF" if value == math.inf else str(value)


def _add_structure(root: ET.Element, unit: Unit) -> None:
    """What depends on what; places count from one here."""
    variables = unit.variables
    outputs = [i for i, each in enumerate(variables, 1) if each.causality == "output"]
    rates = [i for i, each in enumerate(variables, 1) if each.derivative_of is not None]
    states = [each.derivative_of + 1 for each in variables if each.derivative_of is not None]
    structure = ET.SubElement(root, "ModelStructure")
    for tag, places in (("Outputs", outputs), ("Derivatives", rates), ("InitialUnknowns", [*outputs, *states, *rates])):
        if not places:
            continue
        unknowns = ET.SubElement(structure, tag)
        for place in places:
            ET.SubElement(unknowns, "Unknown", {"index": str(place)})
