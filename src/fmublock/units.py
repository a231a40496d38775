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

_LONGEST = 100
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

    def measures_as(self, other: "SiUnit") -> bool:
        """Return whether both units are the same except for their names."""
        return replace(self, name="") == replace(other, name="")

    def has_dimension_of(self, other: "SiUnit") -> bool:
        """Return whether both units are defined, with the same exponents except for that of the radian."""
        return self.exponents is not None and self.exponents[:-1] == (other.exponents or ())[:-1]


def _unit(factor: float = 1.0, offset: float = 0.0, is_difference: bool = False, **exponents: int) -> SiUnit:
    return SiUnit("", tuple(exponents.get(base, 0) for base in BASE_UNITS), factor, offset, is_difference)


_COHERENT = {
    "m": _unit(m=1),
    "g": _unit(1e-3, kg=1),
    "s": _unit(s=1),
    "A": _unit(A=1),
    "K": _unit(K=1),
    "mol": _unit(mol=1),
    "cd": _unit(cd=1),
    "rad": _unit(rad=1),
    "N": _unit(kg=1, m=1, s=-2),
    "Nm": _unit(kg=1, m=2, s=-2),
    "Pa": _unit(kg=1, m=-1, s=-2),
    "J": _unit(kg=1, m=2, s=-2),
    "W": _unit(kg=1, m=2, s=-3),
    "VA": _unit(kg=1, m=2, s=-3),
    "Wh": _unit(3600.0, kg=1, m=2, s=-2),
    "Ah": _unit(3600.0, s=1, A=1),
    "V": _unit(kg=1, m=2, s=-3, A=-1),
    "C": _unit(s=1, A=1),
    "F": _unit(kg=-1, m=-2, s=4, A=2),
    "Ohm": _unit(kg=1, m=2, s=-3, A=-2),
    "ohm": _unit(kg=1, m=2, s=-3, A=-2),
    "Ω": _unit(kg=1, m=2, s=-3, A=-2),
    "S": _unit(kg=-1, m=-2, s=3, A=2),
    "H": _unit(kg=1, m=2, s=-2, A=-2),
    "Wb": _unit(kg=1, m=2, s=-2, A=-1),
    "T": _unit(kg=1, s=-2, A=-1),
    "bar": _unit(1e5, kg=1, m=-1, s=-2),
    "l": _unit(1e-3, m=3),
    "L": _unit(1e-3, m=3),
}
"""Units that accept prefixes and have unambiguous symbols."""

_POUND, _GRAVITY = 0.45359237, 9.80665
_TURN, _YEAR = 2 * math.pi, 365.25 * 86400.0

_ALONE = {
    "Hz": _unit(s=-1),
    "kHz": _unit(1e3, s=-1),
    "MHz": _unit(1e6, s=-1),
    "rpm": _unit(_TURN / 60, s=-1, rad=1),
    "RPM": _unit(_TURN / 60, s=-1, rad=1),
    "U/min": _unit(_TURN / 60, s=-1, rad=1),
    "krpm": _unit(1000 * _TURN / 60, s=-1, rad=1),
    "kRPM": _unit(1000 * _TURN / 60, s=-1, rad=1),
    "rev": _unit(_TURN, rad=1),
    "cycle": _unit(),
    "cycles": _unit(),
    "deg": _unit(math.pi / 180, rad=1),
    "°": _unit(math.pi / 180, rad=1),
    "Grad": _unit(math.pi / 180, rad=1),
    "arcmin": _unit(math.pi / 180 / 60, rad=1),
    "arcsec": _unit(math.pi / 180 / 3600, rad=1),
    "sec": _unit(s=1),
    "msec": _unit(1e-3, s=1),
    "min": _unit(60.0, s=1),
    "h": _unit(3600.0, s=1),
    "d": _unit(86400.0, s=1),
    "a": _unit(_YEAR, s=1),
    "yr": _unit(_YEAR, s=1),
    "year": _unit(_YEAR, s=1),
    "years": _unit(_YEAR, s=1),
    "%": _unit(1e-2),
    "ppm": _unit(1e-6),
    "degC": _unit(1.0, 273.15, K=1),
    "°C": _unit(1.0, 273.15, K=1),
    "degF": _unit(5 / 9, 273.15 - 32 * 5 / 9, K=1),
    "°F": _unit(5 / 9, 273.15 - 32 * 5 / 9, K=1),
    "delta_K": _unit(K=1, is_difference=True),
    "delta_degC": _unit(K=1, is_difference=True),
    "delta_degF": _unit(5 / 9, K=1, is_difference=True),
    "in": _unit(0.0254, m=1),
    "inch": _unit(0.0254, m=1),
    "ft": _unit(0.3048, m=1),
    "t": _unit(1e3, kg=1),
    "lbm": _unit(_POUND, kg=1),
    "ozm": _unit(_POUND / 16, kg=1),
    "Ncm": _unit(1e-2, kg=1, m=2, s=-2),
    "Nmm": _unit(1e-3, kg=1, m=2, s=-2),
    "lbf": _unit(_POUND * _GRAVITY, kg=1, m=1, s=-2),
    "ozf": _unit(_POUND * _GRAVITY / 16, kg=1, m=1, s=-2),
    "gf": _unit(1e-3 * _GRAVITY, kg=1, m=1, s=-2),
    "kgf": _unit(_GRAVITY, kg=1, m=1, s=-2),
    "kp": _unit(_GRAVITY, kg=1, m=1, s=-2),
    "psi": _unit(_POUND * _GRAVITY / 0.0254**2, kg=1, m=-1, s=-2),
    "hp": _unit(550 * 0.3048 * _POUND * _GRAVITY, kg=1, m=2, s=-3),
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
    return None if name in _AMBIGUOUS else _read(name)


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
    found = _read(name)
    if found is None or (found.factor, found.offset) != (1.0, 0.0) or name.count("/") > 1:
        raise ValueError(f"'{name}' is not a product of coherent SI units")
    return found


def counts_turns(name: str) -> bool:
    """Return whether the name contains a turn, which is 1 for some tools and 2 pi rad for others."""
    return any(word in _TURNS for word in _WORD.findall(name))


def _read(name: str) -> SiUnit | None:
    if name in _ALONE:
        return replace(_ALONE[name], name=name)
    if len(name) > _LONGEST:
        return None
    try:
        tokens = _tokens(name)
        found = _expression(tokens)
    except (_UnknownNameError, OverflowError, ZeroDivisionError):
        return None
    whole = not tokens and math.isfinite(found.factor) and found.factor
    return replace(found, name=name) if whole else None


class _UnknownNameError(Exception):
    pass


def _tokens(name: str) -> list[str]:
    """Split a name into its parts, in reverse order."""
    parts = _TOKEN.findall(name)
    if "".join(parts) != name:
        raise _UnknownNameError(name)
    return parts[::-1]


def _expression(tokens: list[str]) -> SiUnit:
    """Parse a numerator, and at most one denominator."""
    if tokens and tokens[-1] == "1":
        tokens.pop()
        found = _unit()
    else:
        found = _factor(tokens)
        while tokens and tokens[-1] in (".", "*"):
            tokens.pop()
            found = _times(found, _factor(tokens))
    if tokens and tokens[-1] == "/":
        tokens.pop()
        found = _times(found, _factor(tokens), -1)
    return found


def _factor(tokens: list[str]) -> SiUnit:
    if not tokens:
        raise _UnknownNameError
    token = tokens.pop()
    if token == "(":
        found = _expression(tokens)
        if not tokens or tokens.pop() != ")":
            raise _UnknownNameError
    else:
        found = _symbol(token)
    if tokens and (power := _EXPONENT.fullmatch(tokens[-1])):
        tokens.pop()
        return _times(_unit(), found, int(power[1]))
    return found


def _times(one: SiUnit, other: SiUnit, power: int = 1) -> SiUnit:
    """Multiply a unit by a power of another; the product has no offset, as it measures differences."""
    pairs = zip(one.exponents or (), other.exponents or (), strict=True)
    exponents = tuple(mine + power * theirs for mine, theirs in pairs)
    return SiUnit("", exponents, one.factor * other.factor**power)


def _symbol(symbol: str) -> SiUnit:
    """Parse a symbol with or without a prefix, without offset: a part of a unit measures differences."""
    if symbol in _COHERENT:
        return _COHERENT[symbol]
    if symbol in _ALONE:
        return replace(_ALONE[symbol], offset=0.0)
    found = [
        replace(_COHERENT[rest], factor=factor * _COHERENT[rest].factor)
        for prefix, factor in _PREFIXES.items()
        if symbol.startswith(prefix) and (rest := symbol.removeprefix(prefix)) in _COHERENT
    ]
    if len(found) != 1:
        raise _UnknownNameError(symbol)
    return found[0]


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
