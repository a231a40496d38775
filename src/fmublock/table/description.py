"""modelDescription.xml of a table FMU."""

import re
from xml.etree.ElementTree import Element, SubElement

from ..description import FMI3_TYPES, add_log_categories, add_unit, describe_model, format_xml
from ..recipe import Producer
from .content import SPANS, TableContent, span_name

_STRUCTURED = re.compile(r"[A-Za-z_]\w*(\[\d+(,\d+)*\])?(\.[A-Za-z_]\w*(\[\d+(,\d+)*\])?)*", re.ASCII)
"""Names without derivatives and quotes that are structured."""

_CAPABILITIES_2 = {
    "needsExecutionTool": "false",
    "canHandleVariableCommunicationStepSize": "true",
    "canGetAndSetFMUstate": "true",
    "canSerializeFMUstate": "true",
    "canNotUseMemoryManagementFunctions": "true",
    "providesDirectionalDerivative": "true",
    "maxOutputDerivativeOrder": "1",
}
_CAPABILITIES_3 = {
    "canGetAndSetFMUState": "true",
    "canSerializeFMUState": "true",
    "maxOutputDerivativeOrder": "1",
    "canHandleVariableCommunicationStepSize": "true",
}

_SPAN_TEXTS = {
    "begin": "In the last step, the begin of the line",
    "end": "In the last step, the end of the line",
    "mean": "The mean over the last step",
}


def table_description(table: TableContent, model: str, main: str, producer: Producer, guid: str) -> bytes:
    """Return the model description as UTF-8 XML; `main` is the C file to compile."""
    root = describe_model(table.name, "Data over time as outputs", producer, guid, table.fmi)
    if not all(_STRUCTURED.fullmatch(output.name) for output in table.outputs):
        root.set("variableNamingConvention", "flat")  # the header of a column can be any text
    if table.fmi == 3:
        SubElement(root, "CoSimulation", {"modelIdentifier": model, **_CAPABILITIES_3})
    else:
        simulation = SubElement(root, "CoSimulation", {"modelIdentifier": model, **_CAPABILITIES_2})
        SubElement(SubElement(simulation, "SourceFiles"), "File", name=main)
    _add_units(root, table)
    types = _add_types(root, table)
    add_log_categories(root, table.fmi)
    first, last = float(table.times[0]), float(table.times[-1])
    step = (last - first) / (len(table.times) - 1)
    SubElement(root, "DefaultExperiment", startTime=repr(first), stopTime=repr(last), stepSize=repr(step))
    variables = SubElement(root, "ModelVariables")
    for reference, output in enumerate(
        table.outputs, 1
    ):  # 0 is the time of the last point, hidden in FMI 2.0
        is_held = table.columns[output.column].interpolation == "held"
        attributes = {"name": output.name, "valueReference": str(reference)}
        attributes |= {"description": output.description} if output.description else {}
        attributes |= {"causality": "output", "variability": "discrete" if is_held else "continuous"}
        attributes["initial"] = "calculated"
        if table.fmi == 3:
            element = SubElement(variables, FMI3_TYPES[output.type], attributes)
        else:
            element = SubElement(SubElement(variables, "ScalarVariable", attributes), output.type)
        if output.unit is not None:
            element.set("unit", output.unit.name)
        if output.type == "Enumeration":
            element.set("declaredType", types[tuple(output.items.items())])
    if table.has_spans:
        _add_spans(variables, table)
    structure = SubElement(root, "ModelStructure")
    if table.fmi == 3:
        _add_time(variables, {output.name for output in table.outputs})
        for kind in ("Output", "InitialUnknown"):
            for position in range(1, len(table.outputs) + 1):
                SubElement(structure, kind, valueReference=str(position), dependencies="")
        return format_xml(root)
    for kind in ("Outputs", "InitialUnknowns"):
        element = SubElement(structure, kind)
        for position in range(1, len(table.outputs) + 1):
            SubElement(element, "Unknown", index=str(position), dependencies="")
    return format_xml(root)


def _add_time(variables: Element, names: set[str]) -> None:
    """Add the time, which FMI 3.0 requires: named "time", or with underscores if an output has this name."""
    name = "time"
    while name in names:
        name += "_"
    SubElement(
        variables,
        "Float64",
        name=name,
        valueReference="0",
        causality="independent",
        variability="continuous",
        description="Time",
    )


def _add_spans(variables: Element, table: TableContent) -> None:
    """Add the local variables that say what the outputs did in the last step."""
    count = len(table.outputs)
    for number, span in enumerate(SPANS, 1):
        for i, output in enumerate(table.outputs, 1):
            name, reference = span_name(output.name, span), str(number * count + i)
            variable = SubElement(variables, "ScalarVariable", name=name, valueReference=reference)
            variable.set("description", f"{_SPAN_TEXTS[span]} of {output.name}")
            variable.set("causality", "local")
            variable.set("initial", "calculated")
            element = SubElement(variable, "Real")
            if output.unit is not None:
                element.set("unit", output.unit.name)


def _add_units(root: Element, table: TableContent) -> None:
    units = {o.unit.name: o.unit for o in table.outputs if o.unit is not None}
    if units:
        definitions = SubElement(root, "UnitDefinitions")
        for name in sorted(units):
            add_unit(definitions, units[name])


def _add_types(root: Element, table: TableContent) -> dict[tuple[tuple[int, str], ...], str]:
    """Add the enumerations of the outputs. Return their names by their items."""
    enumerations = dict.fromkeys(tuple(o.items.items()) for o in table.outputs if o.type == "Enumeration")
    if not enumerations:
        return {}
    definitions, names = SubElement(root, "TypeDefinitions"), {}
    for number, items in enumerate(enumerations, 1):
        names[items] = f"Enumeration{number}"
        kind = SubElement(SubElement(definitions, "SimpleType", name=names[items]), "Enumeration")
        for value, name in items:
            SubElement(kind, "Item", name=name, value=str(value))
    return names
