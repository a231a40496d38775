"""FMI 3.0 variables in the terms of FMI 2.0: a variable for each element of an array; Clocks."""

import itertools
import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import attrs
import numpy as np
from fmpy.model_description import ModelDescription, ModelVariable, Unknown

from ..base.errors import CommandError
from ..base.untrusted_xml import parse_xml
from .fmi_3_calls import INTEGERS

WIDE = ("UInt32", "Int64", "UInt64")
"""Types with values that a 32-bit integer cannot have."""

_GENERAL = {
    "Float64": "Real",
    "Float32": "Real",
    **dict.fromkeys(INTEGERS, "Integer"),
    "Boolean": "Boolean",
    "String": "String",
    "Enumeration": "Enumeration",
}
"""The types that are supported, each with its type in FMI 2.0."""

BINARY = "Binary"
"""The type of values that a run passes on unchanged, and does not record."""

_DTYPES: dict[str, type[Any]] = {
    "Real": np.float64,
    "Integer": np.int32,
    "Float64": np.float64,
    "Float32": np.float32,
    **{name: getattr(np, name.lower()) for name in INTEGERS},
}
_MOST_ELEMENTS = 2**20
"""The largest number of elements of an array."""


@attrs.define(eq=False)
class ElementVariable(ModelVariable):
    """One element of an FMI 3.0 variable, or a scalar.

    Attributes:
        data_type: The type in the names of FMI 3.0 functions, such as Float64.
        position: The position in its array, in the order of the standard.
        size: The number of elements of its array.
        array_start: The start values of the whole array, as numbers; empty for Strings.
        is_resized: Whether a structural parameter gives its array another shape than the model description.
        mime_type: The meaning of a Binary variable.
        most_bytes: The largest size of a Binary variable in bytes; None without a limit.
    """

    data_type: str = ""
    position: int = 0
    size: int = 1
    array_start: tuple[float, ...] = ()
    is_resized: bool = False
    mime_type: str = ""
    most_bytes: int | None = None


def declared_type(variable: ModelVariable) -> str:
    """Return the type of a variable in the model description, such as Float64; with FMI 2.0, such as Real."""
    if isinstance(variable, ElementVariable) and variable.type != "Enumeration":
        return variable.data_type
    return str(variable.type)


def is_version_3(description: ModelDescription) -> bool:
    """Return whether a model description is of FMI 3.0."""
    return str(description.fmiVersion).startswith("3.0")


def split_arrays(
    description: ModelDescription, structure: Mapping[str, int] | None = None, keep: Collection[str] = ()
) -> None:
    """Replace the variables of an FMI 3.0 model description by their elements.

    Clocks, Binary variables and arrays of Strings are left out.

    Args:
        description: The model description.
        structure: Values of structural parameters, by name; the others have their start values.
        keep: Types of scalars to keep all the same: Clock, Binary.

    Raises:
        ValueError: If an array is too large, or has a wrong number of start values.
    """
    resized = _resize(description, structure or {})
    elements = {
        id(v): [_make_whole_element(v)]
        if v.type in keep and not v.shape
        else list(_split(v, id(v) in resized))
        for v in description.modelVariables
    }
    description.modelVariables = [e for v in description.modelVariables for e in elements[id(v)]]
    for unknowns in (description.outputs, description.derivatives, description.initialUnknowns):
        unknowns[:] = [u for unknown in unknowns for u in _split_unknown(unknown, elements)]
    for variable in description.modelVariables:
        state_elements, index = elements.get(id(variable.derivative), ()), position_in_array(variable)
        if variable.derivative is not None:
            variable.derivative = state_elements[index] if index < len(state_elements) else None


def is_supported(variable: ModelVariable) -> bool:
    """Return whether a variable of FMI 3.0 has a type that `split_arrays` keeps."""
    return str(variable.type) in _GENERAL and not (variable.type == "String" and variable.shape)


def _resize(description: ModelDescription, structure: Mapping[str, int]) -> set[int]:
    """Give arrays the shapes that follow from structural parameters; return the `id` of those that change."""
    resized = set[int]()
    for variable in description.modelVariables if structure else ():
        sizes = zip(variable.dimensions, variable.shape or (), strict=True)
        shape = tuple(
            size if d.variable is None else structure.get(d.variable.name, size) for d, size in sizes
        )
        if shape != (variable.shape or ()):
            variable.shape = shape
            resized.add(id(variable))
    if resized:
        states, indicators = (
            sum(math.prod(u.variable.shape or ()) for u in unknowns if u.variable is not None)
            for unknowns in (description.derivatives, description.eventIndicators)
        )
        description.numberOfContinuousStates, description.numberOfEventIndicators = states, indicators
    return resized


def _split(variable: ModelVariable, is_resized: bool) -> Iterator[ElementVariable]:
    """Yield the elements of a variable; one without dimensions has one.

    A list of start values belongs to the shape of the model description, so that a resized array has none.
    """
    if not is_supported(variable):
        return
    shape = variable.shape or ()
    general, size = _GENERAL[str(variable.type)], math.prod(shape)
    if size > _MOST_ELEMENTS:
        raise ValueError(f"the array '{variable.name}' has {size} elements, more than {_MOST_ELEMENTS}")
    starts: list[str | None] = [variable.start]
    if shape:
        starts = [*(variable.start or "").split()] or [None]
        if is_resized and len(starts) > 1:
            starts = [None]
        if len(starts) == 1:
            starts *= size
        if len(starts) != size:
            raise ValueError(
                f"the array '{variable.name}' has {size} elements and {len(starts)} start values"
            )
    numbers = () if general == "String" else tuple(_parse_start(s, general) for s in starts)
    fields = {a.alias: getattr(variable, a.name) for a in attrs.fields(ModelVariable)}
    # `fmi3SetInt64` sets Enumerations, whose values have 64 bits
    data_type = "Int64" if general == "Enumeration" else str(variable.type)
    for position, index in enumerate(list_indices(shape)):
        name = f"{variable.name}{index}"
        element_fields = {"name": name, "type": general, "start": starts[position]}
        yield ElementVariable(
            **{**fields, **element_fields},
            data_type=data_type,
            position=position,
            size=size,
            array_start=numbers,
            is_resized=is_resized,
        )


def _make_whole_element(variable: ModelVariable) -> ElementVariable:
    """Return a Clock or Binary variable, not a number, as a discrete variable without a start value."""
    fields = {a.alias: getattr(variable, a.name) for a in attrs.fields(ModelVariable)}
    return ElementVariable(
        **{**fields, "variability": "discrete", "start": None}, data_type=str(variable.type)
    )


def _split_unknown(unknown: Unknown, elements: dict[int, list[ElementVariable]]) -> Iterator[Unknown]:
    """Yield one unknown per element; each depends on all elements of the knowns."""
    knowns = unknown.dependencies
    if knowns is not None:
        knowns = [e for dependency in knowns for e in elements.get(id(dependency), ())]
    for element in elements.get(id(unknown.variable), ()):
        yield attrs.evolve(unknown, variable=element, dependencies=knowns, dependenciesKind=None)


def _parse_start(text: str | None, general: str) -> float:
    if general == "Boolean":
        return float(text in ("true", "1"))
    return float(text or 0.0) if general == "Real" else int(text or 0)


def position_in_array(variable: ModelVariable) -> int:
    """Return the position of an element in its array; 0 for a scalar."""
    return variable.position if isinstance(variable, ElementVariable) else 0


class ElementLayout:
    """Where variables are in the values of one call for their type, which has whole arrays.

    Attributes:
        references: Value references; that of an array once.
        positions: The position of each variable in the values.
        size: The number of values.
    """

    def __init__(self, variables: Iterable[ModelVariable]) -> None:
        starts = dict[int, int]()
        self.references, self.positions, self.size = list[int](), list[int](), 0
        for variable in variables:
            reference, size = int(variable.valueReference), getattr(variable, "size", 1)
            start = starts.get(reference) if size > 1 else None
            if start is None:
                start = starts[reference] = self.size
                self.references.append(reference)
                self.size += size
            self.positions.append(start + position_in_array(variable))

    def pick(self, values: Sequence[Any]) -> list[Any]:
        """Return the values of the variables."""
        return [values[i] for i in self.positions]

    def spread(self, values: Iterable[float]) -> list[float]:
        """Return all values, of which those of other elements are 0."""
        spread_values = [0.0] * self.size
        for i, value in zip(self.positions, values, strict=True):
            spread_values[i] = value
        return spread_values


def value_type(variable: ModelVariable) -> np.dtype:
    """Return the type of a number in the memory of FMI functions."""
    if isinstance(variable, ElementVariable):
        return np.dtype(_DTYPES.get(variable.data_type, np.bool_))
    return np.dtype(_DTYPES.get(str(variable.type), np.int32))


def number_range(variable: ModelVariable) -> tuple[float, float]:
    """Return the smallest and the largest number that the type of a variable can hold."""
    if variable.type == "Real":
        largest = float(np.finfo(np.float32).max) if value_type(variable) == np.float32 else math.inf
        return -largest, largest
    if not isinstance(variable, ElementVariable):
        return -(2**31 - 1), 2**31 - 1
    if variable.type == "Boolean":
        return 0, 1
    limits = np.iinfo(value_type(variable))
    return int(limits.min), int(limits.max)


def declared_range(variable: ModelVariable) -> tuple[float, float]:
    """Return the minimum and the maximum of a number: its own, those of its declared type, or of its type."""
    smallest, largest = number_range(variable)
    limits = (variable.min, variable.max)
    of_type = (getattr(variable.declaredType, name, None) for name in ("min", "max"))
    low, high = (x if x is not None else y for x, y in zip(limits, of_type, strict=True))
    return smallest if low is None else float(low), largest if high is None else float(high)


def is_plain(variables: Sequence[ModelVariable]) -> bool:
    """Return whether a vector of doubles, in this order, is the memory that one FMI call needs."""
    pending: list[tuple[int | None, int]] = []
    for v in variables:
        if not isinstance(v, ElementVariable):
            if v.type != "Real":
                return False
            continue
        if v.data_type != "Float64":
            return False
        element = (v.valueReference, v.position)
        if pending and pending[0] != element:
            return False
        pending = pending[1:] or ([(v.valueReference, p) for p in range(1, v.size)] if not pending else [])
        if not pending and v.position != v.size - 1:
            return False
    return not pending


def list_indices(sizes: Sequence[int]) -> Iterator[str]:
    """Yield the indices of an array, such as `[1,1]`, in row-major order."""
    yield from map(format_index, itertools.product(*(range(1, n + 1) for n in sizes)))


def format_index(index: Sequence[int]) -> str:
    """Return an index in brackets, such as `[1,2]`; empty without numbers."""
    return f"[{','.join(map(str, index))}]" if index else ""


PERIODIC, COUNTDOWN = ("constant", "fixed", "tunable"), "countdown"
"""Kinds of clocks: periodic ones, and the one whose next tick an event can set at any time."""

TRIGGERED = "triggered"
"""The kind of clocks that tick when another clock ticks: output clocks, and the input clocks they drive."""

_ALL_VARIABILITIES = (*PERIODIC, "changing", COUNTDOWN, TRIGGERED)

CLOCK = "Clock"
"""The type of these variables. In tables, their value is the number of their ticks since the start."""


@dataclass(frozen=True)
class InputClock:
    """An input clock that ticks at times.

    Attributes:
        name: The name of the variable.
        reference: Its value reference.
        kind: Its `intervalVariability`.
        interval: The interval of a periodic clock in s; None if the FMU tells it in initialization mode.
        shift: The time from the start to the first tick of a periodic clock in s.
    """

    name: str
    reference: int
    kind: str
    interval: float | None
    shift: float


def explain_unsupported_clock(description: ModelDescription) -> str | None:
    """Return why this master cannot tick the clocks of an FMU, as the end of a message; None if it can."""
    # output clocks tick in the FMU, whatever their kind
    inputs = [v for v in description.modelVariables if v.type == CLOCK and v.causality == "input"]
    for clock in inputs:
        if clock.intervalVariability is None:
            return (
                f"has the clock '{clock.name}' without intervalVariability, which must be one of "
                f"{', '.join(_ALL_VARIABILITIES)}"
            )
        if clock.intervalVariability not in _ALL_VARIABILITIES:
            return (
                f"has the clock '{clock.name}' with intervalVariability = '{clock.intervalVariability}', "
                f"which is not one of {', '.join(_ALL_VARIABILITIES)}"
            )
    if inputs and description.coSimulation is not None and not description.coSimulation.hasEventMode:
        return f"has the clock '{inputs[0].name}' but no event mode in co-simulation"
    return None


def is_triggered_input(variable: ModelVariable) -> bool:
    """Return whether a variable is an input clock that ticks when the clock that drives it ticks."""
    is_input = variable.type == CLOCK and variable.causality == "input"
    return is_input and variable.intervalVariability == TRIGGERED


def clocks_of(variable: ModelVariable) -> list[int]:
    """Return the value references of the clocks of a variable; fmpy replaces them by variables."""
    return [int(getattr(clock, "valueReference", clock)) for clock in variable.clocks or ()]


def is_clocked(variable: ModelVariable) -> bool:
    """Return whether a variable belongs to clocks."""
    return bool(variable.clocks)


def belongs(variable: ModelVariable, clocks: Collection[int]) -> bool:
    """Return whether a variable belongs to one of these clocks, by value reference."""
    return any(clock in clocks for clock in clocks_of(variable))


def read_input_clocks(folder: Path, path: Path) -> list[InputClock]:
    """Return the input clocks of an FMU that tick at times; fmpy (0.3.32) does not read their intervals.

    Args:
        folder: The folder with the unpacked FMU.
        path: The FMU, for messages.

    Raises:
        CommandError: A number cannot be read.
    """
    root = parse_xml((folder / "modelDescription.xml").read_bytes())
    return [
        InputClock(
            name=str(clock.get("name")),
            reference=int(clock.get("valueReference")),
            kind=str(clock.get("intervalVariability")),
            interval=_read_seconds(path, clock, "intervalDecimal"),
            shift=_read_seconds(path, clock, "shiftDecimal") or 0.0,
        )
        for clock in root.iterfind("ModelVariables/Clock[@causality='input']")
        if clock.get("intervalVariability") != TRIGGERED
    ]


def _read_seconds(path: Path, clock: Any, attribute: str) -> float | None:
    """Return a number of a clock's element; None if it is missing."""
    text = clock.get(attribute)
    try:
        return None if text is None else float(text)
    except ValueError as error:
        raise CommandError(
            f"'{path}' is not a valid FMU: {attribute} of its clock '{clock.get('name')}' is '{text}', "
            "not a number."
        ) from error
