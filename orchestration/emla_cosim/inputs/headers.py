"""Column headers: a name with an optional unit."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from ..base.errors import CommandError
from ..base.quantities import parse_unit_name
from ..base.units import COLUMN_UNITS, IDENTITY, SiUnit, find_conversion, find_unit, list_meanings

_HEADER = re.compile(
    r"(?P<name>.+?)"
    r"(?:\s*\[(?P<bracket>[^\[\]]*[^\d\s,\[\]][^\[\]]*)\]"  # not a[1]
    r"|(?P<space>\s*)\((?P<parenthesis>[^()]+(?:\([^()]*\)[^()]*)?)\)"
    r"|\s+/\s+(?P<slash>\S.*)|\s+in\s+(?P<word>\S+))",
    re.DOTALL,
)
_NO_UNIT = ("-", "–", "none", "")
"""Units of numbers without a unit, as users write them."""

_SEPARATOR = re.compile(r"\s+[-–]\s+|[\s_./,:;({<]")
"""What may stand between a name and an end that looks like a unit, as in `F_kN`."""

_SECONDS_AXIS = 2
"""The position of the second among the exponents of a unit."""


@dataclass(frozen=True)
class Header:
    """A header, the name in it, and the name of its unit; None without a unit."""

    text: str
    name: str
    unit: str | None = None

    @classmethod
    def of(cls, text: str, unit: str | None = None) -> "Header":
        """Parse `Force [kN]`, `Force (kN)`, `Force / kN` or `Force in kN`.

        Args:
            text: The header.
            unit: The unit if it is known from elsewhere; the text is only a name then.
        """
        match = _HEADER.fullmatch(text.strip()) if unit is None else None
        if match is None:
            return cls(text, text.strip(), unit)
        name, inside = match["name"].strip(), str(match[match.lastgroup or "name"]).strip()
        # without a space before the bracket, it may be an argument
        is_name = name.endswith("der") or not name[-1].isalnum() or not is_unit(inside)
        if match["space"] == "" and is_name:
            return cls(text, text.strip())  # der(s) and f(x) are names
        return cls(text, name, inside)

    @cached_property
    def unit_like_end(self) -> tuple[str, str] | None:
        """The name and the unit that `F_kN` seems to have; None with a unit, or without such an end."""
        if self.unit is not None:
            return None
        for separator in _SEPARATOR.finditer(self.name):
            name, end = self.name[: separator.start()].strip(), self.name[separator.end() :].strip()
            end = end[:-1] if end[-1:] in "}>" or (end[-1:] == ")" and "(" not in end) else end
            if name and any(c.isalpha() or c in "°%" for c in end) and is_unit(end):
                return name, end
        return None

    def check_unit_like_end(self, target: SiUnit | None, label: str, signal: str, declare: str) -> None:
        """Raise CommandError for a header without a unit whose end is another unit of the same quantity.

        Args:
            target: The unit of the quantity.
            label: What error messages call the column.
            signal: What error messages call the quantity.
            declare: How to declare a unit without changing the header, such as `SIGNAL=F_kN`.

        Raises:
            CommandError: If its values would be read in another unit than the header seems to have.
        """
        if self.unit_like_end is None or target is None:
            return
        name, end = self.unit_like_end
        try:
            if find_conversion(parse_unit_name(end, label, target), target) == IDENTITY:
                return
        except ValueError:  # another quantity: the end is a part of the name
            return
        raise CommandError(
            f"{label} ends like the unit '{end}', but {signal} is in {target.name}; write the unit as in "
            f"'{name} [{end}]', or declare it with '{declare} [{end}]' or '{declare} [{target.name}]'.",
            unit=end,
        )


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
    return name.strip() in (*_NO_UNIT, "1")


def is_unit(text: str) -> bool:
    """Return whether a text is the name of a unit, also of one that is a mass or a force."""
    if (meanings := list_meanings(text)) and all(find_unit(meaning) for meaning in meanings):
        return True
    try:
        parse_unit_name(text, "")
    except CommandError:
        return False
    return True


def is_same_unit(first: str, second: str) -> bool:
    """Return whether two names mean the same unit."""
    units = find_unit(first), find_unit(second)
    return first == second or (
        units[0] is not None and units[1] is not None and units[0].measures_as(units[1])
    )


def rate_of(unit: SiUnit | None, order: int) -> SiUnit | None:
    """Return the unit of a time derivative; it has no offset, because a derivative is a difference."""
    if unit is None or order == 0 or unit.exponents is None:
        return unit
    exponents = list(unit.exponents)
    exponents[_SECONDS_AXIS] -= order
    name = f"{unit.name}/s{order if order > 1 else ''}" if order > 0 else ""
    return SiUnit(name, tuple(exponents), unit.factor)


def read_metadata_units(metadata: Mapping[str, Any]) -> dict[str, str]:
    """Return the units by column from metadata such as those of results.parquet, none without an entry."""
    try:
        content = json.loads(metadata.get(COLUMN_UNITS, "{}"))
    except (ValueError, RecursionError):
        return {}
    return {n: u for n, u in content.items() if isinstance(u, str)} if isinstance(content, dict) else {}
