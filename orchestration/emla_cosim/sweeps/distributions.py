"""Parse distributions of plans and of the command line."""

import difflib
import re
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, fields
from typing import Any, NoReturn

from ..base.errors import CommandError, join_names
from ..base.table_entries import unknown_entry
from ..system.model import Value
from .kinds.continuous import LogNormal, LogUniform, Normal, Triangular, Uniform
from .kinds.discrete import Integers, ValueList
from .kinds.distribution import Distribution

__all__ = ["DISTRIBUTIONS", "FORMS", "Distribution", "parse", "parse_distribution"]

DISTRIBUTIONS: dict[str, type[Distribution]] = {
    kind.name: kind for kind in (Uniform, LogUniform, Normal, LogNormal, Triangular, ValueList, Integers)
}
"""Kinds of distributions by their names in plans."""

FORMS = "LOW:HIGH, LOW:HIGH:N, A,B,C, ±10%, 80%:120% and NAME(...) such as normal(0.14, 0.01)"
"""The short forms, for messages. Values may have units, such as 1 mm:5 mm:5."""

_NUMBER = re.compile(
    r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?|[+-]?(nan|inf|infinity)", re.IGNORECASE
)
_WHOLE = re.compile(r"[+-]?[0-9]{1,30}")
_NAMED = re.compile(r"([\w-]+)\s*\((.*)\)", re.DOTALL)
_WORDS: dict[str, Value] = {"true": True, "false": False}


def parse_distribution(value: Any, where: str) -> Distribution:
    """Read the distribution of a factor from a plan.

    Args:
        value: A table with `distribution` (the name) and its fields, a list of values, a text in a short
            form (see `parse`), a number, a Boolean, or a distribution.
        where: Name of the factor in messages.

    Raises:
        CommandError: The value is anything else.
    """
    if isinstance(value, Distribution):
        return value
    if isinstance(value, str):
        return parse(value, where)
    try:
        return _read(value)
    except CommandError as error:
        raise CommandError(f"{where}: {error}", **error.fields) from None


def parse(text: str, where: str) -> Distribution:
    """Parse a distribution in a short form of the command line.

    - LOW:HIGH is uniform. LOW:HIGH:N has N levels in a grid.
    - A,B,C, or a single A, are values: numbers, true, false or texts.
    - NAME(...) has the fields of that kind in their order or as name=value.
    - Percentages are of the nominal value: 80%:120%, 80%:120%:N, 90%,110%, or ±10% (also +-10%), which is
      uniform from 90 % to 110 %.

    Texts with commas, colons or parentheses must be in a list.

    Raises:
        CommandError: The text has no such form. `where` names the factor.
    """
    try:
        return _parse(text.strip())
    except CommandError as error:
        raise CommandError(f"{where}: {error}", **error.fields) from None


def _read(value: Any) -> Distribution:
    if hasattr(value, "tolist"):
        value = value.tolist()  # NumPy
    if isinstance(value, Mapping):
        return _parse_table(value)
    if isinstance(value, (bool, int, float)):
        return ValueList((value,))
    if isinstance(value, Sequence) and not isinstance(value, (str, bytes)):
        return ValueList(value)
    raise CommandError(
        f"what varies is {value!r}; it must be a list of values, a text such as '0.1:0.3', or a table "
        'such as { distribution = "normal", mean = 0.14, deviation = 0.01 }.',
        value=value,
    )


def _parse_table(table: Mapping[str, Any]) -> Distribution:
    if "distribution" not in table:
        raise CommandError(
            f"the table has no distribution; write distribution = one of {join_names(DISTRIBUTIONS)}.",
            choices=list(DISTRIBUTIONS),
        )
    kind = _kind(table["distribution"])
    return _make_distribution(kind, {key: value for key, value in table.items() if key != "distribution"})


def _kind(name: Any) -> type[Distribution]:
    if isinstance(name, str) and name in DISTRIBUTIONS:
        return DISTRIBUTIONS[name]
    near = difflib.get_close_matches(str(name), DISTRIBUTIONS, n=1)
    meant = f"did you mean '{near[0]}'?" if near else f"choose from {join_names(DISTRIBUTIONS)}."
    raise CommandError(f"there is no distribution '{name}'; {meant}", name=name, choices=list(DISTRIBUTIONS))


def _make_distribution(kind: type[Distribution], given: Mapping[str, Any]) -> Distribution:
    """Create a distribution from unchecked fields."""
    known = [*list_positional_fields(kind), "relative"]
    for key in given:
        if key not in known:
            raise unknown_entry(kind.noun, key, known)
    needed = [f.name for f in fields(kind) if f.default is MISSING]
    if any(name not in given for name in needed):
        raise CommandError(f"{kind.noun} needs {join_names(needed)}.", needed=needed)
    return kind(**given)


def list_positional_fields(kind: type[Distribution]) -> list[str]:
    """Return the fields of a kind in the order of its short form."""
    return [f.name for f in fields(kind) if not f.kw_only]


def _parse(text: str) -> Distribution:
    if named := _NAMED.fullmatch(text):
        return _parse_call(_kind(named[1]), _parts(text, named[2], ",") if named[2].strip() else [])
    if "(" in text or ")" in text:
        _refuse(text)
    if text.startswith(("±", "+-")):
        return _parse_tolerance(text)
    if ":" in text:
        return _parse_range(text)
    parts = _parts(text, text, ",")
    factors = [p for p in map(_percent, parts) if p is not None]
    if not factors:
        return ValueList([_value(part) for part in parts])
    if len(factors) < len(parts):
        _refuse(text)
    return ValueList(factors, relative=True)


def _parse_call(kind: type[Distribution], arguments: Sequence[str]) -> Distribution:
    """Parse the arguments of NAME(...): first those without a name."""
    named = [tuple(map(str.strip, a.split("=", 1))) for a in arguments if "=" in a]
    plain = [_value(a) for a in arguments if "=" not in a]
    if any("=" in a for a in arguments[: len(plain)]):
        raise CommandError(f"{kind.noun} takes arguments without a name first, then those with one.")
    names = list_positional_fields(kind)
    if kind is ValueList:
        plain = [plain] if plain else []
    if len(plain) > len(names):
        raise CommandError(
            f"{kind.noun} takes {len(names)} arguments at most: {join_names(names)}; here are {len(plain)}."
        )
    given: dict[str, Any] = dict(zip(names, plain, strict=False))
    for name, value in named:
        if name in given:
            raise CommandError(f"{kind.noun} has {name} twice; once is right.", name=name)
        given[name] = _value(value)
    return _make_distribution(kind, given)


def _parse_tolerance(text: str) -> Distribution:
    """Parse ±10%."""
    number = _value(text.removeprefix("±").removeprefix("+-").removesuffix("%").strip())
    if not text.endswith("%") or isinstance(number, (bool, str)):
        _refuse(text)
    if number <= 0:
        raise CommandError(f"the tolerance '{text}' must be more than 0 %.", text=text)
    return Uniform((100 - number) / 100, (100 + number) / 100, relative=True)


def _parse_range(text: str) -> Distribution:
    """Parse LOW:HIGH and LOW:HIGH:N."""
    low, high, *points = _parts(text, text, ":")
    if len(points) > 1:
        _refuse(text)
    ends = [_percent(low), _percent(high)]
    relative = ends != [None, None]
    if not relative:
        ends = [_value(low), _value(high)]
    numbers = [*ends, *map(_value, points)]
    if any(n is None or isinstance(n, (bool, str)) for n in numbers):
        _refuse(text)
    return _make_distribution(
        Uniform, dict(zip(("low", "high", "points"), numbers, strict=False)) | {"relative": relative}
    )


def _parts(text: str, inner: str, separator: str) -> list[str]:
    """Split at separators. No part may be empty."""
    parts = [part.strip() for part in inner.split(separator)]
    if not all(parts):
        _refuse(text)
    return parts


def _value(text: str) -> Value:
    if text in _WORDS:
        return _WORDS[text]
    if _WHOLE.fullmatch(text):
        return int(text)
    return float(text) if _NUMBER.fullmatch(text) else text


def _percent(text: str) -> float | None:
    """Return a percentage as a factor; None if the text is not a percentage."""
    value = _value(text.removesuffix("%").strip())
    if not text.endswith("%") or isinstance(value, (bool, str)):
        return None
    return value / 100


def _refuse(text: str) -> NoReturn:
    raise CommandError(f"'{text}' is not a distribution; write one of {FORMS}.", text=text)
