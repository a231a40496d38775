"""Quantities as users write them: a number and the name of a unit, such as "30 kN" or "12.5 kg cm^2"."""

import math
import re
from dataclasses import dataclass, replace
from decimal import Decimal

from .errors import CommandError
from .units import LinearTransformation, SiUnit, find_conversion, find_unit, list_meanings, read_turns

_QUANTITY = re.compile(r"\s*([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)\s*(\S.*?)?\s*")
_PRODUCT = re.compile(r"\s*[·⋅×]\s*|(?<=[^\W_])\s+(?=[^\W\d_])|(?<=[0-9])\s+(?=[^\W\d_])")
_POWERS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻−", "0123456789--")


@dataclass(frozen=True)
class Quantity:
    """A number and its unit; None without a unit."""

    number: float
    unit: SiUnit | None = None

    def in_unit(self, unit: SiUnit | None, label: str) -> float:
        """Return the number in another unit; a number without a unit is already in it.

        Args:
            unit: The unit to convert to.
            label: What error messages call the quantity.

        Raises:
            CommandError: If the units measure different things.
        """
        try:
            between = find_conversion(None if self.unit is None else read_turns(self.unit, unit), unit)
        except ValueError as error:
            raise CommandError(f"{label} has {error}, which cannot be converted into each other.") from error
        return _scale_number(self.number, between)


def _scale_number(number: float, between: LinearTransformation) -> float:
    """Transform a number; a power of ten only shifts the decimal point, so that no digit changes."""
    power = round(math.log10(abs(between.factor)))
    if between.offset or not math.isclose(between.factor, 10.0**power, rel_tol=1e-15):
        return between(number)
    return float(Decimal(repr(number)).scaleb(power))


def has_unit(value: object) -> bool:
    """Return whether a value is a text of a number and something that may be a unit."""
    if not isinstance(value, str) or (found := _QUANTITY.fullmatch(value)) is None or found[2] is None:
        return False
    try:
        float(value)  # such as 1_000, which Python reads
    except ValueError:
        return True
    return False


def split_quantity(text: str) -> tuple[float, str]:
    """Return the number and the rest of a text for which `has_unit` is true."""
    found = _QUANTITY.fullmatch(text)
    assert found is not None
    return float(found[1]), found[2] or ""


def parse_unit_name(name: str, label: str, target: SiUnit | None = None) -> SiUnit:
    """Return the unit that a user writes as `kg cm^2`, `N·m/A`, `min⁻¹` or `kg.cm2`.

    Args:
        name: The name of the unit.
        label: What error messages call the place of the name.
        target: A unit of the same dimension, which decides whether `lb` and `oz` are masses or forces.

    Raises:
        CommandError: If the name is not that of a unit, or `lb` or `oz` may be a mass and a force.
    """
    written = _PRODUCT.sub(".", name.strip().translate(_POWERS))
    known = find_unit(written)
    if known is None and (meanings := list_meanings(written)):
        units = [find_unit(one) for one in meanings]
        known = next(
            (u for u in units if u is not None and target is not None and _is_alike(u, target)), None
        )
        if known is None and all(units):
            raise CommandError(
                f"{label} has the unit '{name}', which is a mass or a force; write {' or '.join(meanings)}.",
                unit=name,
            )
    if known is None:
        raise CommandError(
            f"{label} has the unknown unit '{name}'; write a unit such as kN, mm/s, N.m or kg.cm2.",
            unit=name,
        )
    return replace(known, name=name)


def _is_alike(unit: SiUnit, target: SiUnit) -> bool:
    """Return whether units can be converted into each other."""
    return unit.exponents is not None and unit.exponents[:-1] == (target.exponents or ())[:-1]


def parse_quantity(text: str, label: str, target: SiUnit | None = None) -> Quantity:
    """Parse a quantity, such as "30 kN", "-3.4e3 N" or "0.2".

    Args:
        text: The text.
        label: What error messages call the quantity.
        target: A unit of the same dimension, see `parse_unit_name`.

    Raises:
        CommandError: If it is not a number with or without a unit.
    """
    found = _QUANTITY.fullmatch(text)
    if found is None:
        raise CommandError(f"{label} is '{text}'; it must be a number, or a number and a unit such as 30 kN.")
    unit = None if found[2] is None else parse_unit_name(found[2], label, target)
    return Quantity(float(found[1]), unit)
