"""Column headers: a name with an optional unit."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..base.arrays import Vector
from ..base.errors import CommandError
from ..base.quantities import parse_unit_name
from ..base.units import COLUMN_UNITS, SiUnit, find_conversion, find_unit

_HEADER = re.compile(
    r"(?P<name>.+?)"
    r"(?:\s*\[(?P<bracket>[^\[\]]*[^\d\s,\[\]][^\[\]]*)\]"  # not a[1]
    r"|\s+\((?P<parenthesis>[^()]+(?:\([^()]*\)[^()]*)?)\)|\s+/\s+(?P<slash>\S.*))",
    re.DOTALL,
)
_ONE = ("-", "–", "none", "")
"""Units of numbers without a unit, as users write them."""

_SECONDS = SiUnit("s", (0, 0, 1, 0, 0, 0, 0, 0))


@dataclass(frozen=True)
class Header:
    """A header, the name in it, and the name of its unit; None without a unit."""

    text: str
    name: str
    unit: str | None = None

    @classmethod
    def of(cls, text: str, unit: str | None = None) -> "Header":
        """Parse `Force [kN]`, `Force (kN)` or `Force / kN`; with `unit`, the text is only a name."""
        found = _HEADER.fullmatch(text.strip()) if unit is None else None
        if found is None:
            return cls(text, text.strip(), unit)
        return cls(text, found["name"].strip(), str(found[found.lastgroup or "name"]).strip())

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
        try:
            factor = find_conversion(unit, _SECONDS)
        except ValueError as error:
            raise CommandError(
                f"the time '{self.text}' of {label} has {error}; it must be a time."
            ) from error
        return factor.factor * numbers + factor.offset if unit is not None else numbers


def parse_data_unit(name: str | None, label: str) -> SiUnit | None:
    """Return a unit by its name, None without one.

    Args:
        name: The name of the unit.
        label: What error messages call the place of the name.

    Raises:
        CommandError: If the name is not that of a unit.
    """
    if name is None:
        return None
    return parse_unit_name("1" if name.strip() in _ONE else name, label)


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
    return SiUnit(f"{unit.name}/s{order if order > 1 else ''}", tuple(exponents), unit.factor)


def read_metadata_units(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return the units by column from metadata such as those of results.parquet, none without an entry."""
    try:
        found = json.loads(metadata.get(COLUMN_UNITS, "{}"))
    except (ValueError, RecursionError):
        return {}
    return {n: u for n, u in found.items() if isinstance(u, str)} if isinstance(found, dict) else {}
