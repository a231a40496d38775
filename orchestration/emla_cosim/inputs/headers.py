"""Column headers: a name with an optional unit."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from ..base.arrays import Vector
from ..base.errors import CommandError
from ..base.quantities import parse_unit_name
from ..base.units import COLUMN_UNITS, IDENTITY, SiUnit, find_conversion, find_unit, list_meanings

_HEADER = re.compile(
    r"(?P<name>.+?)"
    r"(?:\s*\[(?P<bracket>[^\[\]]*[^\d\s,\[\]][^\[\]]*)\]"  # not a[1]
    r"|\s*\{(?P<brace>[^{}]+)\}|\s*<(?P<angle>[^<>]+)>"
    r"|\s+\((?P<parenthesis>[^()]+(?:\([^()]*\)[^()]*)?)\)|\s+/\s+(?P<slash>\S.*))",
    re.DOTALL,
)
_ONE = ("-", "–", "none", "")
"""Units of numbers without a unit, as users write them."""

_INCHES = re.compile(r"in\s+(?!lb|oz)(\S.*)")
"""A unit in brackets after `in`, as in `(in kN)`, which is no inch; `in lbf` is a torque."""

_SEPARATOR = re.compile(r"\s+in\s+|\s*,\s*|\s*:\s*|\s+[-–]\s+|/|_|\s+|\((?=[^()]+(?:\([^()]*\)[^()]*)?\)$)")
"""What may stand between a name and its unit, beside the forms of `_HEADER`."""

_SECONDS = SiUnit("s", (0, 0, 1, 0, 0, 0, 0, 0))


@dataclass(frozen=True)
class Suffix:
    """The end of a header that may be a unit, as in `Force in kN` or `F_kN`.

    Attributes:
        name: The header without it.
        unit: The name of the unit.
        is_short: Whether it has one letter, and may be an index, as in `x_d` and `F_L`.
        is_dotted: Whether it stands after a dot, as in `F.kN`, and may be a part of a name, as in `pump.hA`.
    """

    name: str
    unit: str
    is_short: bool
    is_dotted: bool = False


@dataclass(frozen=True)
class Header:
    """A header, the name in it, and the name of its unit; None without a unit."""

    text: str
    name: str
    unit: str | None = None

    @cached_property
    def suffix(self) -> Suffix | None:
        """The unit at the end of the name; None if the header has a unit, or if there is none."""
        if self.unit is not None:
            return None
        separators = sorted(_SEPARATOR.finditer(self.name), key=lambda one: one[0].strip() != "in")
        for found in separators:  # `in` first: it is also a unit, and `L in kN` a product
            name, unit = self.name[: found.start()].strip(), self.name[found.end() :].strip()
            bare = unit.removesuffix(")") if found[0] == "(" else unit
            letters = [c for c in bare if c.isalpha() or c in "°%"]
            if not name or name == "der" or not letters:
                continue
            if not is_unit(bare) and not (found[0].strip() == "in" and len(bare.split()) == 1):
                continue  # after `in`, a word that is no unit is an error
            return Suffix(name, bare, len(letters) == 1 and found[0].strip() in ("", "/", "_"))
        return self._dotted_suffix()

    def _dotted_suffix(self) -> Suffix | None:
        """Return the unit after the only dot, of two letters or more: `motor.A` and `a.b.mm` are signals."""
        name, _, unit = self.name.partition(".")
        if not name or "." in unit or sum(c.isalpha() for c in unit) < 2 or not is_unit(unit):
            return None
        return Suffix(name, unit, unit == "min", is_dotted=True)  # a minimum or minutes

    @classmethod
    def of(cls, text: str, unit: str | None = None) -> "Header":
        """Parse `Force [kN]`, `Force (kN)` or `Force / kN`; with `unit`, the text is only a name."""
        found = _HEADER.fullmatch(text.strip()) if unit is None else None
        if found is None:
            return cls(text, text.strip(), unit)
        inside = str(found[found.lastgroup or "name"]).strip()
        if (after := _INCHES.fullmatch(inside)) is not None and is_unit(after[1]):
            inside = after[1]
        return cls(text, found["name"].strip(), inside)

    def in_seconds(self, numbers: Vector, asked: str | None, label: str) -> Vector:
        """Convert the column to times in s.

        Args:
            numbers: The values.
            asked: The user's name for the column, possibly with a unit.
            label: What error messages call the table.

        Raises:
            CommandError: If the unit is not one of time.
        """
        declared = Header.of(asked).unit if asked is not None and asked != self.text else None
        unit = parse_data_unit(declared or self.unit, f"the time of {label}")
        if unit is None and (suffix := self.suffix) is not None:
            unit = read_suffix(suffix, _SECONDS, f"the time '{self.text}' of {label}", self.text)
        try:
            factor = find_conversion(unit, _SECONDS)
        except ValueError as error:
            raise CommandError(
                f"the time '{self.text}' of {label} has {error}; it must be a time."
            ) from error
        return factor.factor * numbers + factor.offset if unit is not None else numbers


def parse_data_unit(name: str | None, label: str, target: SiUnit | None = None) -> SiUnit | None:
    """Return a unit by its name, None without one.

    Args:
        name: The name of the unit.
        label: What error messages call the place of the name.
        target: The unit to convert to, see `parse_unit_name`.

    Raises:
        CommandError: If the name is not that of a unit.
    """
    if name is None:
        return None
    return parse_unit_name("1" if is_dimensionless(name) else name, label, target)


def is_dimensionless(name: str) -> bool:
    """Return whether a text says that numbers have no unit, as a dash does."""
    return name.strip() in (*_ONE, "1")


def is_unit(text: str) -> bool:
    """Return whether a text is the name of a unit, also of one that is a mass or a force."""
    if list_meanings(text) and all(find_unit(one) for one in list_meanings(text)):
        return True
    try:
        parse_unit_name(text, "")
    except CommandError:
        return False
    return True


def read_suffix(suffix: Suffix, target: SiUnit | None, label: str, header: str) -> SiUnit | None:
    """Return the unit at the end of a header, None if the end belongs to the name.

    Args:
        suffix: The end of the header.
        target: The unit of the quantity that the column drives.
        label: What error messages call the column.
        header: The header.

    Raises:
        CommandError: If it can be both a unit and a part of the name, and the values would differ.
    """
    unit = parse_unit_name(suffix.unit, label, target)
    try:
        between = find_conversion(unit, target)
    except ValueError:
        if suffix.is_short or suffix.is_dotted:
            return None
    else:
        if between == IDENTITY or not suffix.is_short:
            return unit
    example = target.name if target is not None and target.name else suffix.unit
    raise CommandError(
        f"{label} may have the unit '{suffix.unit}' at its end, or be called so; write the unit after the "
        f"name of the column, such as '{header} [{example}]'.",
        unit=suffix.unit,
    )


def is_same_unit(one: str, other: str) -> bool:
    """Return whether two names mean the same unit."""
    units = find_unit(one), find_unit(other)
    return one == other or (units[0] is not None and units[1] is not None and units[0].measures_as(units[1]))


def rate_of(unit: SiUnit | None, order: int) -> SiUnit | None:
    """Return the unit of a time derivative; it has no offset, because a derivative is a difference."""
    if unit is None or order == 0 or unit.exponents is None:
        return unit
    exponents = list(unit.exponents)
    exponents[_SECONDS.exponents.index(1)] -= order  # type: ignore[union-attr]
    name = f"{unit.name}/s{order if order > 1 else ''}" if order > 0 else ""
    return SiUnit(name, tuple(exponents), unit.factor)


def read_metadata_units(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return the units by column from metadata such as those of results.parquet, none without an entry."""
    try:
        found = json.loads(metadata.get(COLUMN_UNITS, "{}"))
    except (ValueError, RecursionError):
        return {}
    return {n: u for n, u in found.items() if isinstance(u, str)} if isinstance(found, dict) else {}
