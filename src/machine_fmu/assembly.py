"""Assemble the mechanism of a machine: from bodies, joints and struts to frames and bars."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

from fmublock import cos, sin

from .description import GROUND, Actuator, Body, Link, Machine, MachineError, Number, Point, Strut
from .exact import ONE, ZERO, exact, plain
from .inertia import Inertia, in_plane, slender, uniform
from .mechanism import Bar, End, Frame, Mechanism
from .vectors import (
    AXES,
    IDENTITY,
    NONE,
    Matrix,
    Vector,
    about,
    add,
    compose,
    cross,
    dot,
    scale,
    subtract,
    turn,
)

Values = Callable[[str], Any]
"""Returns the value of a parameter by name."""

_PARALLEL, _SHORT = 1e-9, 1e-3
"""Largest sine of an angle between parallel directions, and least length in m that has a direction."""


def assemble(machine: Machine, values: Values | None = None, payload: Any = None) -> Mechanism:
    """Return the mechanism of a machine.

    Args:
        machine: The description.
        values: Values of its parameters by name. Default: those of the description.
        payload: Mass of the payload in kg. Default: that of the description.

    Raises:
        MachineError: The description names something that does not exist.
    """
    return _Assembly(machine, values or (lambda name: machine.parameters[name].value)).finish(payload)


def locate_points(machine: Machine) -> dict[str, End]:
    """Return all points of bodies and of the ground, by BODY for a body's frame and BODY.POINT."""
    assembly = _Assembly(machine, lambda name: machine.parameters[name].value)
    bodies = (GROUND, *machine.bodies)
    names = (f"{body}.{point}" if point else body for body in bodies for point in ("", *machine.points(body)))
    return {name: assembly._end(name, "a point") for name in names}


def locate_outlines(machine: Machine) -> dict[str, tuple[End, ...]]:
    """Return the corners of outlines by body; bodies without an outline are left out.

    Raises:
        MachineError: A corner names a point that does not exist.
    """
    assembly = _Assembly(machine, lambda name: machine.parameters[name].value)
    outlines = {GROUND: machine.outline, **{name: body.outline for name, body in machine.bodies.items()}}
    for name, corners in outlines.items():
        for corner in corners:
            if corner.origin is not None:
                machine.split(f"{name}.{corner.origin}", f"a corner of the outline of '{name}'")
    return {
        name: tuple(End(assembly._frame_of[name], assembly._locate(name, corner)) for corner in corners)
        for name, corners in outlines.items()
        if corners
    }


class _Assembly:
    """A mechanism in the making."""

    def __init__(self, machine: Machine, values: Values) -> None:
        self._machine, self._values = machine, values
        self._frames = [Frame(GROUND, -1, None, False, NONE, IDENTITY, AXES[2])]
        self._frame_of = {GROUND: 0}
        self._passive: list[int] = []
        self._dampings: list[Any] = []
        for name, body in machine.bodies.items():
            self._add_body(name, body)

    def finish(self, payload: Any) -> Mechanism:
        """Return the mechanism."""
        machine = self._machine
        bars = [self._bar(name, strut) for name, strut in machine.struts()]
        loops = tuple(
            (self._end(a, f"the loop '{name}'"), self._end(b, f"the loop '{name}'"))
            for name, (a, b) in machine.loops.items()
        )
        at = None
        if machine.payload is not None:
            mass = exact(machine.payload.m) if payload is None else payload
            at = self._end(machine.payload.at, "the payload")
            self._hang(at.frame, mass, at.at, uniform(mass * self._number(machine.payload.J), self._is_plane))
        g = self._number(machine.gravity)
        down = (ZERO, -g, ZERO) if self._is_plane else (ZERO, ZERO, -g)
        masses = tuple(self._number(actuator.m) for actuator in machine.actuators.values())
        frames, passive = tuple(self._frames), tuple(self._passive)
        return Mechanism(
            machine, frames, tuple(bars), loops, passive, down, at, masses, tuple(self._dampings)
        )

    @property
    def _is_plane(self) -> bool:
        return self._machine.dimensions == 2

    def _number(self, number: Number) -> Any:
        """Return the value of a number of the description."""
        if not isinstance(number, str):
            return exact(number)
        name = number.removeprefix("-")
        if name not in self._machine.parameters:
            existing = ", ".join(self._machine.parameters) or "none"
            raise MachineError(f"there is no parameter '{name}'; existing: {existing}")
        value = self._values(name)
        return -value if number.startswith("-") else value

    def _vector(self, numbers: Sequence[Number]) -> Vector:
        x, y, z = [*(self._number(n) for n in numbers), ZERO, ZERO, ZERO][:3]
        return x, y, z

    def _place(self, body: str, point: str) -> Vector:
        """Return a point in the frame of its body."""
        return self._locate(body, self._machine.points(body)[point]) if point else NONE

    def _locate(self, body: str, point: Point, origins: tuple[str, ...] = ()) -> Vector:
        at = self._vector(point.position)
        if point.polar is not None:
            radius, angle = (self._number(n) for n in point.polar)
            at = add(at, scale(radius, (cos(plain(angle)), sin(plain(angle)), ZERO)))
        origin = point.origin
        if origin is None:
            return at
        if origin in origins:
            raise MachineError(f"the point '{origin}' of '{body}' counts from itself")
        self._machine.split(f"{body}.{origin}", f"the origin of a point of '{body}'")
        return add(self._locate(body, self._machine.points(body)[origin], (*origins, origin)), at)

    def _end(self, place: str, what: str) -> End:
        body, point = self._machine.split(place, what)
        return End(self._frame_of[body], self._place(body, point))

    def _add_body(self, name: str, body: Body) -> None:
        joint = body.joint
        if joint.parent != GROUND and joint.parent not in self._machine.bodies:
            existing = ", ".join([GROUND, *self._machine.bodies])
            raise MachineError(
                f"there is no parent '{joint.parent}' of the body '{name}'; existing: {existing}"
            )
        if joint.parent not in self._frame_of:
            raise MachineError(f"the parent '{joint.parent}' of the body '{name}' must come before it")
        self._machine.split(f"{joint.parent}.{joint.at}" if joint.at else joint.parent, f"the body '{name}'")
        parent, at = self._frame_of[joint.parent], self._place(joint.parent, joint.at)
        rotation = rotate(*joint.rotation)
        names = self._machine.coordinates(name)
        axes = list(self._axes(name, body, len(names)))
        if not names:
            self._frames.append(Frame(name, parent, None, False, at, rotation, AXES[2]))
        for coordinate, (slides, axis) in zip(names, axes, strict=True):
            count = sum(frame.coordinate is not None for frame in self._frames)
            if joint.is_passive:
                self._passive.append(count)
                self._dampings.append(self._number(joint.damping))
            self._frames.append(Frame(coordinate, parent, count, slides, at, rotation, axis))
            parent, at, rotation = len(self._frames) - 1, NONE, IDENTITY
        self._frame_of[name] = len(self._frames) - 1
        self._hang(len(self._frames) - 1, self._number(body.m), self._vector(body.c), self._inertia(body.J))

    def _axes(self, name: str, body: Body, count: int) -> Iterable[tuple[bool, Vector]]:
        """Return for each coordinate whether it slides, and its axis."""
        kind, axis = body.joint.kind, body.joint.axis
        if kind == "spherical":
            return [(False, axis) for axis in AXES]
        if kind == "free":
            turns = AXES if self._machine.dimensions == 3 else AXES[2:]
            return [
                *((True, axis) for axis in AXES[: count - len(turns)]),
                *((False, axis) for axis in turns),
            ]
        if len(axis) != 3 * count and count:
            raise MachineError(f"the axis of the body '{name}' has {len(axis)} numbers; write {3 * count}")
        return [(kind == "prismatic", _unit(axis[3 * i : 3 * i + 3], name)) for i in range(count)]

    def _inertia(self, J: Sequence[Number]) -> Matrix:
        if self._is_plane:
            return in_plane(self._number(J[0]) if J else ZERO)
        xx, yy, zz, xy, xz, yz = [*(self._number(n) for n in J), *[ZERO] * 6][:6]
        return (xx, xy, xz), (xy, yy, yz), (xz, yz, zz)

    def _hang(self, frame: int, m: Any, at: Vector, J: Matrix) -> None:
        """Add a mass to a frame, with its inertia about its centre."""
        old = self._frames[frame]
        self._frames[frame] = replace(old, inertia=old.inertia + Inertia(m, NONE, J).shifted(at))

    def _bar(self, name: str, strut: Strut) -> Bar:
        is_actuator = isinstance(strut, Actuator)
        what = f"the {'actuator' if is_actuator else 'link'} '{name}'"
        start, end = (self._end(place, what) for place in strut.ends)
        m, c, J = (self._number(n) for n in (strut.m, strut.c, strut.J))
        if isinstance(strut, Actuator):
            share, motor, rod_c, rod_J = (
                self._number(n) for n in (strut.rod_share, strut.motor_m, strut.rod_c, strut.rod_J)
            )
            housing, L_0 = (ONE - share) * m + motor, self._number(strut.L_0)
            bar = Bar(name, start, end, L_0, True, housing, c, J, share * m, rod_c, rod_J)
        else:
            length = strut.length if isinstance(strut, Link) else None
            bar = Bar(name, start, end, None if length is None else self._number(length), False, m, c, J)
        if self._is_along(strut):
            frame = self._frames[end.frame]
            axis = turn(frame.rotation, frame.axis)
            self._hang(start.frame, bar.m, add(start.at, scale(c, axis)), slender(J, axis, self._is_plane))
            back = subtract(end.at, scale(bar.rod_c, frame.axis))
            self._hang(end.frame, bar.rod_m, back, slender(bar.rod_J, frame.axis, self._is_plane))
            return replace(bar, slide=end.frame)
        return bar

    def _is_along(self, strut: Strut) -> bool:
        """Return whether a strut is parallel to the slide of its second body."""
        start, end = (self._plain_assembly._end(place, "") for place in strut.ends)
        frame = self._plain_assembly._frames[end.frame]
        if not frame.slides or frame.parent != start.frame:
            return False
        apart = subtract(add(frame.at, turn(frame.rotation, end.at)), start.at)
        axis = turn(frame.rotation, frame.axis)
        across = cross(apart, axis)
        return plain(dot(across, across)) <= _PARALLEL**2 * max(plain(dot(apart, apart)), _SHORT**2)

    @cached_property
    def _plain_assembly(self) -> "_Assembly":
        """The bodies with the values of the description."""
        return _Assembly(self._machine, lambda name: self._machine.parameters[name].value)


def rotate(roll: float, pitch: float, yaw: float) -> Matrix:
    """Return the rotation by fixed-axis angles in rad, as URDF has them: about z, then y, then x."""
    angles = ((AXES[2], yaw), (AXES[1], pitch), (AXES[0], roll))
    R = IDENTITY
    for axis, angle in angles:
        if angle:
            turned = about(axis, _clean(math.cos(angle)), _clean(math.sin(angle)))
            R = compose(R, turned)
    return R


def _clean(x: float) -> Any:
    """Return an exact number for a value that is one but for rounding."""
    return exact(float(round(x))) if abs(x - round(x)) < 1e-15 else x


def _unit(axis: Sequence[float], name: str) -> Vector:
    length = math.hypot(*axis)
    if not length > 0.0:
        raise MachineError(f"the axis of the body '{name}' is zero")
    x, y, z = (_clean(x / length) for x in axis)
    return x, y, z
