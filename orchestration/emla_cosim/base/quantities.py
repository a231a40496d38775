"""Quantities as users write them: a number and the name of a unit, such as "30 kN" or "12,5 kg cm^2"."""

import math
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, replace
from decimal import Decimal

from .errors import CommandError
from .faults import note_fault
from .units import (
    IDENTITY,
    LinearTransformation,
    SiUnit,
    UndefinedUnitError,
    find_conversion,
    find_unit,
    list_contradictions,
    list_meanings,
    read_turns,
)

_QUANTITY = re.compile(
    r"\s*(?P<number>[+-]?(?:[0-9]+(?:[.,][0-9]+|\.)?|[.,][0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"\s*(?P<unit>[^\s,].*?)?\s*"
)
_THOUSANDS = re.compile(r"[+-]?[1-9][0-9]{0,2},[0-9]{3}")
"""A number whose comma may separate thousands."""

_SPELLINGS = (
    (re.compile(r"\s*/\s*"), "/"),
    (re.compile(r"\b(k?g)(c?m)(?=\^?2)"), r"\1.\2"),  # kgcm2
    (re.compile(r"(?<=[^\W\d_])-(?=[^\W\d_])"), "."),  # oz-in
    (re.compile(r"\s*[·⋅×]\s*|(?<=[^\W_])\s+(?=[^\W\d_])"), "."),
)
"""How users write products and quotients, and what `find_unit` reads."""


@dataclass(frozen=True)
class Quantity:
    """A number and its unit; None without a unit."""

    number: float
    unit: SiUnit | None = None

    @property
    def si_number(self) -> float:
        """The number in SI units."""
        return self.number if self.unit is None else self.unit.factor * self.number + self.unit.offset

    def in_unit(self, unit: SiUnit | None, label: str) -> float:
        """Return the number in another unit; a number without a unit is already in it.

        Args:
            unit: The unit to convert to.
            label: What error messages call the quantity.

        Raises:
            CommandError: If the units measure different things.
        """
        conversion = resolve_conversion(self.unit, unit, label)
        power = round(math.log10(abs(conversion.factor)))
        if conversion.offset or not math.isclose(conversion.factor, 10.0**power, rel_tol=1e-15):
            return conversion(self.number)
        return float(Decimal(repr(self.number)).scaleb(power))  # only shifts the point: no digit changes


def resolve_conversion(unit: SiUnit | None, target: SiUnit | None, label: str) -> LinearTransformation:
    """Return the conversion of a unit that a user wrote to that of a variable.

    Args:
        unit: The unit; None if the numbers are in the target's unit.
        target: The unit to convert to; None leaves the numbers as they are.
        label: What messages call the quantity.

    Raises:
        CommandError: If the units measure different things, or only one is of a difference of temperatures.
    """
    if unit is None or target is None:
        return IDENTITY
    written = read_turns(unit, target)
    if unit.is_difference and not target.is_difference and target.powers == {"K": 1}:
        raise CommandError(f"{label} is a difference, but must be a temperature; write it in degC or K.")
    contradictions = list_contradictions(written, target)
    try:
        conversion = find_conversion(written, target)
    except UndefinedUnitError as error:
        raise CommandError(f"{label} has {error}.") from error
    except ValueError as error:
        reason = "".join(f": {text}" for text in contradictions)
        raise CommandError(
            f"{label} has {error}, which cannot be converted into each other{reason}."
        ) from error
    note_fault(label, *(f"{text}; it is converted as declared" for text in contradictions))
    return conversion


def has_unit(value: object) -> bool:
    """Return whether a value is a text that only `parse_quantity` reads: with a unit or a decimal comma."""
    if not isinstance(value, str) or (match := _QUANTITY.fullmatch(value)) is None:
        return False
    if match["unit"] is None:
        return "," in value
    try:
        float(value)  # such as 1_000, which Python reads
    except ValueError:
        return True
    return False


def split_quantity(text: str, label: str) -> tuple[float, str]:
    """Return the number of a text, and the rest, which is not checked.

    Args:
        text: The text.
        label: What error messages call it.

    Raises:
        CommandError: If the text does not begin with a number, or its comma is ambiguous.
    """
    match = _QUANTITY.fullmatch(text)
    if match is None:
        raise CommandError(f"{label} is '{text}'; it must be a number, or a number and a unit such as 30 kN.")
    number, unit = match["number"], match["unit"] or ""
    if _THOUSANDS.fullmatch(number):
        readings = (f"'{number.replace(',', sign)}{unit and ' '}{unit}'" for sign in (".", ""))
        raise CommandError(f"{label} is '{text}', which has two meanings; write {' or '.join(readings)}.")
    return float(number.replace(",", ".")), unit


def parse_unit_name(name: str, label: str, target: SiUnit | None = None) -> SiUnit:
    """Return the unit that a user writes as `kg cm^2`, `N·m/A`, `min⁻¹` or `kg.cm2`.

    Args:
        name: The name of the unit.
        label: What error messages call the place of the name.
        target: The unit to convert to. Its own name and its alternatives are known; these have precedence
            if they can be converted. It decides whether `lb` and `oz` are masses or forces.

    Raises:
        CommandError: If the name is not that of a unit, or `lb` or `oz` may be a mass and a force.
    """
    name = name.strip()
    if target is not None and name == target.name:
        return target
    defined = None if target is None else target.alternatives.get(name)
    if defined is not None and target is not None and _is_convertible(defined, target):
        return defined
    # data sheets have signs such as ², ⁻¹ and the minus of mathematics
    written = unicodedata.normalize("NFKC", name).replace("−", "-")
    for pattern, standard in _SPELLINGS:
        written = pattern.sub(standard, written)
    unit = find_unit(written) or _find_mass_or_force(written, name, label, target)
    if unit is not None:
        return replace(unit, name=name)
    if defined is not None:
        return defined  # the conversion is refused
    units = () if target is None else target.alternatives.items()
    alike = [n for n, u in units if target is not None and _is_convertible(u, target)]
    of_fmu = f" The FMU defines {', '.join(alike[:4])}." if alike else ""
    raise CommandError(
        f"{label} has the unknown unit '{name}'; write a unit such as kN, mm/s, N.m or kg.cm2.{of_fmu}",
        unit=name,
    )


def _find_mass_or_force(written: str, name: str, label: str, target: SiUnit | None) -> SiUnit | None:
    """Return the unit of a name with `lb` or `oz`, None for other names; CommandError if it is ambiguous."""
    meanings = list_meanings(written)
    candidates = [u for u in map(find_unit, meanings) if u is not None]
    for unit in candidates:
        if target is not None and unit.has_dimension_of(target):
            return unit
    if meanings and len(candidates) == len(meanings):
        raise CommandError(
            f"{label} has the unit '{name}', which is a mass or a force; write {' or '.join(meanings)}.",
            unit=name,
        )
    return None


def _is_convertible(unit: SiUnit, target: SiUnit) -> bool:
    try:
        find_conversion(unit, target)
    except ValueError:
        return False
    return True


def parse_quantity(text: str, label: str, target: SiUnit | None = None) -> Quantity:
    """Parse a quantity, such as "30 kN", "-3.4e3 N", "0,5 mm" or "0.2".

    Args:
        text: The text.
        label: What error messages call the quantity.
        target: The unit to convert to, see `parse_unit_name`.

    Raises:
        CommandError: If it is not a number with or without a unit, or the unit is unknown.
    """
    number, unit = split_quantity(text, label)
    return Quantity(number, parse_unit_name(unit, label, target) if unit else None)


def read_quantity(text: str, label: str, target: SiUnit | str | None, readings: Sequence[str] = ()) -> float:
    """Return the number of a text in a unit.

    Args:
        text: The text, such as "30 kN". A number without a unit is in the unit `target`.
        label: What error messages call the quantity.
        target: The unit, or its name; None if the quantity takes no unit.
        readings: Units in which users may think of it. With them, a number without a unit is refused.

    Raises:
        CommandError: If the text cannot be read, or has no unit that can be converted.
    """
    unit = parse_unit_name(target, label) if isinstance(target, str) else target
    _, name = split_quantity(text, label)
    if not name and readings:
        written = text.strip()
        examples = " or ".join(f"'{written} {reading}'" for reading in readings)
        raise CommandError(f"{label} {written} has no unit; write {examples}.")
    if name and unit is None:
        raise CommandError(f"{label} has a unit, but takes none; write a plain number.")
    return parse_quantity(text, label, unit).in_unit(unit, label)
