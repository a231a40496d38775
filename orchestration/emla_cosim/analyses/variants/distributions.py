"""Parse distributions of plans and of the command line."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, fields
from typing import Any, NoReturn

from ...base.errors import CommandError, join_names, suggest_names
from ...base.quantities import has_unit
from ...base.table_entries import unknown_entry
from ...system.model import Value
from .kinds import Distribution, Integers, LogNormal, LogUniform, Normal, Triangular, Uniform, ValueList

DISTRIBUTIONS: dict[str, type[Distribution]] = {
    kind.name: kind for kind in (Uniform, LogUniform, Normal, LogNormal, Triangular, ValueList, Integers)
}
"""Kinds of distributions by their names in plans."""

FORMS = "LOW:HIGH, LOW:HIGH:N, A,B,C, ±10%, 80%:120% and NAME(...) such as normal(0.14, 0.01)"
"""The short forms, for messages. Values may have units, such as 1 mm:5 mm:5."""

_NUMBER = re.compile(
    r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?|[+-]?(nan|inf|infinity)", re.IGNORECASE
)
_INTEGER = re.compile(r"[+-]?[0-9]{1,30}")
_CALL = re.compile(r"([\w-]+)\s*\((.*)\)", re.DOTALL)


_Fields = tuple[type[Distribution], Mapping[str, Any]]
"""A kind of distributions and its fields, unchecked."""

_LIST_OR_DECIMAL = re.compile(r"(?<![\w.,])([+-]?[0-9]+),([0-9]+)\s*([^\W\d_][^,)]*)")
"""A number with a decimal comma and a unit, or two values of a list."""


def parse_distribution(value: Any, where: str, convert: Callable[[str], Any] | None = None) -> Distribution:
    """Read the distribution of a factor from a plan or from the command line.

    Texts have short forms:

    - LOW:HIGH is uniform. LOW:HIGH:N has N levels in a grid.
    - A,B,C, or a single A, are values: numbers, true, false or texts without commas, colons and parentheses.
    - NAME(...) has the fields of that kind in their order or as name=value.
    - Percentages are of the nominal value: 80%:120%, 80%:120%:N, 90%,110%, or ±10% (also +-10%), which is
      uniform from 90 % to 110 %.

    Args:
        value: A table with `distribution` (the name) and its fields, a list of values, a text in a short
            form, a number, a Boolean, or a distribution.
        where: Name of the factor in messages.
        convert: Converts texts such as "5 mm" to numbers, unless the values are factors. Messages of its
            errors begin with `where`. Default: they stay texts.

    Raises:
        CommandError: The value is anything else, or only some of its values have a unit.
    """
    if isinstance(value, Distribution):
        return value
    try:
        kind, entries = _parse_text(value.strip()) if isinstance(value, str) else _read_table_or_list(value)
        if convert is not None and not entries.get("relative"):
            _check_units(kind, entries, value)
            converted = _convert_fields(kind, entries, lambda x: convert(x) if _is_quantity(x) else x)
            entries = {**entries, **converted}
        return _make_distribution(kind, entries)
    except CommandError as error:
        if str(error).startswith(where):
            raise
        raise CommandError(f"{where}: {error}", **error.fields) from None


def _convert_fields(
    kind: type[Distribution], entries: Mapping[str, Any], change: Callable[[Any], Any]
) -> dict[str, Any]:
    """Return the fields that have the unit of what varies, by name, with `change` applied to their values."""
    if kind is ValueList:
        values = entries.get("values")
        if isinstance(values, str) or not isinstance(values, Sequence):
            return {}
        return {"values": [change(value) for value in values]}
    factor = "deviation" if kind is LogNormal else ""
    return {n: change(value) for n, value in entries.items() if n not in ("points", "relative", factor)}


def _check_units(kind: type[Distribution], entries: Mapping[str, Any], written: Any) -> None:
    """Raise CommandError if only some numbers have a unit; 0 needs none.

    In a text, a list of values must not look like a number with a decimal comma.
    """
    if isinstance(written, str) and ":" not in written and (match := _LIST_OR_DECIMAL.search(written)):
        first, second, unit = (part.strip() for part in match.groups())
        raise CommandError(
            f"'{match[0].strip()}' has two meanings; write '{first}.{second} {unit}', or "
            f"'{first} {unit}, {second} {unit}' for two values.",
            text=written,
        )
    values = list[Any]()
    _convert_fields(kind, entries, values.append)
    quantities = list(filter(_is_quantity, values))
    bare = [v for v in values if isinstance(v, (int, float)) and v != 0.0]
    if quantities and bare:
        raise CommandError(f"{bare[0]} has no unit, but {quantities[0]} has; add a unit to all or none.")


def _is_quantity(value: Any) -> bool:
    return has_unit(value) and not value.rstrip().endswith("%")


def _read_table_or_list(value: Any) -> _Fields:
    """Return kind and fields of a table, list, array or number; raise CommandError for anything else."""
    if hasattr(value, "tolist"):
        value = value.tolist()  # NumPy
    match value:
        case {"distribution": name, **given}:
            return _find_kind(name), given
        case Mapping():
            raise CommandError(
                f"the table has no distribution; write distribution = one of {join_names(DISTRIBUTIONS)}.",
                choices=list(DISTRIBUTIONS),
            )
        case int() | float():
            return ValueList, {"values": (value,)}
        case Sequence() if not isinstance(value, (str, bytes)):
            return ValueList, {"values": value}
    raise CommandError(
        f"what varies is {value!r}; it must be a list of values, a text such as '0.1:0.3', or a table "
        'such as { distribution = "normal", mean = 0.14, deviation = 0.01 }.',
        value=value,
    )


def _find_kind(name: Any) -> type[Distribution]:
    if isinstance(name, str) and name in DISTRIBUTIONS:
        return DISTRIBUTIONS[name]
    hint = suggest_names(str(name), DISTRIBUTIONS)
    raise CommandError(f"there is no distribution '{name}'; {hint}", name=name, choices=list(DISTRIBUTIONS))


def _make_distribution(kind: type[Distribution], entries: Mapping[str, Any]) -> Distribution:
    """Return a distribution; raise CommandError for an unknown or missing field."""
    allowed = [*_list_positional_fields(kind), "relative"]
    if unknown := [key for key in entries if key not in allowed]:
        raise unknown_entry(kind.noun, unknown[0], allowed)
    required = [f.name for f in fields(kind) if f.default is MISSING]
    if any(name not in entries for name in required):
        raise CommandError(f"{kind.noun} needs {join_names(required)}.", needed=required)
    return kind(**entries)


def _list_positional_fields(kind: type[Distribution]) -> list[str]:
    return [f.name for f in fields(kind) if not f.kw_only]


def _parse_text(text: str) -> _Fields:
    """Return kind and fields of a short form; raise CommandError for any other text."""
    if match := _CALL.fullmatch(text):
        return _parse_call(_find_kind(match[1]), _split(text, match[2], ",") if match[2].strip() else [])
    if "(" in text or ")" in text:
        _refuse(text)
    if text.startswith(("±", "+-")):
        return _parse_tolerance(text)
    if ":" in text:
        return _parse_range(text)
    parts = _split(text, text, ",")
    factors = [p for p in map(_read_percent, parts) if p is not None]
    if not factors:
        return ValueList, {"values": [_read_value(part) for part in parts]}
    if len(factors) < len(parts):
        _refuse(text)
    return ValueList, {"values": factors, "relative": True}


def _parse_call(kind: type[Distribution], arguments: Sequence[str]) -> _Fields:
    """Parse the arguments of NAME(...): first those without a name."""
    keywords = [tuple(map(str.strip, a.split("=", 1))) for a in arguments if "=" in a]
    plain = [_read_value(a) for a in arguments if "=" not in a]
    if any("=" in a for a in arguments[: len(plain)]):
        raise CommandError(f"{kind.noun}: positional arguments must precede keyword arguments.")
    names = _list_positional_fields(kind)
    if kind is ValueList:
        plain = [plain] if plain else []
    if len(plain) > len(names):
        raise CommandError(
            f"{kind.noun} takes {len(names)} arguments at most: {join_names(names)}; here are {len(plain)}."
        )
    entries: dict[str, Any] = dict(zip(names, plain, strict=False))
    for name, value in keywords:
        if name in entries:
            raise CommandError(f"{kind.noun} has {name} twice; remove one.", name=name)
        entries[name] = _read_value(value)
    return kind, entries


def _parse_tolerance(text: str) -> _Fields:
    """Parse ±10%."""
    number = _read_value(text.removeprefix("±").removeprefix("+-").removesuffix("%").strip())
    if not text.endswith("%") or isinstance(number, (bool, str)):
        _refuse(text)
    if number <= 0:
        raise CommandError(f"the tolerance '{text}' must be more than 0 %.", text=text)
    return Uniform, {"low": (100 - number) / 100, "high": (100 + number) / 100, "relative": True}


def _parse_range(text: str) -> _Fields:
    """Parse LOW:HIGH and LOW:HIGH:N."""
    low, high, *points = _split(text, text, ":")
    if len(points) > 1:
        _refuse(text)
    is_relative = any(_read_percent(end) is not None for end in (low, high))
    numbers = [*map(_read_percent if is_relative else _read_value, (low, high)), *map(_read_value, points)]
    if any(n is None or isinstance(n, (bool, str)) for n in numbers if is_relative or not has_unit(n)):
        _refuse(text)
    return Uniform, dict(zip(("low", "high", "points"), numbers, strict=False)) | {"relative": is_relative}


def _split(text: str, inner: str, separator: str) -> list[str]:
    """Return the stripped parts of `inner`; raise CommandError about the whole `text` if one is empty."""
    parts = [part.strip() for part in inner.split(separator)]
    if not all(parts):
        _refuse(text)
    return parts


def _read_value(text: str) -> Value:
    """Return a Boolean or number; other texts as they are."""
    if text in ("true", "false"):
        return text == "true"
    if _INTEGER.fullmatch(text):
        return int(text)
    return float(text) if _NUMBER.fullmatch(text) else text


def _read_percent(text: str) -> float | None:
    """Return a percentage as a factor; None if the text is not a percentage."""
    value = _read_value(text.removesuffix("%").strip())
    if not text.endswith("%") or isinstance(value, (bool, str)):
        return None
    return value / 100


def _refuse(text: str) -> NoReturn:
    raise CommandError(f"'{text}' is not a distribution; write one of {FORMS}.", text=text)
