"""Units, which come from `fmublock.units`, and linear transformations of values."""

import math
from dataclasses import dataclass, replace

from fmublock.units import BASE_UNITS, SiUnit, counts_turns, find_unit, list_meanings

__all__ = [
    "BASE_UNITS",
    "COLUMN_UNITS",
    "IDENTITY",
    "LinearTransformation",
    "SiUnit",
    "counts_turns",
    "find_conversion",
    "find_unit",
    "list_meanings",
    "read_turns",
]

COLUMN_UNITS = "units"
"""The metadata entry of a Parquet file with the units of its columns, as a JSON object."""


_PER_MINUTE = 1.0 / 60.0


def read_turns(unit: SiUnit, target: SiUnit | None) -> SiUnit:
    """Return a unit that a person wrote, as turns per time if it is `1/min` or `Hz` beside one in rad/s.

    The definition of a unit in an FMU says itself whether it is of an angle.

    Args:
        unit: The unit.
        target: The unit to which values are to be converted.
    """
    if unit.exponents is None or target is None or target.exponents is None:
        return unit
    rate = find_unit("1/s")
    angular = find_unit("rad/s")
    if rate is None or angular is None or target.exponents != angular.exponents:
        return unit
    if unit.exponents != rate.exponents or not (unit.name.endswith("Hz") or unit.factor == _PER_MINUTE):
        return unit
    return replace(unit, exponents=angular.exponents, factor=2.0 * math.pi * unit.factor)


@dataclass(frozen=True)
class LinearTransformation:
    """Linear transformation of a value: target = factor * source + offset.

    Args:
        factor: factor, in units of the target per unit of the source.
        offset: offset in the unit of the target.

    Examples:
        >>> import emla_cosim as ec
        >>> celsius = ec.LinearTransformation(offset=-273.15)
        >>> round(celsius(300.0), 2)
        26.85
    """

    factor: float = 1.0
    offset: float = 0.0

    def __call__(self, value: float) -> float:
        """Return the target of a source value."""
        return self.factor * value + self.offset

    def __str__(self) -> str:
        offset = f" {'+' if self.offset > 0.0 else '-'} {abs(self.offset):.9g}" if self.offset else ""
        return f"x {self.factor:.9g}{offset}"

    def after(self, first: "LinearTransformation") -> "LinearTransformation":
        """Return the transformation that applies `first`, then this one."""
        return LinearTransformation(self.factor * first.factor, self.factor * first.offset + self.offset)

    def inverse(self) -> "LinearTransformation":
        """Return the inverse; raise ZeroDivisionError for the factor 0."""
        return LinearTransformation(1.0 / self.factor, -self.offset / self.factor)


IDENTITY = LinearTransformation()


class UndefinedUnitError(ValueError):
    """Two units cannot be converted because one of them has no definition; the message is a phrase."""


def find_conversion(source: SiUnit | None, target: SiUnit | None) -> LinearTransformation:
    """Return the conversion from one unit to another; the identity if one of them is None.

    The radian is ignored: a torque in N.m is one in N.m/rad. There is no offset if one of them is that of a
    difference.

    Raises:
        UndefinedUnitError: If one of the units has no definition.
        ValueError: If they measure different things. The message is a phrase such as `the units m and s`.
    """
    if source is None or target is None or source == target:
        return IDENTITY
    if source.exponents is None or target.exponents is None:
        if source.name == target.name:
            return IDENTITY
        raise UndefinedUnitError(f"the units {source} and {target}, one of which is not defined")
    if source.exponents[:-1] != target.exponents[:-1]:
        raise ValueError(f"the units {source} and {target}")
    offset = 0.0 if source.is_difference or target.is_difference else source.offset - target.offset
    return LinearTransformation(source.factor / target.factor, offset / target.factor)
