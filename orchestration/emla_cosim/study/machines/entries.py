"""Numbers and points in machine files, and checks that no single entry decides."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import msgspec

from machine_fmu import GROUND, Point
from machine_fmu.description import Number

from ...base.errors import CommandError
from ...base.quantities import read_quantity
from ...base.table_entries import Location
from ...base.toml_structs import describe, quantity
from ...base.values import convert_at

if TYPE_CHECKING:
    from .schema import BodyTable, MachineTable

_NUMBER_START = "0123456789.,+"
"""First characters of a number with a unit, without a minus sign; other texts name parameters."""


def number(
    unit: str, about: str, example: Any = None, ge: float = -math.inf, le: float = math.inf
) -> msgspec.Meta:
    """Return the annotation of a `float | str`: a number, also with a unit, or the name of a parameter.

    The name can have a minus before it.

    Args:
        unit: Its unit.
        about: Its meaning.
        example: A value as files have it.
        ge: The lowest number.
        le: The highest number.
    """

    def read(value: Any, at: Location, folder: Path | None) -> Number:
        x = _read_number_or_name(value, unit, at, folder)
        if not isinstance(x, str) and not ge <= x <= le:
            limit = f"at least {ge:g}" if x < ge else f"at most {le:g}"
            raise CommandError(f"{at.label} is {value!r}; it must be {limit}.")
        return x

    return describe(_describe_quantity(about, unit), example, read=read)


def numbers(unit: str, about: str, example: Any = None, counts: tuple[int, ...] = ()) -> msgspec.Meta:
    """Return the annotation of a list of numbers as those of `number`, or of a single one.

    Args:
        unit: Their unit.
        about: Their meaning.
        example: A value as files have it.
        counts: How many there can be; any number without.
    """

    def read(value: Any, at: Location, folder: Path | None) -> tuple[Number, ...]:
        items = _list_items(value, at)
        if counts and len(items) not in counts:
            raise CommandError(
                f"{at.label} is {value!r}; it must have {' or '.join(map(str, counts))} numbers."
            )
        return tuple(_read_number_or_name(x, unit, x_at, folder) for x, x_at in items)

    return describe(_describe_quantity(about, unit), example, read=read)


def joint_values(about: str, example: Any = None) -> msgspec.Meta:
    """Return the annotation of a list of angles in rad and distances in m, or of a single one."""

    def read(value: Any, at: Location, folder: Path | None) -> tuple[float, ...]:
        return tuple(_read_joint_value(x, x_at, folder) for x, x_at in _list_items(value, at))

    return describe(f"{about} [rad or m]", example, read=read)


def _list_items(value: Any, at: Location) -> list[tuple[Any, Location]]:
    """Return the items of a list with their locations, or a single value with its own."""
    if not isinstance(value, (list, tuple)):
        return [(value, at)]
    return [(x, at.item(i)) for i, x in enumerate(value, 1)]


def _read_joint_value(value: Any, at: Location, folder: Path | None) -> float:
    """Return an angle in rad or a distance in m; raise CommandError for other units."""
    if isinstance(value, str):
        for unit in ("rad", "m"):
            with suppress(CommandError):
                return read_quantity(value, at.label, unit)
        raise CommandError(f"{at.label} is {value!r}; it must be an angle or a length, like '30 deg'.")
    return convert_at(value, Annotated[float, quantity("")], at, folder)


def point_table() -> msgspec.Meta:
    """Return the annotation of a table of points by name."""

    def read(value: Any, at: Location, folder: Path | None) -> dict[str, Point]:
        if not isinstance(value, Mapping):
            raise CommandError(f"{at.label} is {value!r}; it must be a table of points.")
        return {name: _read_point(x, at.entry(name), folder) for name, x in value.items()}

    return describe("points of the body, in m in its frame", {"pin": [0.5, 0.1]}, read=read)


def corner_list(subject: str) -> msgspec.Meta:
    """Return the annotation of a list of corners, each a point, or the name of a point of the same body."""

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


def _read_number_or_name(value: Any, unit: str, at: Location, folder: Path | None) -> Number:
    """Return a number in `unit`, or the text of a name of a parameter, which is not looked up."""
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
        return Point(_read_fixed_list(value, ("m", "m", "m"), (2, 3), at, folder))
    table = convert_at(value, PointTable, at, folder)
    if table.polar is None and not table.position and table.origin is None:
        raise CommandError(f"{at.label} has neither position nor polar; write one of them.")
    polar = None
    if table.polar is not None:
        radius, angle = _read_fixed_list(table.polar, ("m", "rad"), (2,), at.entry("polar"), folder)
        polar = radius, angle
    return Point(tuple(table.position), polar, table.origin)


def _read_fixed_list(
    value: Any, units: tuple[str, ...], counts: tuple[int, ...], at: Location, folder: Path | None
) -> tuple[Number, ...]:
    """Return a list with one of these counts of numbers, each in its unit; raise CommandError otherwise."""
    if not isinstance(value, (list, tuple)) or len(value) not in counts:
        expected = " or ".join(map(str, counts))
        raise CommandError(f"{at.label} is {value!r}; it must be a list of {expected} numbers.")
    pairs = zip(value, units, strict=False)
    return tuple(_read_number_or_name(x, unit, at.item(i), folder) for i, (x, unit) in enumerate(pairs, 1))


_NAME = re.compile(r"[A-Za-z_]\w*", re.ASCII)

_NAME_RULE = "use letters from a to z, digits and _, and begin with a letter"
"""What names in FMUs have, for messages."""

_RESERVED = (GROUND, "payload")
"""Names that bodies and links cannot have: those of other tables, with which numbers of the FMU begin."""


_ROUNDING_FRACTION = 0.01
"""Fraction by which moments of inertia of data sheets can be rounded."""


def check_table(table: "MachineTable", label: str) -> None:
    """Raise CommandError for names that an FMU cannot have, and for numbers that do not fit together."""
    check_names("actuators", table.actuators, label)
    for kind, tables in (("bodies", table.bodies), ("links", table.links)):
        check_names(kind, tables, label)
        for name in tables:
            if name in _RESERVED:
                raise CommandError(f"[{kind}.{name}] of {label} has a reserved name; rename it.")
    _check_points("ground.points", table.ground.points.items(), table.dimensions, label)
    for name, link in table.links_of_urdf.items():
        _check_points(f"urdf_links.{name}.points", link.points.items(), table.dimensions, label)
    for name, body in table.bodies.items():
        _check_points(f"bodies.{name}.points", body.points.items(), table.dimensions, label)
        _check_body(f"[bodies.{name}] of {label}", body, table.dimensions)
    for name, parameter in table.parameters.items():
        low, high = parameter.minimum, parameter.maximum
        for x in map(float, parameter.value):
            if (low is not None and x < low) or (high is not None and x > high):
                limit = f"at least {low:g}" if low is not None and x < low else f"at most {high:g}"
                raise CommandError(
                    f"'value' in [parameters.{name}] of {label} is {x:g}; that table requires {limit}."
                )


def check_names(where: str, names: Iterable[str], label: str) -> None:
    """Raise CommandError for names in a table that a variable of an FMU cannot have."""
    for name in names:
        if _NAME.fullmatch(name) is None:
            raise CommandError(f"[{where}] of {label} has the name '{name}'; {_NAME_RULE}.")


def _check_points(where: str, points: Iterable[tuple[str, Point]], dimensions: int, label: str) -> None:
    """Raise CommandError for invalid names of points, and for positions with another number of dimensions."""
    for name, point in points:
        check_names(where, [name], label)
        if point.position:
            _check_count(f"'{name}' in [{where}] of {label}", point.position, (dimensions,), dimensions)


def _check_body(where: str, body: "BodyTable", dimensions: int) -> None:
    """Raise CommandError if axis, centre or inertia of a body are impossible or do not fit the dimensions."""
    for key in ("axis", "rotation"):
        if any(isinstance(x, str) for x in getattr(body, key) or ()):
            raise CommandError(f"'{key}' in {where} names a parameter; write numbers.")
    if body.c:
        _check_count(f"'c' in {where}", body.c, (dimensions,), dimensions)
    if body.J:
        _check_count(f"'J' in {where}", body.J, (1,) if dimensions == 2 else (3, 6), dimensions)
    moments = [x for x in body.J[:3] if not isinstance(x, str)]
    if any(x < 0.0 for x in moments):
        raise CommandError(f"'J' in {where} is {min(moments):g} kg.m2; it must be at least 0.")
    # the triangle inequality of moments of inertia
    if len(moments) == 3 and 2.0 * max(moments) > sum(moments) * (1.0 + _ROUNDING_FRACTION):
        raise CommandError(
            f"'J' in {where} is {max(moments):g} kg.m2 about one axis, more than about both others together; "
            "no body has that."
        )
    if dimensions == 2 and body.axis is not None and len(body.axis) == 3:
        *in_plane, z = map(float, body.axis)
        if (body.joint == "prismatic" and z) or (body.joint == "revolute" and any(in_plane)):
            raise CommandError(
                f"'axis' in {where} is {list(body.axis)}; in the plane, slides move in x and y, and bodies "
                "turn about z."
            )


def _check_count(subject: str, numbers: Sequence[Number], counts: tuple[int, ...], dimensions: int) -> None:
    """Raise CommandError if there is not one of these counts of numbers."""
    if len(numbers) not in counts:
        expected = " or ".join(map(str, counts))
        raise CommandError(
            f"{subject} has {len(numbers)} number{'s' if len(numbers) > 1 else ''}; with "
            f"dimensions = {dimensions}, it must have {expected}."
        )
