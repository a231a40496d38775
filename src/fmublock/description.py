"""modelDescription.xml of a block (FMI 2.0.4, section 2.2)."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from .block import Block
from .errors import BuildError
from .recipe import Producer
from .symbolic import SymbolicBlock, find_dependencies
from .units import QUANTITIES, SiUnit, parse_unit
from .variables import Access, Derivative, DiscreteState, Input, Output, Parameter, ScalarVariable, State

BUILD_TIME = "1980-01-01T00:00:00Z"
"""Fixed, because an FMU's bytes depend on its content alone; also the time of its zip entries."""

_NOT_IN_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")

LOG_CATEGORIES = {
    "logEvents": "What the instance does: initialized, terminated",
    "logStatusWarning": "Messages with status fmi2Warning",
    "logStatusDiscard": "Messages with status fmi2Discard",
    "logStatusError": "Messages with status fmi2Error",
    "logStatusFatal": "Messages with status fmi2Fatal",
    "logAll": "All messages",
}

_DERIVATIVE_CAPABILITIES = {"canInterpolateInputs": "true", "maxOutputDerivativeOrder": "1"}


@dataclass(frozen=True)
class FmuFeatures:
    """What an FMU offers beyond plain co-simulation.

    `derivatives` means directional derivatives, those of inputs and outputs, and the states'
    derivatives as variables. `source_files` are the files in sources/ that a C compiler needs.
    """

    derivatives: bool = False
    model_exchange: bool = False
    source_files: tuple[str, ...] = ()


def offers_model_exchange(block: Block) -> bool:
    """Return whether a block works without communication steps: it has more than sampled states."""
    layout = block.layout()
    return bool(layout.states) or not layout.discrete_states


def describe_model(model: str, description: str, producer: Producer, guid: str) -> Element:
    """Return the root element, without content."""
    texts = {"version": producer.version, "license": producer.license}
    return Element(
        "fmiModelDescription",
        {},
        fmiVersion="2.0",
        modelName=model,
        guid=guid,
        description=description,
        **{attribute: text for attribute, text in texts.items() if text is not None},
        generationTool=producer.tool,
        generationDateAndTime=BUILD_TIME,
        variableNamingConvention="structured",
    )


def model_description(
    block: Block, symbolic: SymbolicBlock, producer: Producer, guid: str, offers: FmuFeatures
) -> bytes:
    """Return the model description as UTF-8 XML."""
    layout = block.layout()
    every = (*layout.scalars, *(layout.derivatives if offers.derivatives else ()))
    shown = {r: s for r, s in enumerate(every) if s.access is not Access.HIDDEN}
    scalars = tuple(shown.values())
    name = type(block).__name__
    root = describe_model(name, (block.__doc__ or name).strip().splitlines()[0], producer, guid)
    if offers.model_exchange:
        root.set("numberOfEventIndicators", "0")
        _add_interface(root, "ModelExchange", name, offers, completedIntegratorStepNotNeeded="true")
    _add_interface(
        root,
        "CoSimulation",
        name,
        offers,
        canHandleVariableCommunicationStepSize="true",
        **(_DERIVATIVE_CAPABILITIES if offers.derivatives else {}),
    )
    _add_units(root, scalars)
    _add_types(root, scalars)
    add_log_categories(root)
    experiment = block.default_experiment
    SubElement(
        root,
        "DefaultExperiment",
        startTime="0",
        stopTime=repr(experiment.stop_time),
        tolerance=repr(experiment.tolerance),
        stepSize=repr(experiment.step_size),
    )
    variables = SubElement(root, "ModelVariables")
    states = layout.references(layout.states)
    positions = {reference: str(k) for k, reference in enumerate(shown, 1)}
    for reference, scalar in shown.items():
        element = _add_variable(variables, reference, scalar)
        if reference >= len(layout.scalars):
            element.set("derivative", positions[states[reference - len(layout.scalars)]])
    _add_structure(root, block, symbolic, offers, positions)
    return format_xml(root)


def format_xml(root: Element) -> bytes:
    """Return an indented document as UTF-8.

    Raises:
        BuildError: A text has a character that XML cannot hold.
    """
    for element in root.iter():
        for name, text in element.items():
            if _NOT_IN_XML.search(text):
                raise BuildError(f"the {name} {text!r} has a character that XML cannot hold.")
    indent(root)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root, encoding="utf-8") + b"\n"


def add_log_categories(root: Element) -> None:
    """Add the categories of messages."""
    categories = SubElement(root, "LogCategories")
    for category, description in LOG_CATEGORIES.items():
        SubElement(categories, "Category", name=category, description=description)


def add_unit(definitions: Element, unit: SiUnit) -> Element:
    """Add a unit and return its element; without exponents it has a name only."""
    element = SubElement(definitions, "Unit", name=unit.name)
    if unit.exponents is None:
        return element
    base = {name: str(exponent) for name, exponent in unit.powers.items()}
    if unit.factor != 1.0:
        base["factor"] = repr(unit.factor)
    if unit.offset != 0.0:
        base["offset"] = repr(unit.offset)
    SubElement(element, "BaseUnit", base)
    return element


def _add_interface(root: Element, kind: str, name: str, offers: FmuFeatures, **capabilities: str) -> None:
    element = SubElement(
        root,
        kind,
        capabilities,
        modelIdentifier=name,
        needsExecutionTool="false",
        canGetAndSetFMUstate="true",
        canSerializeFMUstate="true",
        canNotUseMemoryManagementFunctions="true",
    )
    if offers.derivatives:
        element.set("providesDirectionalDerivative", "true")
    if offers.source_files:
        files = SubElement(element, "SourceFiles")
        for file in offers.source_files:
            SubElement(files, "File", name=file)


def _add_units(root: Element, scalars: Sequence[ScalarVariable]) -> None:
    names = sorted({s.variable.unit for s in scalars if s.variable.unit is not None})
    if names:
        definitions = SubElement(root, "UnitDefinitions")
        for name in names:
            exponents = {base: str(e) for base, e in parse_unit(name).powers.items()}
            unit = SubElement(definitions, "Unit", name=name)
            SubElement(unit, "BaseUnit", exponents)
            quantity = QUANTITIES.get(name)
            if quantity is not None and quantity.display_unit is not None:
                SubElement(unit, "DisplayUnit", name=quantity.display_unit, factor=repr(quantity.factor))


def _add_types(root: Element, scalars: Sequence[ScalarVariable]) -> None:
    """Add one type per quantity, with its unit and display unit, and one per enumeration."""
    units = QUANTITIES.keys() & {s.variable.unit for s in scalars}
    enumerations = {s.variable.enumeration for s in scalars} - {None}
    if not units and not enumerations:
        return
    definitions = SubElement(root, "TypeDefinitions")
    for unit in sorted(units, key=lambda u: QUANTITIES[u].name):
        quantity = QUANTITIES[unit]
        simple_type = SubElement(definitions, "SimpleType", name=quantity.name)
        real = SubElement(simple_type, "Real", quantity=quantity.name, unit=unit)
        if quantity.display_unit is not None:
            real.set("displayUnit", quantity.display_unit)
    for enumeration in sorted((c for c in enumerations if c), key=lambda c: c.__name__):
        simple_type = SubElement(definitions, "SimpleType", name=enumeration.__name__)
        items = SubElement(simple_type, "Enumeration")
        for member in enumeration:
            SubElement(items, "Item", name=member.name.lower(), value=str(member.value))


def _interface(scalar: ScalarVariable) -> tuple[str, str, str | None]:
    """Return causality, variability and initial of a scalar variable."""
    variable = scalar.variable
    real = variable.fmi_type == "Real"
    calculated = variable.has_computed_start
    match variable:
        case Input():
            return "input", "continuous" if real else "discrete", None
        case Parameter() if scalar.access is Access.FIXED:
            return "local", "constant", "exact"
        case Parameter():
            return "parameter", "fixed", "exact"
        case State():
            return "output", "continuous", "calculated" if calculated else "exact"
        case DiscreteState():
            return "local", "discrete", "calculated" if calculated else "exact"
        case Derivative():
            return "local", "continuous", "calculated"
        case _:
            return "output", "continuous" if real else "discrete", "calculated"


def _add_variable(variables: Element, reference: int, scalar: ScalarVariable) -> Element:
    """Add a ScalarVariable; returns the element of its type, which carries the values."""
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
    quantity = QUANTITIES.get(variable.unit or "")
    if quantity is not None:
        # unit and display unit are repeated, because some tools do not look at the declared type
        kind.set("declaredType", quantity.name)
        if quantity.display_unit is not None:
            kind.set("displayUnit", quantity.display_unit)
    for attribute, value in (("min", variable.minimum), ("max", variable.maximum)):
        if value is not None:
            kind.set(attribute, _number(variable.fmi_type, value))
    if variable.is_difference:
        kind.set("relativeQuantity", "true")
    if variable.nominal is not None:
        kind.set("nominal", _number("Real", variable.nominal))
    if initial != "calculated":
        kind.set("start", _number(variable.fmi_type, scalar.start))
    return kind


def _number(fmi_type: str, value: float) -> str:
    if fmi_type == "Real":
        return repr(float(value))
    if fmi_type == "Boolean":
        return "true" if value else "false"
    return str(int(value))


def _add_structure(
    root: Element,
    block: Block,
    symbolic: SymbolicBlock,
    offers: FmuFeatures,
    positions: Mapping[int, str],
) -> None:
    """Add the dependencies of outputs, derivatives and initial unknowns.

    Nothing depends on a parameter that is fixed or hidden: it is a constant.

    In an FMU without derivatives the states are not knowns: its outputs depend on inputs only.
    """
    layout = block.layout()
    dependencies = find_dependencies(block, symbolic)
    states = layout.references(layout.states)
    knowns = {*layout.references(layout.inputs), *(states if offers.derivatives else ())}
    structure = SubElement(root, "ModelStructure")
    outputs = [r for r, s in enumerate(layout.scalars) if isinstance(s.variable, (State, Output))]
    derivatives = [r for r in dependencies if r >= len(layout.scalars)] if offers.derivatives else []
    for kind, unknowns in (("Outputs", outputs), ("Derivatives", derivatives)):
        found = {r: knowns & set(dependencies.get(r, [r])) for r in unknowns}
        _add_unknowns(structure, kind, found, positions)
    from_parameters = [r for r in states if layout.scalars[r].variable.start_parameter is not None]
    initial = {r: {layout.start_reference(r)} for r in from_parameters}
    for r in (*layout.references(layout.outputs), *derivatives):
        initial[r] = {layout.start_reference(d) for d in dependencies[r]}
    settable = {r for r, s in enumerate(layout.scalars) if s.access is Access.SETTABLE}
    known = {r: settable & found for r, found in initial.items()}
    _add_unknowns(structure, "InitialUnknowns", known, positions)


def _add_unknowns(
    structure: Element, kind: str, unknowns: Mapping[int, Iterable[int]], positions: Mapping[int, str]
) -> None:
    """Add unknowns with their dependencies, as positions in ModelVariables."""
    if unknowns:
        element = SubElement(structure, kind)
        for reference, known in sorted(unknowns.items()):
            dependencies = " ".join(positions[d] for d in sorted(known))
            SubElement(element, "Unknown", index=positions[reference], dependencies=dependencies)
