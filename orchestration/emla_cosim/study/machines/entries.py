"""Numbers and points in machine files: numbers with units, or names of parameters."""

import math
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import msgspec

from machine_fmu import Point
from machine_fmu.description import Number

from ...base.errors import CommandError
from ...base.quantities import read_quantity
from ...base.table_entries import Location
from ...base.toml_structs import describe, quantity
from ...base.values import convert_at

_NUMBER_START = "0123456789.,+"
"""First characters of a number with a unit, without a minus sign; other texts name parameters."""


def number(
    unit: str, about: str, example: Any = None, ge: float = -math.inf, le: float = math.inf
) -> msgspec.Meta:
    """Annotate `float | str`: a number, a text with a unit, or the name of a parameter, also with a minus.

    Args:
        unit: Its unit.
        about: Its meaning.
        example: A value as files have it.
        ge: The lowest number.
        le: The highest number.
    """

    def read(value: Any, at: Location, folder: Path | None) -> Number:
        x = _read_number(value, unit, at, folder)
        if not isinstance(x, str) and not ge <= x <= le:
            limit = f"at least {ge:g}" if x < ge else f"at most {le:g}"
            raise CommandError(f"{at.label} is {value!r}; it must be {limit}.")
        return x

    return describe(_describe_quantity(about, unit), example, read=read)


def numbers(unit: str, about: str, example: Any = None, counts: tuple[int, ...] = ()) -> msgspec.Meta:
    """Annotate a list of such numbers, or a single one.

    Args:
        unit: Their unit.
        about: Their meaning.
        example: A value as files have it.
        counts: How many there can be; any number without.
    """

    def read(value: Any, at: Location, folder: Path | None) -> tuple[Number, ...]:
        items = _items(value, at)
        if counts and len(items) not in counts:
            raise CommandError(
                f"{at.label} is {value!r}; it must have {' or '.join(map(str, counts))} numbers."
            )
        return tuple(_read_number(x, unit, x_at, folder) for x, x_at in items)

    return describe(_describe_quantity(about, unit), example, read=read)


def joint_values(about: str, example: Any = None) -> msgspec.Meta:
    """Annotate a list of angles in rad and distances in m, or a single one."""

    def read(value: Any, at: Location, folder: Path | None) -> tuple[float, ...]:
        return tuple(_read_joint_value(x, x_at, folder) for x, x_at in _items(value, at))

    return describe(f"{about} [rad or m]", example, read=read)


def _items(value: Any, at: Location) -> list[tuple[Any, Location]]:
    """Return the items of a list with their locations, or a single value with its own."""
    if not isinstance(value, (list, tuple)):
        return [(value, at)]
    return [(x, at.item(i)) for i, x in enumerate(value, 1)]


def _read_joint_value(value: Any, at: Location, folder: Path | None) -> float:
    if isinstance(value, str):
        for unit in ("rad", "m"):
            with suppress(CommandError):
                return read_quantity(value, at.label, unit)
        raise CommandError(f"{at.label} is {value!r}; it must be an angle or a length, like '30 deg'.")
    return convert_at(value, Annotated[float, quantity("")], at, folder)


def point_table() -> msgspec.Meta:
    """Annotate a table of points by name."""

    def read(value: Any, at: Location, folder: Path | None) -> dict[str, Point]:
        if not isinstance(value, Mapping):
            raise CommandError(f"{at.label} is {value!r}; it must be a table of points.")
        return {name: _read_point(x, at.entry(name), folder) for name, x in value.items()}

    return describe("points of the body, in m in its frame", {"pin": [0.5, 0.1]}, read=read)


def corner_list(subject: str) -> msgspec.Meta:
    """Annotate a list of corners, each a point, or the name of a point of the same body."""

    def read(value: Any, at: Location, folder: Path | None) -> tuple[Point, ...]:
        if not isinstance(value, (list, tuple)) or len(value) < 3:
            raise CommandError(f"{at.label} is {value!r}; it must be a list of at least 3 corners.")
        return tuple(
            Point(origin=x) if isinstance(x, str) else _read_point(x, at.item(i), folder)
            for i, x in enumerate(value, 1)
        )

    about = f"corners of the {subject} in pictures, in m: points, or names of its points"
    return describe(about, [[0.0, 0.1], [0.0, -0.1], "pin"], read=read)


def _describe_quantity(about: str, unit: str) -> str:
    return f"{about} [{unit}], or a parameter" if unit else f"{about}, or a parameter"


def _read_number(value: Any, unit: str, at: Location, folder: Path | None) -> Number:
    if isinstance(value, str):
        text = value.strip()
        if text.removeprefix("-")[:1] not in _NUMBER_START:
            return text
        return read_quantity(value, at.label, unit or None)
    return convert_at(value, Annotated[float, quantity(unit)], at, folder)


class PointTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A point by radius and angle about z, or by its position, from another point of the body."""

    polar: Annotated[list[float | str], describe("radius and angle about z", [0.5, "20 deg"])] | None = None
    position: Annotated[list[float | str], numbers("m", "position", [1.8, 0.0], (2, 3))] = msgspec.field(
        default_factory=list
    )
    origin: Annotated[str, describe("point from which it counts", "elbow")] | None = msgspec.field(
        name="from", default=None
    )


if TYPE_CHECKING:  # as they are read
    Numbers = NumberList = list[float]
    Points = dict[str, Point]
    Corners = list[Point]
else:  # as files have them
    Numbers, NumberList = float | str | list[float | str], list[float | str]
    Points = dict[str, NumberList | PointTable]
    Corners = list[str | NumberList | PointTable]


def _read_point(value: Any, at: Location, folder: Path | None) -> Point:
    """Return a point of a list of coordinates, or of a table."""
    if not isinstance(value, Mapping):
        return Point(_read_list(value, ("m", "m", "m"), (2, 3), at, folder))
    table = convert_at(value, PointTable, at, folder)
    if table.polar is None and not table.position and table.origin is None:
        raise CommandError(f"{at.label} has neither position nor polar; write one of them.")
    polar = None
    if table.polar is not None:
        radius, angle = _read_list(table.polar, ("m", "rad"), (2,), at.entry("polar"), folder)
        polar = radius, angle
    return Point(tuple(table.position), polar, table.origin)


def _read_list(
    value: Any, units: tuple[str, ...], counts: tuple[int, ...], at: Location, folder: Path | None
) -> tuple[Number, ...]:
    if not isinstance(value, (list, tuple)) or len(value) not in counts:
        expected = " or ".join(map(str, counts))
        raise CommandError(f"{at.label} is {value!r}; it must be a list of {expected} numbers.")
    pairs = zip(value, units, strict=False)
    return tuple(_read_number(x, unit, at.item(i), folder) for i, (x, unit) in enumerate(pairs, 1))
