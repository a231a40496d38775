"""modelDescription.xml and sources/buildDescription.xml of a block for FMI 3.0.

An array of a block is one variable, whose value reference is that of its first element.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import accumulate
from typing import TYPE_CHECKING
from xml.etree.ElementTree import Element, SubElement

from .block import Block
from .description import (
    FMI3_TYPES,
    FmuFeatures,
    add_default_experiment,
    add_log_categories,
    add_types,
    add_units,
    describe_model,
    find_structure,
    format_number,
    format_xml,
    set_type_attributes,
    variable_attributes,
)
from .recipe import Producer
from .variables import Access, ScalarVariable, Variable

if TYPE_CHECKING:
    from .symbolic import SymbolicBlock


def fmi3_model_description(
    block: Block, symbolic: "SymbolicBlock", producer: Producer, token: str, offers: FmuFeatures
) -> bytes:
    """Return the model description as UTF-8 XML."""
    layout = block.layout()
    all_scalars = (*layout.scalars, *(layout.derivatives if offers.clock is None else ()))
    visible = {r: s for r, s in enumerate(all_scalars) if s.access is not Access.HIDDEN}
    name = type(block).__name__
    root = describe_model(name, (block.__doc__ or name).strip().splitlines()[0], producer, token, fmi=3)
    capabilities = {"modelIdentifier": name, "canGetAndSetFMUState": "true", "canSerializeFMUState": "true"}
    # a clock ticks in event mode; steps between its ticks compute nothing that could be shown
    special = {"hasEventMode": "true"}
    if offers.clock is None:
        capabilities |= {
            "providesDirectionalDerivatives": "true",
            "providesAdjointDerivatives": "true",
            "providesPerElementDependencies": "true",
        }
        special = {
            "providesIntermediateUpdate": "true",
            "canReturnEarlyAfterIntermediateUpdate": "true",
            "maxOutputDerivativeOrder": "1",
        }
    if offers.model_exchange:
        SubElement(root, "ModelExchange", capabilities)
    SubElement(root, "CoSimulation", capabilities | special, canHandleVariableCommunicationStepSize="true")
    described = (*visible.values(), time_variable(block))
    add_units(root, described)
    add_types(root, described, fmi=3)
    add_log_categories(root, fmi=3)
    add_default_experiment(root, block)
    lengths = element_counts(block)
    variables = SubElement(root, "ModelVariables")
    _add_variables(variables, block, visible, lengths)
    structure = SubElement(root, "ModelStructure")
    _add_structure(structure, block, symbolic, lengths)
    if offers.clock is not None:
        _add_clock(variables, structure, offers.clock)
    return format_xml(root)


def build_description(model: str, mains: Iterable[str]) -> bytes:
    """Return the file that says how to compile the sources, as UTF-8 XML."""
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = SubElement(root, "BuildConfiguration", modelIdentifier=model)
    files = SubElement(configuration, "SourceFileSet", language="C99")
    for main in mains:
        SubElement(files, "SourceFile", name=main)
    return format_xml(root)


def element_counts(block: Block) -> list[int]:
    """Return how many values the variable at each value reference has.

    It is 1 for a scalar, and for an array the number of its elements at the first of them, and 0 at the
    others. The derivatives follow, and the time.
    """
    layout = block.layout()
    counts = [0 if any(s.index) else math.prod(s.variable.shape) for s in layout.scalars]
    return [*counts, *(counts[r] for r in layout.references(layout.states)), 1]


def time_variable(block: Block) -> ScalarVariable:
    """Return the time: named "time", or with underscores if the block has such a variable."""
    names = {str(s.variable.name) for s in block.layout().scalars}
    name = "time"
    while name in names:
        name += "_"
    # FMI 3.0 requires a variable for the time, and leaves its name free
    return ScalarVariable(Variable(name=name, unit="s", description="Time"), (), name, 0.0)


def time_reference(block: Block) -> int:
    """Return the value reference of the time: that after the derivatives."""
    layout = block.layout()
    return len(layout.scalars) + len(layout.derivatives)


def _add_variables(
    variables: Element, block: Block, visible: Mapping[int, ScalarVariable], lengths: Sequence[int]
) -> None:
    """Add all variables; the time is the last one."""
    layout = block.layout()
    states = layout.references(layout.states)
    for reference, scalar in visible.items():
        # an element inside of an array belongs to the variable of the first one
        if not lengths[reference]:
            continue
        fmi_type, of_state = scalar.variable.fmi_type, scalar
        attributes = variable_attributes(reference, str(scalar.variable.name), scalar)
        if reference >= len(layout.scalars):
            state = states[reference - len(layout.scalars)]
            of_state = layout.scalars[state]
            name = str(of_state.variable.name)
            attributes |= {"name": f"der({name})", "derivative": str(state)}
            attributes["description"] = f"Time derivative of {name}"
        # others do not change within a step
        if (attributes["causality"], attributes["variability"]) == ("output", "continuous"):
            attributes["intermediateUpdate"] = "true"
        element = SubElement(variables, FMI3_TYPES[fmi_type], attributes)
        set_type_attributes(element, scalar.variable)
        for length in of_state.variable.shape:
            SubElement(element, "Dimension", start=str(length))
        if attributes.get("initial") != "calculated":
            starts = (visible[r].start for r in range(reference, reference + lengths[reference]))
            element.set("start", " ".join(format_number(fmi_type, x) for x in starts))
    time = time_variable(block)
    attributes = {"name": time.name, "valueReference": str(len(lengths) - 1), "description": "Time"}
    element = SubElement(variables, "Float64", attributes, causality="independent", variability="continuous")
    set_type_attributes(element, time.variable)


def _add_structure(
    structure: Element, block: Block, symbolic: "SymbolicBlock", lengths: Sequence[int]
) -> None:
    """Add the dependencies of outputs, derivatives and initial unknowns, each of whole variables."""
    # the description has dependencies of variables; hosts ask for those of elements at run time
    first = list(accumulate(range(len(lengths)), lambda before, r: r if lengths[r] else before))
    model_structure = find_structure(block, symbolic, True, time_reference(block))
    for kind, unknowns in (
        ("Output", model_structure.outputs),
        ("ContinuousStateDerivative", model_structure.derivatives),
        ("InitialUnknown", model_structure.initial),
    ):
        by_variable = dict[int, set[int]]()
        for reference, knowns in sorted(unknowns.items()):
            by_variable.setdefault(first[reference], set()).update(
                first[reference_of_known] for reference_of_known in knowns
            )
        for reference, knowns in by_variable.items():
            dependencies = " ".join(map(str, sorted(knowns)))
            SubElement(structure, kind, valueReference=str(reference), dependencies=dependencies)


_UNCLOCKED = ("parameter", "independent")


def _add_clock(variables: Element, structure: Element, interval: float) -> None:
    """Add a clock: all variables but parameters, constants and the time belong to it.

    Its value reference follows that of the time, the last variable. The first tick is one interval after the
    start. Each output can depend on all inputs, because a tick is a whole step.

    Args:
        variables: The element ModelVariables, without derivatives.
        structure: The element ModelStructure.
        interval: The interval in s.
    """
    reference = str(int(variables[-1].get("valueReference", "")) + 1)
    names, name = {v.get("name") for v in variables}, "clock"
    while name in names:
        name += "_"
    for variable in variables:
        if variable.get("causality") in _UNCLOCKED or variable.get("variability") == "constant":
            continue
        variable.set("variability", "discrete")
        variable.set("clocks", reference)
        variable.attrib.pop("intermediateUpdate", None)
    attributes = {
        "name": name,
        "valueReference": reference,
        "description": "Ticks of the block",
        "causality": "input",
        "intervalVariability": "constant",
        "intervalDecimal": repr(float(interval)),
        "shiftDecimal": repr(float(interval)),
    }
    variables.append(Element("Clock", attributes))
    for unknown in list(structure):
        if unknown.tag != "Output":
            structure.remove(unknown)
        # without this attribute, an unknown depends on all knowns
        unknown.attrib.pop("dependencies", None)
