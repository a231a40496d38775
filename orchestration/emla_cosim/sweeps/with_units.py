"""Convert values with units in a plan to numbers in the unit of the variable."""

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from ..base.errors import CommandError
from ..base.quantities import has_unit
from .distributions import DISTRIBUTIONS, list_positional_fields

Convert = Callable[[str], Any]
"""Converts a text with a unit to a number. Raises CommandError for an incompatible unit."""

_CALL = re.compile(r"([\w-]+)\s*\((.*)\)", re.DOTALL)


def convert_units(given: Any, convert: Convert, where: str) -> Any:
    """Replace texts such as "5 mm" by numbers. Values without a unit, and factors, do not change.

    Args:
        given: Any value that `parse_distribution` accepts.
        convert: Converts a text with a unit.
        where: Name of the factor in messages.

    Raises:
        CommandError: Only some of the values have a unit, which is ambiguous.
    """
    try:
        if isinstance(given, str):
            return _in_text(given.strip(), convert)
        if isinstance(given, Mapping):
            return given if given.get("relative") else _in_table(given, convert)
        if isinstance(given, Sequence) and not isinstance(given, bytes):
            return _convert_values(list(given), convert)
    except _MixedUnitsError as error:
        raise CommandError(f"{where}: {error}") from None
    return given


class _MixedUnitsError(Exception):
    """Only some of the values have a unit."""


def _in_text(text: str, convert: Convert) -> str:
    if found := _CALL.fullmatch(text):
        return f"{found[1]}({_in_arguments(found[1], found[2].split(','), convert)})"
    if ":" in text:
        low, high, *points = (part.strip() for part in [*text.split(":"), ""])
        return ":".join([*_texts([low, high], convert), *points[:-1]])
    return ",".join(_texts([part.strip() for part in text.split(",")], convert))


def _in_arguments(kind: str, arguments: Sequence[str], convert: Convert) -> str:
    """Return the arguments of a short form such as `normal(1 mm, deviation = 0.1 mm)`."""
    names = list_positional_fields(DISTRIBUTIONS[kind]) if kind in DISTRIBUTIONS else []
    split = [tuple(part.strip() for part in argument.rpartition("=")) for argument in arguments]
    keys = [name or (names[min(i, len(names) - 1)] if names else "") for i, (name, _, _) in enumerate(split)]
    own = [i for i, key in enumerate(keys) if _has_dimension(kind, key)]
    found = dict(zip(own, _texts([split[i][2] for i in own], convert), strict=True))
    return ", ".join(f"{name}{equals}{found.get(i, value)}" for i, (name, equals, value) in enumerate(split))


def _in_table(table: Mapping[str, Any], convert: Convert) -> dict[str, Any]:
    kind = str(table.get("distribution"))
    own = [key for key in table if key not in ("distribution", "values") and _has_dimension(kind, key)]
    found = dict(zip(own, _convert_values([table[key] for key in own], convert), strict=True))
    values = table.get("values")
    if isinstance(values, Sequence) and not isinstance(values, str):
        found["values"] = _convert_values(list(values), convert)
    return {**table, **found}


def _has_dimension(kind: str, key: str) -> bool:
    """Return whether a field of a distribution is in the unit of what varies."""
    return key not in ("points", "relative") and (kind, key) != ("log-normal", "deviation")


def _texts(values: Sequence[str], convert: Convert) -> list[str]:
    return [one if isinstance(one, str) else repr(one) for one in _convert_values(values, convert)]


def _convert_values(values: Sequence[Any], convert: Convert) -> list[Any]:
    found = [convert(value) if _is_quantity(value) else value for value in values]
    if all(new is old for new, old in zip(found, values, strict=True)):
        return found
    for value in values:
        if not _is_quantity(value) and _number(value) not in (0.0, None):
            other = next(filter(_is_quantity, values))
            raise _MixedUnitsError(f"{value} has no unit, but {other} has; add a unit to all or none.")
    return found


def _is_quantity(value: Any) -> bool:
    return has_unit(value) and not value.rstrip().endswith("%")


def _number(value: Any) -> float | None:
    try:
        return float(value)
    except (TypeError, ValueError):
        return None
