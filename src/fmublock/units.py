"""Units of measurement: their base units, the table of their names, and the parser for names.

The grammar is that of Modelica 3.6, 19.1: `kg.m2/s`, `mm`, `kN`. FMI 2.0 does not standardize names, so only
unambiguous names are accepted.
"""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache

BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
"""SI base units in the order of `SiUnit.exponents`; the radian counts as one, as in FMI and SSP."""

_MAX_LENGTH = 100
_TOKEN = re.compile(r"([./()*]|\^?[+-]?[0-9]{1,2}(?![0-9])|(?:delta_|°)?[^\W\d_]+|[°%])")
_EXPONENT = re.compile(r"\^?([+-]?[0-9]{1,2})")
_WORD = re.compile(r"[^\W\d_]+")


@dataclass(frozen=True)
class SiUnit:
    """Unit with its name; a value in SI base units is factor * value + offset.

    Attributes:
        name: name such as "N.m/rad".
        exponents: exponents of the SI base units in the order of `BASE_UNITS`; None for an undefined unit.
        factor: factor to SI base units.
        offset: offset in SI base units.
        is_difference: whether values are differences, which convert without offset.
        multiple_of: the undefined unit of which this one is a multiple, such as EUR of kEUR.
        definer: the list in which a document must define it, for error messages.
        alternatives: other units of its document by name, in which users can write values.
    """

    name: str
    exponents: tuple[int, ...] | None = None
    factor: float = 1.0
    offset: float = 0.0
    is_difference: bool = field(default=False, compare=False)
    multiple_of: str = ""
    definer: str = field(default="", compare=False)
    alternatives: Mapping[str, "SiUnit"] = field(default_factory=dict, compare=False, repr=False)

    def __str__(self) -> str:
        return self.name

    @property
    def powers(self) -> dict[str, int]:
        """Exponents other than 0 by base unit, as in modelDescription.xml."""
        pairs = zip(BASE_UNITS, self.exponents or (), strict=False)
        return {base: exponent for base, exponent in pairs if exponent}

    def measures_as(self, unit: "SiUnit") -> bool:
        """Return whether both units are the same except for their names."""
        return replace(self, name="") == replace(unit, name="")

    def has_dimension_of(self, unit: "SiUnit") -> bool:
        """Return whether both units are defined, with the same exponents except for that of the radian."""
        return self.exponents is not None and self.exponents[:-1] == (unit.exponents or ())[:-1]


def _make_unit(
    factor: float = 1.0, offset: float = 0.0, is_difference: bool = False, **exponents: int
) -> SiUnit:
    return SiUnit("", tuple(exponents.get(base, 0) for base in BASE_UNITS), factor, offset, is_difference)


_PREFIXABLE = {
    "m": _make_unit(m=1),
    "g": _make_unit(1e-3, kg=1),
    "s": _make_unit(s=1),
    "A": _make_unit(A=1),
    "K": _make_unit(K=1),
    "mol": _make_unit(mol=1),
    "cd": _make_unit(cd=1),
    "rad": _make_unit(rad=1),
    "N": _make_unit(kg=1, m=1, s=-2),
    "Nm": _make_unit(kg=1, m=2, s=-2),
    "Pa": _make_unit(kg=1, m=-1, s=-2),
    "J": _make_unit(kg=1, m=2, s=-2),
    "W": _make_unit(kg=1, m=2, s=-3),
    "VA": _make_unit(kg=1, m=2, s=-3),
    "Wh": _make_unit(3600.0, kg=1, m=2, s=-2),
    "Ah": _make_unit(3600.0, s=1, A=1),
    "V": _make_unit(kg=1, m=2, s=-3, A=-1),
    "C": _make_unit(s=1, A=1),
    "F": _make_unit(kg=-1, m=-2, s=4, A=2),
    "Ohm": _make_unit(kg=1, m=2, s=-3, A=-2),
    "ohm": _make_unit(kg=1, m=2, s=-3, A=-2),
    "Ω": _make_unit(kg=1, m=2, s=-3, A=-2),
    "S": _make_unit(kg=-1, m=-2, s=3, A=2),
    "H": _make_unit(kg=1, m=2, s=-2, A=-2),
    "Wb": _make_unit(kg=1, m=2, s=-2, A=-1),
    "T": _make_unit(kg=1, s=-2, A=-1),
    "bar": _make_unit(1e5, kg=1, m=-1, s=-2),
    "l": _make_unit(1e-3, m=3),
    "L": _make_unit(1e-3, m=3),
}
"""Units that accept prefixes and have unambiguous symbols."""

_POUND, _GRAVITY = 0.45359237, 9.80665
_FULL_TURN, _YEAR = 2 * math.pi, 365.25 * 86400.0

_NOT_PREFIXABLE = {
    "Hz": _make_unit(s=-1),
    "kHz": _make_unit(1e3, s=-1),
    "MHz": _make_unit(1e6, s=-1),
    "rpm": _make_unit(_FULL_TURN / 60, s=-1, rad=1),
    "RPM": _make_unit(_FULL_TURN / 60, s=-1, rad=1),
    "U/min": _make_unit(_FULL_TURN / 60, s=-1, rad=1),
    "krpm": _make_unit(1000 * _FULL_TURN / 60, s=-1, rad=1),
    "kRPM": _make_unit(1000 * _FULL_TURN / 60, s=-1, rad=1),
    "rev": _make_unit(_FULL_TURN, rad=1),
    "cycle": _make_unit(),
    "cycles": _make_unit(),
    "deg": _make_unit(math.pi / 180, rad=1),
    "°": _make_unit(math.pi / 180, rad=1),
    "Grad": _make_unit(math.pi / 180, rad=1),
    "arcmin": _make_unit(math.pi / 180 / 60, rad=1),
    "arcsec": _make_unit(math.pi / 180 / 3600, rad=1),
    "sec": _make_unit(s=1),
    "msec": _make_unit(1e-3, s=1),
    "min": _make_unit(60.0, s=1),
    "h": _make_unit(3600.0, s=1),
    "d": _make_unit(86400.0, s=1),
    "a": _make_unit(_YEAR, s=1),
    "yr": _make_unit(_YEAR, s=1),
    "year": _make_unit(_YEAR, s=1),
    "years": _make_unit(_YEAR, s=1),
    "%": _make_unit(1e-2),
    "ppm": _make_unit(1e-6),
    "degC": _make_unit(1.0, 273.15, K=1),
    "°C": _make_unit(1.0, 273.15, K=1),
    "degF": _make_unit(5 / 9, 273.15 - 32 * 5 / 9, K=1),
    "°F": _make_unit(5 / 9, 273.15 - 32 * 5 / 9, K=1),
    "delta_K": _make_unit(K=1, is_difference=True),
    "delta_degC": _make_unit(K=1, is_difference=True),
    "delta_degF": _make_unit(5 / 9, K=1, is_difference=True),
    "in": _make_unit(0.0254, m=1),
    "inch": _make_unit(0.0254, m=1),
    "ft": _make_unit(0.3048, m=1),
    "t": _make_unit(1e3, kg=1),
    "lbm": _make_unit(_POUND, kg=1),
    "ozm": _make_unit(_POUND / 16, kg=1),
    "Ncm": _make_unit(1e-2, kg=1, m=2, s=-2),
    "Nmm": _make_unit(1e-3, kg=1, m=2, s=-2),
    "lbf": _make_unit(_POUND * _GRAVITY, kg=1, m=1, s=-2),
    "ozf": _make_unit(_POUND * _GRAVITY / 16, kg=1, m=1, s=-2),
    "gf": _make_unit(1e-3 * _GRAVITY, kg=1, m=1, s=-2),
    "kgf": _make_unit(_GRAVITY, kg=1, m=1, s=-2),
    "kp": _make_unit(_GRAVITY, kg=1, m=1, s=-2),
    "psi": _make_unit(_POUND * _GRAVITY / 0.0254**2, kg=1, m=-1, s=-2),
    "hp": _make_unit(550 * 0.3048 * _POUND * _GRAVITY, kg=1, m=2, s=-3),
}
"""Units that accept no prefixes; `Grad` is a degree in German, not 10^9 rad.

Pound and ounce are exact (1959), hp is 550 ft.lbf/s, a year has 365.25 days. A cycle is a number, no angle.
"""

MASS_OR_FORCE = {"lb": ("lbm", "lbf"), "lbs": ("lbm", "lbf"), "oz": ("ozm", "ozf")}
"""Names that are a mass or a force, and the unambiguous names of both."""

_PREFIXES = {
    "T": 1e12,
    "G": 1e9,
    "M": 1e6,
    "k": 1e3,
    "h": 1e2,
    "da": 1e1,
    "d": 1e-1,
    "c": 1e-2,
    "m": 1e-3,
    "u": 1e-6,
    "µ": 1e-6,
    "μ": 1e-6,
    "n": 1e-9,
    "p": 1e-12,
}
_AMBIGUOUS = {"C", "F", "g", "dT", "cd"}
"""Ambiguous names: `C` is often a temperature, and `g` an acceleration."""
_TURNS = ("Hz", "kHz", "MHz", "rpm", "krpm", "rev")


@lru_cache(1024)
def find_unit(name: str) -> SiUnit | None:
    """Return the unit of this name; None if the name is unknown or ambiguous."""
    return None if name in _AMBIGUOUS else _parse(name)


def list_meanings(name: str) -> list[str]:
    """Return the name with `lb` and `oz` as masses and as forces; nothing for a name without them."""
    if not any(word in MASS_OR_FORCE for word in _WORD.findall(name)):
        return []
    parts = [MASS_OR_FORCE.get(part, (part, part)) for part in re.split(r"([^\W\d_]+)", name)]
    return ["".join(meanings) for meanings in zip(*parts, strict=True)]


def parse_unit(name: str) -> SiUnit:
    """Return the coherent SI unit of this name, with one "/" at most: "m/s2", "N.m.s/rad", "1/s".

    Raises:
        ValueError: The name is anything else.
    """
    unit = _parse(name)
    if unit is None or (unit.factor, unit.offset) != (1.0, 0.0) or name.count("/") > 1:
        raise ValueError(f"'{name}' is not a product of coherent SI units")
    return unit


def counts_turns(name: str) -> bool:
    """Return whether the name contains a turn, which is 1 for some tools and 2 pi rad for others."""
    return any(word in _TURNS for word in _WORD.findall(name))


def _parse(name: str) -> SiUnit | None:
    if name in _NOT_PREFIXABLE:
        return replace(_NOT_PREFIXABLE[name], name=name)
    if len(name) > _MAX_LENGTH:
        return None
    try:
        tokens = _split_name(name)
        unit = _parse_expression(tokens)
    except (_UnknownNameError, OverflowError, ZeroDivisionError):
        return None
    is_complete = not tokens and math.isfinite(unit.factor) and unit.factor
    return replace(unit, name=name) if is_complete else None


class _UnknownNameError(Exception):
    pass


def _split_name(name: str) -> list[str]:
    """Split a name into its parts, in reverse order."""
    parts = _TOKEN.findall(name)
    if "".join(parts) != name:
        raise _UnknownNameError(name)
    return parts[::-1]


def _parse_expression(tokens: list[str]) -> SiUnit:
    """Parse a numerator, and at most one denominator."""
    if tokens and tokens[-1] == "1":
        tokens.pop()
        unit = _make_unit()
    else:
        unit = _parse_factor(tokens)
        while tokens and tokens[-1] in (".", "*"):
            tokens.pop()
            unit = _multiply(unit, _parse_factor(tokens))
    if tokens and tokens[-1] == "/":
        tokens.pop()
        unit = _multiply(unit, _parse_factor(tokens), -1)
    return unit


def _parse_factor(tokens: list[str]) -> SiUnit:
    if not tokens:
        raise _UnknownNameError
    token = tokens.pop()
    if token == "(":
        unit = _parse_expression(tokens)
        if not tokens or tokens.pop() != ")":
            raise _UnknownNameError
    else:
        unit = _parse_symbol(token)
    if tokens and (power := _EXPONENT.fullmatch(tokens[-1])):
        tokens.pop()
        return _multiply(_make_unit(), unit, int(power[1]))
    return unit


def _multiply(first: SiUnit, second: SiUnit, power: int = 1) -> SiUnit:
    """Multiply a unit by a power of another; the product has no offset, as it measures differences."""
    pairs = zip(first.exponents or (), second.exponents or (), strict=True)
    exponents = tuple(a + power * b for a, b in pairs)
    return SiUnit("", exponents, first.factor * second.factor**power)


def _parse_symbol(symbol: str) -> SiUnit:
    """Parse a symbol with or without a prefix, without offset: a part of a unit measures differences."""
    if symbol in _PREFIXABLE:
        return _PREFIXABLE[symbol]
    if symbol in _NOT_PREFIXABLE:
        return replace(_NOT_PREFIXABLE[symbol], offset=0.0)
    units = [
        replace(_PREFIXABLE[name], factor=factor * _PREFIXABLE[name].factor)
        for prefix, factor in _PREFIXES.items()
        if symbol.startswith(prefix) and (name := symbol.removeprefix(prefix)) in _PREFIXABLE
    ]
    if len(units) != 1:
        raise _UnknownNameError(symbol)
    return units[0]


@dataclass(frozen=True)
class QuantityKind:
    """What a unit measures: its name in ISO 80000, and the unit for display.

    A value in SI units times `factor` is the value in the display unit.
    """

    name: str
    display_unit: str | None = None
    factor: float = 1.0


QUANTITIES = {
    "m": QuantityKind("Length", "mm", 1e3),
    "m/s": QuantityKind("Velocity", "mm/s", 1e3),
    "m/s2": QuantityKind("Acceleration"),
    "rad": QuantityKind("Angle", "deg", 180.0 / math.pi),
    "rad/s": QuantityKind("AngularVelocity", "rpm", 30.0 / math.pi),
    "s": QuantityKind("Time"),
    "kg": QuantityKind("Mass"),
    "kg.m2": QuantityKind("MomentOfInertia"),
    "N": QuantityKind("Force", "kN", 1e-3),
    "N.m": QuantityKind("Torque"),
    "W": QuantityKind("Power", "kW", 1e-3),
    "V": QuantityKind("ElectricPotential"),
    "A": QuantityKind("ElectricCurrent"),
    "Ohm": QuantityKind("Resistance"),
    "H": QuantityKind("Inductance", "mH", 1e3),
    "Wb": QuantityKind("MagneticFlux", "mWb", 1e3),
}
"""Units that measure one kind of quantity; for others (1/s, kg.m), the variable's description says it."""
