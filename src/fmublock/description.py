"""modelDescription.xml of a block (FMI 2.0.4, section 2.2)."""

from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from .block import Block, Layout
from .symbolic import SymbolicBlock, output_dependencies
from .units import parse_unit
from .variables import DiscreteState, Input, Output, Parameter, ScalarVariable, State

BUILD_TIME = "1980-01-01T00:00:00Z"
"""Fixed, because an FMU's bytes depend on its content alone; also the time of its zip entries."""

LOG_CATEGORIES = {
    "logStatusWarning": "Messages with status fmi2Warning",
    "logStatusDiscard": "Messages with status fmi2Discard",
    "logStatusError": "Messages with status fmi2Error",
    "logStatusFatal": "Messages with status fmi2Fatal",
    "logAll": "All messages",
}


@dataclass(frozen=True)
class Producer:
    """Who made an FMU: the tool and version it names, and the licence of its content."""

    tool: str
    version: str
    license: str


def model_description(
    block: Block, symbolic: SymbolicBlock, producer: Producer, guid: str, source_files: list[str]
) -> bytes:
    """The model description as UTF-8 XML.

    `source_files` are the C files under sources/ that a C compiler needs; none for an FMU that
    is not C.
    """
    layout = block.layout()
    name = type(block).__name__
    root = Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=name,
        guid=guid,
        description=(block.__doc__ or name).strip().splitlines()[0],
        version=producer.version,
        license=producer.license,
        generationTool=producer.tool,
        generationDateAndTime=BUILD_TIME,
        variableNamingConvention="structured",
    )
    co_simulation = SubElement(
        root,
        "CoSimulation",
        modelIdentifier=name,
        needsExecutionTool="false",
        canHandleVariableCommunicationStepSize="true",
        canGetAndSetFMUstate="true",
        canSerializeFMUstate="true",
        canNotUseMemoryManagementFunctions="true",
    )
    if source_files:
        files = SubElement(co_simulation, "SourceFiles")
        for file in source_files:
            SubElement(files, "File", name=file)
    _add_units(root, layout)
    _add_enumerations(root, layout)
    categories = SubElement(root, "LogCategories")
    for category, description in LOG_CATEGORIES.items():
        SubElement(categories, "Category", name=category, description=description)
    experiment = block.default_experiment
    SubElement(
        root,
        "DefaultExperiment",
        startTime="0",
        stopTime=repr(experiment.stop_time),
        stepSize=repr(experiment.step_size),
    )
    variables = SubElement(root, "ModelVariables")
    for reference, scalar in enumerate(layout.scalars):
        _add_variable(variables, reference, scalar)
    _add_structure(root, block, symbolic)
    indent(root)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="utf-8") + b"\n"


def _add_units(root: Element, layout: Layout) -> None:
    names = sorted({s.variable.unit for s in layout.scalars if s.variable.unit is not None})
    if names:
        definitions = SubElement(root, "UnitDefinitions")
        for name in names:
            exponents = {base: str(e) for base, e in parse_unit(name).exponents.items()}
            SubElement(SubElement(definitions, "Unit", name=name), "BaseUnit", exponents)


def _add_enumerations(root: Element, layout: Layout) -> None:
    classes = {s.variable.enumeration for s in layout.scalars} - {None}
    if classes:
        definitions = SubElement(root, "TypeDefinitions")
        for enumeration in sorted((c for c in classes if c), key=lambda c: c.__name__):
            simple_type = SubElement(definitions, "SimpleType", name=enumeration.__name__)
            items = SubElement(simple_type, "Enumeration")
            for member in enumeration:
                SubElement(items, "Item", name=member.name.lower(), value=str(member.value))


def _interface(scalar: ScalarVariable) -> tuple[str, str, str | None]:
    """Causality, variability and initial of a scalar variable."""
    variable = scalar.variable
    real = variable.fmi_type == "Real"
    calculated = variable.start_parameter is not None
    match variable:
        case Input():
            return "input", "continuous" if real else "discrete", None
        case Parameter():
            return "parameter", "fixed", "exact"
        case State():
            return "output", "continuous", "calculated" if calculated else "exact"
        case DiscreteState():
            return "local", "discrete", "calculated" if calculated else "exact"
        case _:
            return "output", "continuous" if real else "discrete", "calculated"


def _add_variable(variables: Element, reference: int, scalar: ScalarVariable) -> None:
    causality, variability, initial = _interface(scalar)
    variable = scalar.variable
    attributes = {"name": scalar.name, "valueReference": str(reference)}
    if variable.description:
        attributes["description"] = variable.description
    attributes |= {"causality": causality, "variability": variability}
    if initial is not None:
        attributes["initial"] = initial
    element = SubElement(variables, "ScalarVariable", attributes)
    kind = SubElement(element, variable.fmi_type)
    if variable.enumeration is not None:
        kind.set("declaredType", variable.enumeration.__name__)
    if variable.unit is not None:
        kind.set("unit", variable.unit)
    for attribute, value in (("min", variable.minimum), ("max", variable.maximum)):
        if value is not None:
            kind.set(attribute, _number(variable.fmi_type, value))
    if variable.nominal is not None:
        kind.set("nominal", _number("Real", variable.nominal))
    if initial != "calculated":
        kind.set("start", _number(variable.fmi_type, scalar.start))


def _number(fmi_type: str, value: float) -> str:
    if fmi_type == "Real":
        return repr(float(value))
    if fmi_type == "Boolean":
        return "true" if value else "false"
    return str(int(value))


def _add_structure(root: Element, block: Block, symbolic: SymbolicBlock) -> None:
    """Outputs with their direct dependencies on inputs, and what initialization computes from what.

    Dependencies are 1-based positions in ModelVariables, which are the value references plus one.
    """
    layout = block.layout()
    dependencies = output_dependencies(block, symbolic)
    inputs = layout.references(layout.inputs)
    structure = SubElement(root, "ModelStructure")
    outputs = SubElement(structure, "Outputs")
    initial = SubElement(structure, "InitialUnknowns")
    for reference, scalar in enumerate(layout.scalars):
        known = dependencies.get(reference, [])
        if isinstance(scalar.variable, (State, Output)):
            _add_unknown(outputs, reference, [d for d in known if d in inputs])
        if isinstance(scalar.variable, Output):
            _add_unknown(initial, reference, sorted({layout.start_reference(d) for d in known}))
        elif isinstance(scalar.variable, State) and scalar.variable.start_parameter is not None:
            _add_unknown(initial, reference, [layout.start_reference(reference)])
    if len(outputs) == 0:
        structure.remove(outputs)
    if len(initial) == 0:
        structure.remove(initial)


def _add_unknown(parent: Element, reference: int, dependencies: list[int]) -> None:
    SubElement(
        parent, "Unknown", index=str(reference + 1), dependencies=" ".join(str(d + 1) for d in dependencies)
    )
