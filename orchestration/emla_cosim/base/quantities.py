"""Quantities as people write them: a number and the name of a unit, such as "30 kN" or "12.5 kg cm^2"."""

import math
import re
from dataclasses import dataclass, replace
from decimal import Decimal

from .errors import CommandError
from .units import LinearTransformation, SiUnit, find_conversion, find_unit

_QUANTITY = re.compile(r"\s*([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)\s*(\S.*?)?\s*")
_PRODUCT = re.compile(r"\s*[·⋅×]\s*|(?<=[^\W_])\s+(?=[^\W\d_])|(?<=[0-9])\s+(?=[^\W\d_])")
_POWERS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁻−", "0123456789--")


@dataclass(frozen=True)
class Quantity:
    """A number, and the unit that stands beside it; None where none does."""

    number: float
    unit: SiUnit | None = None

    def in_unit(self, unit: SiUnit | None, label: str) -> float:
        """The number in this unit; without one beside it, it is taken to be in it.

        Raises CommandError, with `label` for the quantity, where both measure different things.
        """
        try:
            between = find_conversion(self.unit, unit)
        except ValueError as error:
            raise CommandError(f"{label} has {error}, of which one cannot become the other.") from error
        return _scale_number(self.number, between)


def _scale_number(number: float, between: LinearTransformation) -> float:
    """A number transformed; by a power of ten, the one that is written with the point elsewhere."""
    power = round(math.log10(abs(between.factor)))
    if between.offset or not math.isclose(between.factor, 10.0**power, rel_tol=1e-15):
        return between(number)
    return float(Decimal(repr(number)).scaleb(power))


def has_unit(value: object) -> bool:
    """Whether a value is the text of a number with something behind it that may be a unit."""
    if not isinstance(value, str) or (found := _QUANTITY.fullmatch(value)) is None or found[2] is None:
        return False
    try:
        float(value)  # as 1_000, which Python reads
    except ValueError:
        return True
    return False


def parse_unit_name(name: str, label: str) -> SiUnit:
    """The unit that a person calls so: `kg cm^2`, `N·m/A`, `min⁻¹` as much as `kg.cm2`.

    Raises CommandError, with `label` for where it stands, for a name that does not say which unit it is.
    """
    known = find_unit(_PRODUCT.sub(".", name.strip().translate(_POWERS)))
    if known is None:
        raise CommandError(
            f"{label} has the unit '{name}', which is none; write one such as kN, mm/s, N.m or kg.cm2.",
            unit=name,
        )
    return replace(known, name=name)


def parse_quantity(text: str, label: str) -> Quantity:
    """What a text says: "30 kN", "-3.4e3 N", "0.2"; CommandError, with `label` for it, for any other."""
    found = _QUANTITY.fullmatch(text)
    if found is None:
        raise CommandError(f"{label} is '{text}'; it must be a number, or a number and a unit such as 30 kN.")
    unit = None if found[2] is None else parse_unit_name(found[2], label)
    return Quantity(float(found[1]), unit)
