"""modelDescription.xml of a block (FMI 2.0.4, section 2.2)."""

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from .block import Block, Layout
from .errors import BuildError
from .recipe import Producer
from .units import QUANTITIES, SiUnit, parse_unit
from .variables import (
    Access,
    Derivative,
    DiscreteState,
    Input,
    Output,
    Parameter,
    ScalarVariable,
    State,
    Variable,
)

if TYPE_CHECKING:
    from .symbolic import SymbolicBlock

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
    `clock` is the interval of a periodic input clock in s.
    """

    derivatives: bool = False
    model_exchange: bool = False
    source_files: tuple[str, ...] = ()
    clock: float | None = None


def offers_model_exchange(block: Block) -> bool:
    """Return whether a block works without communication steps: it has more than sampled states."""
    layout = block.layout()
    return block.has_model_exchange and (bool(layout.states) or not layout.discrete_states)


def describe_model(model: str, description: str, producer: Producer, guid: str, fmi: int = 2) -> Element:
    """Return the root element, without content."""
    token = {2: "guid", 3: "instantiationToken"}[fmi]
    texts = {"version": producer.version, "license": producer.license}
    return Element(
        "fmiModelDescription",
        {},
        fmiVersion=f"{fmi}.0",
        modelName=model,
        **{token: guid},
        description=description,
        **{attribute: text for attribute, text in texts.items() if text is not None},
        generationTool=producer.tool,
        generationDateAndTime=BUILD_TIME,
        variableNamingConvention="structured",
    )


def model_description(
    block: Block, symbolic: "SymbolicBlock", producer: Producer, guid: str, offers: FmuFeatures
) -> bytes:
    """Return the model description as UTF-8 XML."""
    layout = block.layout()
    all_scalars = (*layout.scalars, *(layout.derivatives if offers.derivatives else ()))
    # hidden parameters keep value references: the C code finds variables by their position
    visible = {r: s for r, s in enumerate(all_scalars) if s.access is not Access.HIDDEN}
    scalars = tuple(visible.values())
    name = type(block).__name__
    root = describe_model(name, (block.__doc__ or name).strip().splitlines()[0], producer, guid)
    if offers.model_exchange:
        # `where` in equations switches without an event
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
    add_units(root, scalars)
    add_types(root, scalars)
    add_log_categories(root)
    add_default_experiment(root, block)
    variables = SubElement(root, "ModelVariables")
    states = layout.references(layout.states)
    positions = {reference: str(k) for k, reference in enumerate(visible, 1)}
    for reference, scalar in visible.items():
        element = _add_variable(variables, reference, scalar)
        if reference >= len(layout.scalars):
            element.set("derivative", positions[states[reference - len(layout.scalars)]])
    dependencies = find_structure(block, symbolic, offers.derivatives)
    structure = SubElement(root, "ModelStructure")
    _add_unknowns(structure, "Outputs", dependencies.outputs, positions)
    _add_unknowns(structure, "Derivatives", dependencies.derivatives, positions)
    _add_unknowns(structure, "InitialUnknowns", dependencies.initial, positions)
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


def add_log_categories(root: Element, fmi: int = 2) -> None:
    """Add the categories of messages."""
    categories = SubElement(root, "LogCategories")
    for category, description in LOG_CATEGORIES.items():
        text = description.replace("fmi2", f"fmi{fmi}")
        SubElement(categories, "Category", name=category, description=text)


def add_default_experiment(root: Element, block: Block) -> None:
    """Add the block's default experiment."""
    experiment = block.default_experiment
    SubElement(
        root,
        "DefaultExperiment",
        startTime="0",
        stopTime=repr(experiment.stop_time),
        tolerance=repr(experiment.tolerance),
        stepSize=repr(experiment.step_size),
    )


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
        # strong coupling needs fewer sweeps with them
        element.set("providesDirectionalDerivative", "true")
    if offers.source_files:
        files = SubElement(element, "SourceFiles")
        for file in offers.source_files:
            SubElement(files, "File", name=file)


def add_units(root: Element, scalars: Sequence[ScalarVariable]) -> None:
    """Add the units of these variables, with their display units."""
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


def add_types(root: Element, scalars: Sequence[ScalarVariable], fmi: int = 2) -> None:
    """Add one type per quantity, with its unit and display unit, and one per enumeration."""
    units = QUANTITIES.keys() & {s.variable.unit for s in scalars}
    enumerations = {s.variable.enumeration for s in scalars} - {None}
    if not units and not enumerations:
        return
    definitions = SubElement(root, "TypeDefinitions")
    # sorted: sets of texts have another order in each process, and the bytes must not change
    for unit in sorted(units, key=lambda u: QUANTITIES[u].name):
        quantity = QUANTITIES[unit]
        real = _add_type(definitions, "Real", quantity.name, fmi)
        real.set("quantity", quantity.name)
        real.set("unit", unit)
        if quantity.display_unit is not None:
            real.set("displayUnit", quantity.display_unit)
    for enumeration in sorted((c for c in enumerations if c), key=lambda c: c.__name__):
        items = _add_type(definitions, "Enumeration", enumeration.__name__, fmi)
        for member in enumeration:
            SubElement(items, "Item", name=member.name.lower(), value=str(member.value))


def _add_type(definitions: Element, fmi_type: str, name: str, fmi: int) -> Element:
    """Add a type and return the element with its attributes: in FMI 2.0 one inside of the other."""
    if fmi == 3:
        return SubElement(definitions, f"{FMI3_TYPES[fmi_type]}Type", name=name)
    return SubElement(SubElement(definitions, "SimpleType", name=name), fmi_type)


FMI3_TYPES = {"Real": "Float64", "Integer": "Int32", "Boolean": "Boolean", "Enumeration": "Enumeration"}
"""Types of FMI 3.0 by those of FMI 2.0."""


def _get_interface(scalar: ScalarVariable) -> tuple[str, str, str | None]:
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
    element = SubElement(variables, "ScalarVariable", variable_attributes(reference, scalar.name, scalar))
    kind = SubElement(element, scalar.variable.fmi_type)
    set_type_attributes(kind, scalar.variable)
    if element.get("initial") != "calculated":
        kind.set("start", format_number(scalar.variable.fmi_type, scalar.start))
    return kind


def variable_attributes(reference: int, name: str, scalar: ScalarVariable) -> dict[str, str]:
    """Return the attributes of a variable that do not depend on its type."""
    causality, variability, initial = _get_interface(scalar)
    attributes = {"name": name, "valueReference": str(reference)}
    if scalar.variable.description:
        attributes["description"] = scalar.variable.description
    attributes |= {"causality": causality, "variability": variability}
    if initial is not None:
        attributes["initial"] = initial
    return attributes


def set_type_attributes(kind: Element, variable: Variable) -> None:
    """Set unit, range and the like of a variable."""
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
            kind.set(attribute, format_number(variable.fmi_type, value))
    if variable.is_difference:
        kind.set("relativeQuantity", "true")
    if variable.nominal is not None:
        kind.set("nominal", format_number("Real", variable.nominal))


def format_number(fmi_type: str, value: float) -> str:
    """Return a value as the text of a type of FMI 2.0."""
    if fmi_type == "Real":
        return repr(float(value))
    if fmi_type == "Boolean":
        return "true" if value else "false"
    return str(int(value))


@dataclass(frozen=True)
class Structure:
    """Unknowns with the knowns that they depend on, as value references of scalar variables."""

    outputs: Mapping[int, set[int]]
    derivatives: Mapping[int, set[int]]
    initial: Mapping[int, set[int]]


def find_structure(
    block: Block, symbolic: "SymbolicBlock", has_derivatives: bool, time: int | None = None
) -> Structure:
    """Return the dependencies of outputs, derivatives and initial unknowns.

    Nothing depends on a parameter that is fixed or hidden: it is a constant.

    In an FMU without derivatives the states are not knowns: its outputs depend on inputs only. FMI 2.0 FMUs
    have no variable for the time, so that dependencies cannot name it.

    Args:
        block: A block.
        symbolic: Its equations.
        has_derivatives: Whether the FMU has derivatives.
        time: Value reference of the time; None without a variable for it.
    """
    from .symbolic import find_dependencies  # needs CasADi; tables are described without

    layout = block.layout()
    dependencies = find_dependencies(block, symbolic, time)
    states = layout.references(layout.states)
    knowns = {*layout.references(layout.inputs), *(states if has_derivatives else ()), time}
    outputs = [r for r, s in enumerate(layout.scalars) if isinstance(s.variable, (State, Output))]
    derivatives = [r for r in dependencies if r >= len(layout.scalars)] if has_derivatives else []
    from_parameters = [r for r in states if layout.scalars[r].variable.start_parameter is not None]
    initial: dict[int, set[int | None]] = {r: {layout.start_reference(r)} for r in from_parameters}
    for r in (*layout.references(layout.outputs), *derivatives):
        initial[r] = {_find_start_reference(layout, d, time) for d in dependencies[r]}
    settable = {*(r for r, s in enumerate(layout.scalars) if s.access is Access.SETTABLE), time}
    return Structure(
        {r: _select_knowns(knowns, dependencies.get(r, [r])) for r in outputs},
        {r: _select_knowns(knowns, dependencies.get(r, [r])) for r in derivatives},
        {r: _select_knowns(settable, references) for r, references in initial.items()},
    )


def _select_knowns(knowns: Collection[int | None], references: Iterable[int | None]) -> set[int]:
    """Return the value references in `references` that are knowns."""
    return {r for r in references if r is not None and r in knowns}


def _find_start_reference(layout: Layout, reference: int, time: int | None) -> int | None:
    """Return the value reference of what a variable starts from; None if that is a time without variable."""
    if reference == time:
        return time
    start = layout.start_reference(reference)
    return time if layout.scalars[start].variable.has_computed_start else start


def _add_unknowns(
    structure: Element, kind: str, unknowns: Mapping[int, Iterable[int]], positions: Mapping[int, str]
) -> None:
    """Add unknowns with their dependencies, as positions in ModelVariables."""
    if unknowns:
        element = SubElement(structure, kind)
        for reference, knowns in sorted(unknowns.items()):
            dependencies = " ".join(positions[d] for d in sorted(knowns))
            SubElement(element, "Unknown", index=positions[reference], dependencies=dependencies)
