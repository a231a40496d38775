"""Headers of columns: a name, and maybe a unit behind it."""

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
"""What people write for the unit of a number without one."""

_SECONDS = SiUnit("s", (0, 0, 1, 0, 0, 0, 0, 0))


@dataclass(frozen=True)
class Header:
    """A header as it is written, the name in it, and the name of the unit; None where there is none."""

    text: str
    name: str
    unit: str | None = None

    @classmethod
    def of(cls, text: str, unit: str | None = None) -> "Header":
        """Force [kN], Force (kN) or Force / kN; or a name alone whose unit is known from elsewhere."""
        found = _HEADER.fullmatch(text.strip()) if unit is None else None
        if found is None:
            return cls(text, text.strip(), unit)
        return cls(text, found["name"].strip(), str(found[found.lastgroup or "name"]).strip())

    def in_seconds(self, numbers: Vector, asked: str | None, label: str) -> Vector:
        """Times in s; CommandError where they have a unit that measures something else.

        `asked` is what somebody called the column, who may have named its unit.
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
    """The unit of this name, None without one; CommandError, with `label`, for a name that is none."""
    if name is None:
        return None
    return parse_unit_name("1" if name.strip() in _ONE else name, label)


def is_same_unit(one: str, other: str) -> bool:
    """Whether two names mean the same unit."""
    units = find_unit(one), find_unit(other)
    return one == other or (units[0] is not None and units[1] is not None and units[0].measures_as(units[1]))


def rate_of(unit: SiUnit | None, order: int) -> SiUnit | None:
    """The unit of a time derivative: a difference, so that an offset is lost."""
    if unit is None or order == 0 or unit.exponents is None:
        return unit
    exponents = list(unit.exponents)
    exponents[_SECONDS.exponents.index(1)] -= order  # type: ignore[union-attr]
    return SiUnit(f"{unit.name}/s{order if order > 1 else ''}", tuple(exponents), unit.factor)


def read_metadata_units(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Units by column, as the metadata of results.parquet has them; none where it says nothing of them."""
    try:
        found = json.loads(metadata.get(COLUMN_UNITS, "{}"))
    except (ValueError, RecursionError):
        return {}
    return {n: u for n, u in found.items() if isinstance(u, str)} if isinstance(found, dict) else {}
