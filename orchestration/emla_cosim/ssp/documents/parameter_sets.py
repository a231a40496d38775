"""Parameter sets (SSV) and parameter mappings (SSM): reading and writing of XML."""

import math
from collections.abc import Iterable

from ...base.errors import CommandError
from ...base.faults import accept_if_lenient, note_fault
from .ssd_data import MappingEntry, ParameterSet, SsvParameter
from .xml import (
    XmlElement,
    add,
    add_transformation,
    add_units,
    children,
    document,
    format_float,
    format_text,
    local_name,
    parse,
    parse_boolean,
    read_transformation,
    read_unit,
    read_units,
    to_bytes,
)

_FLOATS = ("Real", "Float64", "Float32")


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
        name, typed = element.get("name"), element[0]
        found = SsvParameter(
            name, local_name(typed), _value(name, typed, where), read_unit(typed, units, where)
        )
        if name in parameters:
            _accept_second(found, parameters[name], where, element.sourceline)
        parameters[name] = found
    return ParameterSet(root.get("name"), tuple(parameters.values()), root.get("description", ""))


def _accept_second(second: SsvParameter, first: SsvParameter, where: str, line: int) -> None:
    """Accept a second value of a parameter if it is the same, and with `lenient` another one."""
    if second == first:
        note_fault(where, f"line {line} repeats the value of '{first.name}'")
        return
    accept_if_lenient(
        where,
        f"line {line} gives '{first.name}' a second value, {second.value}; it replaces {first.value}",
        f"'{where}' line {line} gives '{first.name}' a second value",
    )


def _value(name: str, typed: XmlElement, where: str) -> float | int | bool | str:
    kind = local_name(typed)
    if kind in ("String", "Enumeration"):
        texts = [e.get("value") for e in (typed, *children(typed, "ssv:Value")) if e.get("value") is not None]
    else:
        texts = [typed.get("value", "")] if kind == "Binary" else typed.get("value", "").split()
    if len(texts) != 1:
        raise CommandError(
            f"'{where}' line {typed.sourceline} gives '{name}' {len(texts)} values; FMI 2.0 has no arrays."
        )
    (text,) = texts
    if kind in _FLOATS:
        if not math.isfinite(value := float(text)):
            raise CommandError(f"'{where}' line {typed.sourceline} gives '{name}' the value {text}.")
        return value
    if kind == "Boolean":
        return parse_boolean(text)
    return int(text) if "Int" in kind else text


def add_parameter_set(root: XmlElement, parameter_set: ParameterSet) -> None:
    """Write a parameter set to a ParameterSet element."""
    group = add(root, "ssv:Parameters")
    for parameter in parameter_set.parameters:
        unit = parameter.unit.name if parameter.unit is not None else None
        element = add(group, "ssv:Parameter", name=parameter.name)
        add(element, f"ssv:{parameter.type}", value=_text(parameter), unit=unit)
    add_units(root, "ssv", [p.unit for p in parameter_set.parameters])


def _text(parameter: SsvParameter) -> str:
    if parameter.type in _FLOATS:
        return format_float(float(parameter.value))
    return format_text(parameter.value)


def format_parameter_set(parameter_set: ParameterSet) -> bytes:
    """Return a parameter set as an SSV file."""
    root = document("ssv", name=parameter_set.name, description=parameter_set.description or None)
    add_parameter_set(root, parameter_set)
    return to_bytes(root)


def parse_mapping(content: bytes, where: str) -> tuple[MappingEntry, ...]:
    """Parse an SSM file.

    Args:
        content: The content of the file.
        where: Its name in error messages.

    Raises:
        CommandError: If it is not a valid SSM.
    """
    return read_mapping(parse(content, where, "ssm"), where)


def read_mapping(root: XmlElement, where: str) -> tuple[MappingEntry, ...]:
    """Read a ParameterMapping element.

    Args:
        root: The element.
        where: The name of its document in error messages.

    Raises:
        CommandError: If two entries have the same target.
    """
    entries: dict[str, MappingEntry] = {}
    for element in children(root, "ssm:MappingEntry"):
        source, target = element.get("source"), element.get("target")
        if target in entries:
            raise CommandError(
                f"'{where}' line {element.sourceline} maps '{source}' to '{target}', which is already the "
                f"target of '{entries[target].source}'."
            )
        suppress = parse_boolean(element.get("suppressUnitConversion"))
        entries[target] = MappingEntry(source, target, read_transformation(element, where), suppress)
    return tuple(entries.values())


def add_mapping(root: XmlElement, entries: Iterable[MappingEntry]) -> None:
    """Write mapping entries to a ParameterMapping element."""
    for entry in entries:
        suppress = "true" if entry.suppress_unit_conversion else None
        element = add(
            root,
            "ssm:MappingEntry",
            source=entry.source,
            target=entry.target,
            suppressUnitConversion=suppress,
        )
        add_transformation(element, entry.transformation)


def format_mapping(entries: Iterable[MappingEntry]) -> bytes:
    """Return mapping entries as an SSM file."""
    root = document("ssm")
    add_mapping(root, entries)
    return to_bytes(root)
