"""`modelDescription.xml` of an FMU."""

import xml.etree.ElementTree as ET
from collections.abc import Sequence

from .variables import Variable

IDENTIFIER = "vgtjax_actuator"
SOURCE = f"{IDENTIFIER}.c"
COST = (
    "In model exchange the importer's solver must stop at every jump of the duty, and its steps must resolve the "
    "relaxation rates of plunger and friction (thousands a second); co-simulation has the integrator of vgtjax, which "
    "stays stable without."
)


def describe(variables: Sequence[Variable], name: str, guid: str, version: str, date: str) -> bytes:
    """The text of the file, in the order that the schema of FMI 2.0 demands."""
    root = ET.Element(
        "fmiModelDescription",
        {
            "fmiVersion": "2.0",
            "modelName": name,
            "guid": guid,
            "description": f"Electro-pneumatic actuator of a turbocharger's vanes. {COST}",
            "generationTool": f"vgtjax {version}",
            "generationDateAndTime": f"{date}T00:00:00Z",
            "variableNamingConvention": "structured",
            "numberOfEventIndicators": "0",
        },
    )
    both = {"modelIdentifier": IDENTIFIER, "canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true"}
    exchange = {"completedIntegratorStepNotNeeded": "true"}
    steps = {"canHandleVariableCommunicationStepSize": "true", "canInterpolateInputs": "true"}
    for tag, own in (("ModelExchange", exchange), ("CoSimulation", steps)):
        ET.SubElement(ET.SubElement(ET.SubElement(root, tag, both | own), "SourceFiles"), "File", {"name": SOURCE})
    units = ET.SubElement(root, "UnitDefinitions")
    for unit in dict.fromkeys(each.unit for each in variables if each.unit is not None):
        ET.SubElement(units, "Unit", {"name": unit})
    categories = ET.SubElement(root, "LogCategories")
    ET.SubElement(categories, "Category", {"name": "logStatusError"})
    ET.SubElement(root, "DefaultExperiment", {"startTime": "0", "stopTime": "10", "stepSize": "0.001"})
    listed = ET.SubElement(root, "ModelVariables")
    for reference, variable in enumerate(variables):
        _add_variable(listed, reference, variable)
    _add_structure(root, variables)
    ET.indent(root)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, encoding="utf-8") + b"\n"


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
    ET.SubElement(element, "Real", {key: str(value) for key, value in fields.items() if value is not None})


def _add_structure(root: ET.Element, variables: Sequence[Variable]) -> None:
    """What depends on what; places count from one here."""
    outputs = [i for i, each in enumerate(variables, 1) if each.causality == "output"]
    rates = [i for i, each in enumerate(variables, 1) if each.derivative_of is not None]
    states = [each.derivative_of + 1 for each in variables if each.derivative_of is not None]
    structure = ET.SubElement(root, "ModelStructure")
    for tag, places in (("Outputs", outputs), ("Derivatives", rates), ("InitialUnknowns", [*outputs, *states, *rates])):
        unknowns = ET.SubElement(structure, tag)
        for place in places:
            ET.SubElement(unknowns, "Unknown", {"index": str(place)})
