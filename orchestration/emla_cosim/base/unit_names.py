"""What a unit is, by its name: `kg.m2/s`, `mm`, `kN` (the grammar of Modelica 3.6, 19.1).

Names are not standardized in FMI 2.0, so that only names that can mean one thing are understood.
"""

import math
import re
from dataclasses import dataclass

from .units import BASE_UNITS

_LONGEST = 100
_TOKEN = re.compile(r"([./()*]|\^?[+-]?[0-9]{1,2}(?![0-9])|[^\W\d_]+|[°%])")
_EXPONENT = re.compile(r"\^?([+-]?[0-9]{1,2})")


@dataclass(frozen=True)
class Meaning:
    """Exponents of `BASE_UNITS`, and what one of the unit is in them; `offset` only of a unit alone."""

    exponents: tuple[int, ...] = (0,) * len(BASE_UNITS)
    factor: float = 1.0
    offset: float = 0.0

    def times(self, other: "Meaning", power: int = 1) -> "Meaning":
        """The product of this and a power of the other."""
        exponents = tuple(
            mine + power * theirs for mine, theirs in zip(self.exponents, other.exponents, strict=True)
        )
        return Meaning(exponents, self.factor * other.factor**power)


def _unit(factor: float = 1.0, offset: float = 0.0, **exponents: int) -> Meaning:
    return Meaning(tuple(exponents.get(base, 0) for base in BASE_UNITS), factor, offset)


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
    "Pa": _unit(kg=1, m=-1, s=-2),
    "J": _unit(kg=1, m=2, s=-2),
    "W": _unit(kg=1, m=2, s=-3),
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
"""Units that take prefixes, with symbols of one meaning."""

_ALONE = {
    "Hz": _unit(s=-1),
    "kHz": _unit(1e3, s=-1),
    "MHz": _unit(1e6, s=-1),
    "rpm": _unit(2 * math.pi / 60, s=-1, rad=1),
    "krpm": _unit(2000 * math.pi / 60, s=-1, rad=1),
    "rev": _unit(2 * math.pi, rad=1),
    "deg": _unit(math.pi / 180, rad=1),
    "°": _unit(math.pi / 180, rad=1),
    "min": _unit(60.0, s=1),
    "h": _unit(3600.0, s=1),
    "d": _unit(86400.0, s=1),
    "%": _unit(1e-2),
    "degC": _unit(1.0, 273.15, K=1),
    "°C": _unit(1.0, 273.15, K=1),
    "degF": _unit(5 / 9, 273.15 - 32 * 5 / 9, K=1),
    "°F": _unit(5 / 9, 273.15 - 32 * 5 / 9, K=1),
}
"""Units that take none."""

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
    "n": 1e-9,
    "p": 1e-12,
}
_AMBIGUOUS = {"C", "F", "g", "dT", "cd"}
"""Names that people use for something else too: `C` often is a temperature, and `g` an acceleration."""
_TURNS = ("Hz", "kHz", "MHz", "rpm", "krpm", "rev")


def meaning(name: str) -> Meaning | None:
    """What a unit of this name is; None where the name does not say it, or may say two things."""
    if name in _ALONE:
        return _ALONE[name]
    if name in _AMBIGUOUS or len(name) > _LONGEST:
        return None
    try:
        tokens = _tokens(name)
        found = _expression(tokens)
        return found if not tokens and math.isfinite(found.factor) and found.factor else None
    except (_UnknownNameError, OverflowError, ZeroDivisionError):
        return None


def counts_turns(name: str) -> bool:
    """Whether something in the name counts turns, which some give as 1 and some as 2 pi rad."""
    return any(word in _TURNS for word in re.findall(r"[^\W\d_]+", name))


class _UnknownNameError(Exception):
    pass


def _tokens(name: str) -> list[str]:
    """The parts of a name, the first one last."""
    parts = _TOKEN.findall(name)
    if "".join(parts) != name:
        raise _UnknownNameError(name)
    return parts[::-1]


def _expression(tokens: list[str]) -> Meaning:
    """Numerator, and at most one denominator."""
    if tokens and tokens[-1] == "1":
        tokens.pop()
        found = Meaning()
    else:
        found = _factor(tokens)
        while tokens and tokens[-1] in (".", "*"):
            tokens.pop()
            found = found.times(_factor(tokens))
    if tokens and tokens[-1] == "/":
        tokens.pop()
        found = found.times(_factor(tokens), -1)
    return found


def _factor(tokens: list[str]) -> Meaning:
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
        return Meaning().times(found, int(power[1]))
    return found


def _symbol(symbol: str) -> Meaning:
    """A symbol with or without a prefix; an offset is lost, as a part of a unit measures differences."""
    if symbol in _COHERENT:
        return _COHERENT[symbol]
    if symbol in _ALONE:
        return Meaning(_ALONE[symbol].exponents, _ALONE[symbol].factor)
    found = [
        Meaning(_COHERENT[rest].exponents, factor * _COHERENT[rest].factor)
        for prefix, factor in _PREFIXES.items()
        if symbol.startswith(prefix) and (rest := symbol.removeprefix(prefix)) in _COHERENT
    ]
    if len(found) != 1:
        raise _UnknownNameError(symbol)
    return found[0]
