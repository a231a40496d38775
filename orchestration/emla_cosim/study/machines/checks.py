"""Checks of machine files that no single entry decides: names, and how many numbers a vector has."""

import re
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from machine_fmu import GROUND, Point
from machine_fmu.description import Number

from ...base.errors import CommandError

if TYPE_CHECKING:
    from .schema import BodyTable, MachineTable

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
    for name, point in points:
        check_names(where, [name], label)
        if point.position:
            _check_count(f"'{name}' in [{where}] of {label}", point.position, (dimensions,), dimensions)


def _check_body(where: str, body: "BodyTable", dimensions: int) -> None:
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
    if len(numbers) not in counts:
        expected = " or ".join(map(str, counts))
        raise CommandError(
            f"{subject} has {len(numbers)} number{'s' if len(numbers) > 1 else ''}; with "
            f"dimensions = {dimensions}, it must have {expected}."
        )
