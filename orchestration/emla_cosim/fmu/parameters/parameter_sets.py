"""Parameter sets (SSV): reading and writing of XML. Names and meanings follow the standard."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import groupby

from ...base.errors import CommandError
from ...base.faults import accept_if_lenient, convert_documents_units, note_fault
from ...base.units import SiUnit
from ...base.wording import format_count
from ..elements import list_indices
from .ssp_xml import (
    VERSION_1,
    XmlElement,
    add,
    add_units,
    children,
    document,
    format_float,
    format_text,
    local_name,
    parse,
    parse_boolean,
    read_unit,
    read_units,
    to_bytes,
)

_FLOATS = ("Real", "Float64", "Float32")
_TEXTS = ("String", "Enumeration", "Binary")
"""Types whose arrays have an element for each value; those of other types are lists in one attribute."""


@dataclass(frozen=True)
class ParameterArray:
    """The array of a parameter: its name, and the size of each dimension."""

    name: str
    sizes: tuple[int, ...]


@dataclass(frozen=True)
class SsvParameter:
    """A named value; `type` is the SSV element, such as Real.

    Elements of an array are parameters of their own, such as `x[1,2]`, in the order of the standard.
    `array` says what they are elements of. `location` is the file and line for error messages.
    """

    name: str
    type: str
    value: float | int | bool | str
    unit: SiUnit | None = None
    array: ParameterArray | None = None
    location: str = field(default="", compare=False)

    @property
    def document_name(self) -> str:
        """Name in the document: that of its array if it is an element."""
        return self.name if self.array is None else self.array.name


@dataclass(frozen=True)
class ParameterSet:
    """The content of an SSV: a list of parameters."""

    name: str
    parameters: tuple[SsvParameter, ...]
    description: str = ""


def parse_parameter_set(content: bytes, where: str) -> ParameterSet:
    """Parse an SSV file.

    Args:
        content: The content of the file.
        where: Its name in error messages.

    Raises:
        CommandError: If it is not a valid SSV.
    """
    return read_parameter_set(parse(content, where, "ssv"), where)


def read_parameter_set(root: XmlElement, where: str) -> ParameterSet:
    """Read a ParameterSet element.

    Args:
        root: The element.
        where: The name of its document in error messages.

    Raises:
        CommandError: If a value is not supported or set twice.
    """
    units = read_units(root, "ssv", where)
    parameters: dict[str, SsvParameter] = {}
    for element in children(root, "ssv:Parameters", "ssv:Parameter"):
        for parameter in _read_parameter(element, units, where):
            if parameter.name in parameters:
                _accept_second(parameter, parameters[parameter.name], where, element.sourceline)
            parameters[parameter.name] = parameter
    return ParameterSet(root.get("name"), tuple(parameters.values()), root.get("description", ""))


def _read_parameter(element: XmlElement, units: dict[str, SiUnit], where: str) -> Iterator[SsvParameter]:
    """Yield a parameter, or the elements of an array."""
    name, typed = element.get("name"), element[0]
    location = f"'{where}' line {typed.sourceline}"
    texts, unit = _read_texts(typed, name, location), read_unit(typed, units, where)
    sizes = _read_sizes(element, name, len(texts), where)
    array = ParameterArray(name, sizes) if sizes else None
    for index, text in zip(list_indices(sizes) if sizes else ("",), texts, strict=True):
        value = _parse_value(f"{name}{index}", local_name(typed), text, location)
        yield SsvParameter(f"{name}{index}", local_name(typed), value, unit, array, location)


def _read_sizes(element: XmlElement, name: str, count: int, where: str) -> tuple[int, ...]:
    """Return the size of each dimension of a parameter; empty for a scalar.

    With `lenient`, several values without dimensions are those of a vector.
    """
    location = f"'{where}' line {element.sourceline}"
    dimensions = list(children(element, "ssc:Dimension"))
    sizes = tuple(int(d.get("size", "-1")) for d in dimensions)
    if -1 in sizes or any(d.get("sizeConnector") is not None for d in dimensions):
        raise CommandError(
            f"{location}: each Dimension of the parameter '{name}' must have a size, and no sizeConnector."
        )
    if 0 in sizes:
        raise CommandError(
            f"{location}: a Dimension of the parameter '{name}' has the size 0; arrays need an "
            "element at least."
        )
    if not sizes and count > 1:
        text = f"gives '{name}' {count} values, but no dimension"
        accept_if_lenient(
            where,
            f"line {element.sourceline} {text}; they are read as those of a vector",
            f'{location} {text}; add <ssc:Dimension size="{count}"/>',
        )
        return (count,)
    if count != (needed := math.prod(sizes)):
        raise CommandError(f"{location} gives '{name}' {format_count(count, 'value')}; it needs {needed}.")
    return sizes


def _accept_second(second: SsvParameter, first: SsvParameter, where: str, line: int) -> None:
    """Accept a second value of a parameter if it is the same, and with `lenient` another one.

    Raise CommandError otherwise.
    """
    if second == first:
        note_fault(where, f"line {line} repeats the value of '{first.name}'")
        return
    accept_if_lenient(
        where,
        f"line {line} gives '{first.name}' a second value, {second.value}; it replaces {first.value}",
        f"'{where}' line {line} gives '{first.name}' a second value",
    )


def _read_texts(typed: XmlElement, name: str, location: str) -> list[str]:
    """Return the values of a parameter as they are written."""
    if local_name(typed) not in _TEXTS:
        return typed.get("value", "").split()
    inside = [e.get("value") for e in children(typed, "ssv:Value")]
    if inside and typed.get("value") is not None:
        raise CommandError(
            f"{location} gives '{name}' a value and Value elements; only one of the two is allowed."
        )
    return inside if inside or typed.get("value") is None else [typed.get("value")]


def _parse_value(name: str, kind: str, text: str, location: str) -> float | int | bool | str:
    if kind in _FLOATS:
        if not math.isfinite(value := float(text)):
            raise CommandError(f"{location} gives '{name}' the value {text}; it must be finite.")
        return value
    if kind == "Boolean":
        return parse_boolean(text)
    return int(text) if "Int" in kind else text


def convert_parameter(parameter: SsvParameter, unit: SiUnit | None, where: str) -> float | int | bool | str:
    """Return the value of a parameter in the unit of the variable that it sets.

    Args:
        parameter: The parameter.
        unit: The unit of the variable, or None.
        where: The name of the document in error messages.

    Raises:
        CommandError: If the units do not match.
    """
    written = parameter.unit
    if written is None or unit is None:
        return parameter.value
    if written.exponents is None:
        written = unit.alternatives.get(written.name, written)
    try:
        return convert_documents_units(where, written, unit)(float(parameter.value))
    except ValueError as error:
        raise CommandError(f"'{parameter.name}' of '{where}' has {error}.") from error


def add_parameter_set(root: XmlElement, parameter_set: ParameterSet) -> None:
    """Write a parameter set to a ParameterSet element; the elements of an array follow each other."""
    group = add(root, "ssv:Parameters")
    for name, same in groupby(parameter_set.parameters, lambda p: p.document_name):
        members = list(same)
        first, texts = members[0], [_format_parameter(p) for p in members]
        unit = first.unit.name if first.unit is not None else None
        element = add(group, "ssv:Parameter", name=name)
        is_list = len(texts) > 1 and first.type in _TEXTS
        typed = add(element, f"ssv:{first.type}", value=None if is_list else " ".join(texts), unit=unit)
        for text in texts if is_list else ():
            add(typed, "ssv:Value", value=text)
        for size in () if first.array is None else first.array.sizes:
            add(element, "ssc:Dimension", size=str(size))
    add_units(root, "ssv", [p.unit for p in parameter_set.parameters])


def _format_parameter(parameter: SsvParameter) -> str:
    if parameter.type in _FLOATS:
        return format_float(float(parameter.value))
    return format_text(parameter.value)


def format_parameter_set(parameter_set: ParameterSet, version: str = VERSION_1) -> bytes:
    """Return a parameter set as an SSV file of a version of SSP."""
    root = document("ssv", version, name=parameter_set.name, description=parameter_set.description or None)
    add_parameter_set(root, parameter_set)
    return to_bytes(root)
