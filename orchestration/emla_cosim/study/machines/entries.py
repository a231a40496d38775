"""Numbers and points in machine files: numbers with units, or names of parameters."""

from collections.abc import Mapping
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


def number(unit: str, about: str, example: Any = None) -> msgspec.Meta:
    """Annotate `float | str`: a number, a text with a unit, or the name of a parameter, also with a minus."""

    def read(value: Any, at: Location, folder: Path | None) -> Number:
        return _read_number(value, unit, at, folder)

    return describe(_about(about, unit), example, read=read)


def numbers(unit: str, about: str, example: Any = None, counts: tuple[int, ...] = ()) -> msgspec.Meta:
    """Annotate a list of such numbers, or a single one.

    Args:
        unit: Their unit.
        about: Their meaning.
        example: A value as files have it.
        counts: How many there can be; any number without.
    """

    def read(value: Any, at: Location, folder: Path | None) -> tuple[Number, ...]:
        items = value if isinstance(value, (list, tuple)) else [value]
        if counts and len(items) not in counts:
            raise CommandError(
                f"{at.label} has {len(items)} numbers; it must have {' or '.join(map(str, counts))}."
            )
        return tuple(_read_number(x, unit, at.item(i + 1), folder) for i, x in enumerate(items))

    return describe(_about(about, unit), example, read=read)


def joint_values(about: str, example: Any = None) -> msgspec.Meta:
    """Annotate a list of angles in rad and distances in m, or a single one."""

    def read(value: Any, at: Location, folder: Path | None) -> tuple[float, ...]:
        items = value if isinstance(value, (list, tuple)) else [value]
        return tuple(_read_joint_value(x, at.item(i), folder) for i, x in enumerate(items, 1))

    return describe(f"{about} [rad or m]", example, read=read)


def _read_joint_value(value: Any, at: Location, folder: Path | None) -> float:
    if isinstance(value, str):
        try:
            return read_quantity(value, at.label, "rad")
        except CommandError:
            return read_quantity(value, at.label, "m")
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


def _about(about: str, unit: str) -> str:
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
        wanted = " or ".join(map(str, counts))
        raise CommandError(f"{at.label} is {value!r}; it must be a list of {wanted} numbers.")
    pairs = zip(value, units, strict=False)
    return tuple(_read_number(x, unit, at.item(i), folder) for i, (x, unit) in enumerate(pairs, 1))
