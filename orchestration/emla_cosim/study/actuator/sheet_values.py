"""Data sheets as files: quantities as data sheets print them, and the struct of all tables.

A quantity has a unit, and is rms or peak, line to line or per phase.
"""

import math
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from ...base.errors import CommandError
from ...base.quantities import parse_quantity, parse_unit_name
from ...base.table_entries import Location
from ...base.toml_structs import QUANTITY, describe, extend_struct
from ...base.values import as_float
from .entries import REQUIRED_TABLES, TABLES, TURN, SheetEntry

RMS, PEAK = "rms", "peak"
BETWEEN, PHASE = "line to line", "per phase"

_CONVENTIONS = (
    (RMS, re.compile(r"(?<=[AV])[ _]?rms\b|\brms\b", re.IGNORECASE)),
    (PEAK, re.compile(r"(?<=[AV])[ _]?(?:peak|pk)\b|\bpeak\b", re.IGNORECASE)),
    (
        BETWEEN,
        re.compile(r"\b(?:line|phase)[- ](?:to[- ])?(?:line|phase)\b|\bl-l\b|\bph-ph\b", re.IGNORECASE),
    ),
    (PHASE, re.compile(r"\b(?:per )?phase\b", re.IGNORECASE)),
)
"""Conventions beside a unit, in the order of search: "phase to phase" contains "phase"."""

_SPELLINGS = (
    (re.compile(r"\(\s*\)|,(?!\d)"), " "),
    (re.compile(r"\b(?:1 ?/ ?min|min\^?-1|min⁻¹|r ?/ ?min)(?![\w.])"), "rpm"),
    (re.compile(r"\b1000 ?(?:rpm|RPM)\b"), "krpm"),
)
"""Spellings in data sheets only: 1/min is a speed of turns."""


@dataclass(frozen=True)
class SheetValue:
    """An entry, and its number in the model: in SI units, peak values, those of a phase."""

    text: str
    number: float


def read_sheet_value(value: Any, entry: SheetEntry, label: str) -> SheetValue:
    """Read an entry of a file; raise CommandError, with `label`, if it is invalid or ambiguous."""
    if entry.choices:
        if value not in entry.choices:
            raise CommandError(f"{label} is {value!r}; it must be {' or '.join(entry.choices)}.")
        return SheetValue(str(value), float(entry.choices.index(value)))
    if entry.kind is bool:
        if not isinstance(value, bool):
            raise CommandError(f"{label} is {value!r}; it must be true or false.")
        return SheetValue(str(value).lower(), float(value))
    # true is an int in Python
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise CommandError(f'{label} is {value!r}; write it as "{entry.example}".')
    if isinstance(value, str):
        text, number = " ".join(value.split()), _read_number(value, entry, label)
    elif entry.unit:
        raise CommandError(f'{label} is {value!r} without a unit; add one, as in "{entry.example}".')
    else:
        number = as_float(value)
        text = f"{number:.9g}"
    _check_range(number, entry, f"{label} is {text}")
    return SheetValue(text, number)


def _read_number(text: str, entry: SheetEntry, label: str) -> float:
    remainder, factor = _read_suffix(text, entry, label)
    for pattern, spelling in _SPELLINGS:
        remainder = pattern.sub(spelling, remainder)
    unit = replace(parse_unit_name(entry.unit or "1", label), is_difference=entry.is_difference)
    quantity = parse_quantity(remainder, label, unit)
    number = quantity.in_unit(unit, label) * factor
    if not entry.unit:
        return number
    if quantity.unit is None:
        raise CommandError(f"{label} is '{text}' without a unit; add one, as in \"{entry.example}\".")
    # a turn and a radian have the same dimension, so that units alone do not tell
    powers, expected = quantity.unit.powers.get("rad", 0), unit.powers.get("rad", 0)
    if powers == expected:
        return number
    if entry.per_turn and powers == -1:
        return number * TURN
    raise CommandError(
        f"{label} is '{text}'; state whether it is in turns or radians: write it as \"{entry.example}\"."
    )


def _read_suffix(text: str, entry: SheetEntry, label: str) -> tuple[str, float]:
    """Return the text without its conventions, and the factor that follows from them."""
    conventions = set[str]()
    for convention, pattern in _CONVENTIONS:
        text, count = pattern.subn(" ", text)
        if count:
            conventions.add(convention)
    factor = 1.0
    for choice, (first, second) in ((entry.rms, (RMS, PEAK)), (entry.between, (BETWEEN, PHASE))):
        stated = conventions & {first, second}
        if choice is None and stated:
            raise CommandError(f'{label} must not be {sorted(stated)[0]}; write it as "{entry.example}".')
        if choice is not None and len(stated) != 1:
            raise CommandError(f'{label} is ambiguous, {first} or {second}; write it as "{entry.example}".')
        if choice is not None and first in stated:
            factor *= choice
    return text, factor


def _check_range(number: float, entry: SheetEntry, fault: str) -> None:
    if not math.isfinite(number):
        raise CommandError(f"{fault}; it must be a finite number.")
    if entry.positive and not entry.signed and number <= 0.0:
        raise CommandError(f"{fault}; it must be more than 0.")
    if not entry.signed and number < 0.0:
        raise CommandError(f"{fault}; it must not be less than 0.")
    if number > entry.most:
        raise CommandError(f"{fault}; it must be at most {entry.most:g}.")
    if entry.is_integer and number != round(number):
        raise CommandError(f"{fault}; it must be a whole number.")


def _build_field(table: str, entry: SheetEntry) -> Any:
    """Return an entry as a field of a struct."""

    def read(value: Any, _at: Location, _folder: Path | None) -> SheetValue:
        return read_sheet_value(value, entry, f"{table}.{entry.key}")

    schema: dict[str, Any] = {} if entry.choices or entry.kind is bool else {"pattern": QUANTITY}
    if entry.most < math.inf and not entry.unit:
        schema["maximum"] = entry.most
    type_: Any = Literal[entry.choices] if entry.choices else str if entry.unit else entry.kind
    meta = describe(entry.about, entry.example, read, extra_json_schema=schema)
    return (entry.key, Annotated[type_, meta], *([] if entry.needed else [msgspec.UNSET]))


class SheetTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An actuator as its data sheets describe it; docs/actuator.md has the entries."""

    name: str = ""
    source: str = ""


def _build_table(name: str, entries: tuple[SheetEntry, ...]) -> Any:
    struct = extend_struct(msgspec.Struct, name, [_build_field(name, entry) for entry in entries])
    return (name, struct, *([] if name in REQUIRED_TABLES else [msgspec.UNSET]))


ACTUATOR = extend_struct(
    SheetTable, "Actuator", [_build_table(name, entries) for name, entries in TABLES.items()]
)
"""The struct of an actuator's file; entries become `SheetValue`."""
