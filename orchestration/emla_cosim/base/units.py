"""Units, which come from `fmublock.units`, and linear transformations of values."""

import math
from dataclasses import dataclass, replace

from fmublock.units import BASE_UNITS as BASE_UNITS
from fmublock.units import SiUnit, counts_turns, find_unit
from fmublock.units import list_meanings as list_meanings

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
        ValueError: If they measure different things. The message is a phrase such as `the units m and s`;
            units of the same name have their definitions, as in `N (kg m s-2)`.
    """
    if source is None or target is None or source == target:
        return IDENTITY
    pair = source, target
    undefined = [unit for unit in pair if unit.exponents is None]
    if undefined and source.name == target.name:
        return IDENTITY
    roots = [unit.multiple_of or unit.name for unit in undefined]
    if undefined and (len(undefined) == 1 or roots[0] != roots[1]):
        missing = " and ".join(
            f"{unit} is not defined in {unit.definer or 'its document'}" for unit in undefined
        )
        raise UndefinedUnitError(
            f"the units {source} and {target}: {missing}; add a Unit with its BaseUnit there"
        )
    if not undefined and not source.has_dimension_of(target):
        is_ambiguous = source.name == target.name
        ends = [f"{unit} ({format_powers(unit)})" if is_ambiguous else str(unit) for unit in pair]
        raise ValueError(f"the units {ends[0]} and {ends[1]}")
    offset = 0.0 if source.is_difference or target.is_difference else source.offset - target.offset
    return LinearTransformation(source.factor / target.factor, offset / target.factor)


_TOLERANCE = 1e-4
"""Relative tolerance of equal factors: some are written with few digits."""

_OTHER_MEANINGS = {"T": "t"}
"""Names with a second meaning that documents may give them: T is also a tonne."""


def is_same_factor(factor: float, reference: float) -> bool:
    """Return whether two factors are equal except for the digits with which documents write them."""
    return math.isclose(factor, reference, rel_tol=_TOLERANCE)


def explain_contradiction(unit: SiUnit) -> str | None:
    """Return how the definition of a unit contradicts its name, as a clause; None if it does not.

    A turn is 1 for some tools and 2 pi rad for others.

    Args:
        unit: A unit as a document defines it.
    """
    by_name = find_unit(unit.name)
    if by_name is None or by_name.exponents is None or unit.exponents is None:
        return None
    if not unit.has_dimension_of(by_name):
        alternative = find_unit(_OTHER_MEANINGS.get(unit.name, ""))
        if alternative is not None and unit.has_dimension_of(alternative):
            return None
        return f"the unit {unit} is declared as {format_powers(unit)}, but it is {format_powers(by_name)}"
    turns = unit.exponents[-1] - by_name.exponents[-1]
    powers = (-1, 0, 1) if counts_turns(unit.name) else (0, turns if abs(turns) == 1 else 0)
    if not any(is_same_factor(unit.factor, by_name.factor * (2.0 * math.pi) ** k) for k in powers):
        right = f"{by_name.factor:g} {format_powers(unit)}"
        return f"the unit {unit} has the factor {unit.factor:g}, but its name means {right}"
    if not unit.is_difference and abs(unit.offset - by_name.offset) > _TOLERANCE * abs(by_name.offset):
        return f"the unit {unit} has the offset {unit.offset:g}, but its name means {by_name.offset:g}"
    return None


def list_contradictions(source: SiUnit | None, target: SiUnit | None) -> list[str]:
    """Return the contradictions of units that differ; values in the same unit need no conversion."""
    if source is None or target is None or source == target:
        return []
    return [text for unit in (source, target) if (text := explain_contradiction(unit)) is not None]


def define_display_unit(unit: SiUnit, name: str, factor: float, offset: float) -> SiUnit:
    """Return the unit for the display of another one.

    Args:
        unit: The other unit.
        name: The name of the display unit.
        factor: The displayed value is `factor` times the value, plus `offset`.
        offset: See `factor`.
    """
    scale = unit.factor / factor
    root = unit.name if unit.exponents is None else ""
    return SiUnit(
        name, unit.exponents, scale, unit.offset - scale * offset, multiple_of=root, definer=unit.definer
    )


def format_powers(unit: SiUnit) -> str:
    """Return the exponents of a unit, such as `kg m2 s-2`; 1 without any."""
    powers = (f"{base}{power if power != 1 else ''}" for base, power in unit.powers.items())
    return " ".join(powers) or "1"
