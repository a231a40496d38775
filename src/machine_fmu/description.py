"""The description of a machine: bodies in a tree, actuators between points, links and loops.

A number of the description is a float, or the name of one of its `parameters`, with a minus sign in front of
it if the negative is meant. Lengths are in m, masses in kg, angles in rad.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

Number = float | str
"""A float, or the name of a parameter."""

GROUND = "ground"
"""The body that does not move."""

JointKind = Literal["revolute", "prismatic", "universal", "spherical", "free", "fixed"]

COORDINATES: Mapping[str, tuple[str, ...]] = {
    "revolute": ("",),
    "prismatic": ("",),
    "universal": (".1", ".2"),
    "spherical": (".x", ".y", ".z"),
    "free": (".px", ".py", ".pz", ".x", ".y", ".z"),
    "fixed": (),
}
"""Ends of the names of a joint's coordinates in space, by kind."""

COORDINATES_IN_PLANE: Mapping[str, tuple[str, ...]] = {
    "revolute": ("",),
    "prismatic": ("",),
    "free": (".px", ".py", ".z"),
    "fixed": (),
}
"""The same in the plane, where joints turn about z."""


class MachineError(ValueError):
    """A machine is wrong, or it cannot take a pose."""


@dataclass(frozen=True)
class Parameter:
    """A number with a name, which can vary.

    Attributes:
        value: Its value.
        unit: Its unit.
        about: Its meaning.
        minimum: Lowest value, if there is one.
        maximum: Highest value, if there is one.
        symbol: Symbol in equations, as LaTeX; from its name by default.
    """

    value: float
    unit: str = ""
    about: str = ""
    minimum: float | None = None
    maximum: float | None = None
    symbol: str | None = None


@dataclass(frozen=True)
class Point:
    """A point of a body: x, y and z, or radius and angle about z, from the frame or from another point."""

    position: tuple[Number, ...] = ()
    polar: tuple[Number, Number] | None = None
    origin: str | None = None


@dataclass(frozen=True)
class Joint:
    """The joint of a body with its parent, at a point of the parent; the body's own frame is there.

    Attributes:
        kind: How the body moves relative to its parent.
        parent: The parent's name.
        at: A point of the parent; empty for its frame.
        axis: Direction of a revolute or prismatic joint; both axes of a universal one.
        rotation: Roll, pitch and yaw of the body's frame at joint coordinates of 0.
        assembly: Joint coordinates of the assembly pose, in m and rad.
        is_passive: Whether the coordinates are free, as those of a load on a hook.
        damping: Torque or force per speed of each passive coordinate, N m s/rad or N s/m.
    """

    kind: JointKind
    parent: str = GROUND
    at: str = ""
    axis: tuple[float, ...] = (0.0, 0.0, 1.0)
    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    assembly: tuple[float, ...] = ()
    is_passive: bool = False
    damping: Number = 0.0


@dataclass(frozen=True)
class Body:
    """A rigid body.

    Attributes:
        joint: The joint with its parent.
        m: Mass.
        c: Centre of mass in its frame.
        J: Inertia about the centre of mass: about z in the plane; xx, yy, zz, and optionally xy, xz, yz in
            space.
        points: Points of the body by name.
        outline: Corners of its outline, for pictures and distances; without, pictures draw its points.
    """

    joint: Joint
    m: Number = 0.0
    c: tuple[Number, ...] = ()
    J: tuple[Number, ...] = ()
    points: Mapping[str, Point] = field(default_factory=dict)
    outline: tuple[Point, ...] = ()


@dataclass(frozen=True)
class Strut:
    """A slender part between two points, each written BODY.POINT.

    Its inertia counts across its axis only. `c` and `J` are those of the part that is fixed to the first
    point: distance of the centre of mass from it, and inertia about the centre.
    """

    ends: tuple[str, str]
    m: Number = 0.0
    c: Number = 0.0
    J: Number = 0.0


@dataclass(frozen=True)
class Link(Strut):
    """A strut of constant length; without `length`, the one of the assembly pose."""

    length: Number | None = None


@dataclass(frozen=True)
class Actuator(Strut):
    """A strut whose length is `L_0` and a stroke: a housing at the first point, a rod at the second.

    `m` is the mass of both without the motor, which is fixed to the housing; `rod_share` of it is the rod's.
    `c` and `J` are those of housing and motor. `rod_c` is the distance of the rod's centre of mass from the
    second point. `start` is the stroke at the start of a run; without, that of the assembly pose. The rod's
    inertia along the screw is in the equations of the actuator, not in those of the
    machine; its weight, and its inertia through the motion of what carries it, are here.
    """

    L_0: Number = 0.0
    motor_m: Number = 0.0
    rod_share: Number = 0.0
    rod_c: Number = 0.0
    rod_J: Number = 0.0
    stroke: tuple[Number, Number] = (0.0, 1.0)
    start: float | None = None


@dataclass(frozen=True)
class Payload:
    """A mass at a point, written BODY.POINT, with an inertia per mass about this point.

    If `has_force`, the force of a process acts on it, such as that of digging: an input of the blocks.
    """

    at: str
    m: float = 0.0
    J: Number = 0.0
    has_force: bool = False


@dataclass(frozen=True)
class Machine:
    """All of a machine.

    Attributes:
        dimensions: 2 for a machine in the plane, with x horizontal and y up, or 3.
        bodies: Bodies by name; each parent precedes its children.
        ground: Points of the ground by name.
        actuators: Actuators by name; their order is that of strokes and forces.
        links: Parts of constant length by name.
        loops: Pairs of points that coincide, each written BODY.POINT.
        payload: What the machine carries.
        parameters: Numbers with names.
        gravity: Gravitational acceleration, m/s2.
        outline: Corners of the outline of the base, which does not move.
    """

    dimensions: Literal[2, 3]
    bodies: Mapping[str, Body]
    ground: Mapping[str, Point] = field(default_factory=dict)
    actuators: Mapping[str, Actuator] = field(default_factory=dict)
    links: Mapping[str, Link] = field(default_factory=dict)
    loops: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    payload: Payload | None = None
    parameters: Mapping[str, Parameter] = field(default_factory=dict)
    gravity: Number = 9.81
    outline: tuple[Point, ...] = ()

    def coordinates(self, body: str) -> list[str]:
        """Return the names of the coordinates of a body's joint."""
        kinds = COORDINATES if self.dimensions == 3 else COORDINATES_IN_PLANE
        kind = self.bodies[body].joint.kind
        if kind not in kinds:
            raise MachineError(
                f"the joint of the body '{body}' is {kind}; in the plane it must be one of {', '.join(kinds)}"
            )
        return [f"{body}{end}" for end in kinds[kind]]

    def value(self, number: Number) -> float:
        """Return the value of a number of the description."""
        if not isinstance(number, str):
            return float(number)
        value = self.parameters[number.removeprefix("-")].value
        return -value if number.startswith("-") else value

    def points(self, body: str) -> Mapping[str, Point]:
        """Return the points of a body, or of the ground."""
        return self.ground if body == GROUND else self.bodies[body].points

    def split(self, place: str, what: str) -> tuple[str, str]:
        """Return body and point of a place, written BODY.POINT; the point is empty for the body's frame.

        Args:
            place: The place.
            what: What has this place, for messages.

        Raises:
            MachineError: There is no such body or point.
        """
        body, _, point = place.partition(".")
        if body != GROUND and body not in self.bodies:
            raise MachineError(_unknown(what, place, f"body '{body}'", [GROUND, *self.bodies]))
        points = self.points(body)
        if point and point not in points:
            raise MachineError(_unknown(what, place, f"point '{point}' of '{body}'", points))
        return body, point

    def struts(self) -> Iterator[tuple[str, Strut]]:
        """Yield actuators and links with their names."""
        yield from self.actuators.items()
        yield from self.links.items()


def _unknown(what: str, place: str, part: str, existing: Sequence[str] | Mapping[str, object]) -> str:
    names = ", ".join(existing) or "none"
    return f"{what} is at '{place}', but there is no {part}; existing: {names}"
