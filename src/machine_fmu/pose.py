"""Where the frames of a mechanism are, and how they move."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

from fmublock import cos, sin

from .exact import ONE, ZERO, is_zero, plain
from .mechanism import Bar, End, Mechanism
from .vectors import (
    IDENTITY,
    NONE,
    Matrix,
    Vector,
    about,
    add,
    compose,
    cross,
    dot,
    is_none,
    norm,
    scale,
    subtract,
    turn,
)


class Angle(NamedTuple):
    """An angle by its cosine and sine, as triangles give it."""

    cosine: Any
    sine: Any

    @classmethod
    def of(cls, angle: Any) -> "Angle":
        """Return the angle of a number in rad."""
        return cls(cos(plain(angle)), sin(plain(angle)))


class Lever(NamedTuple):
    """The triangle of a bar and the frame that it turns."""

    coordinate: int
    slope: Any
    """Length of the bar per angle, m: the distance of the frame's axis from the bar."""
    along: Any
    """Part of the moving pin's arm along the bar, m."""


@dataclass
class Pose:
    """Positions of frames, as far as their coordinates are known.

    `values` has coordinates by number: an `Angle` of a frame that turns, a distance of one that slides.
    `numbers` has those that Newton's method found, in m and rad, `changes` their last changes. `levers` has
    triangles by bar; they do not wait for the positions of pins, so that processors can compute both at once.
    """

    mechanism: Mechanism
    values: dict[int, Any] = field(default_factory=dict)
    levers: dict[str, Lever] = field(default_factory=dict)
    numbers: dict[int, Any] = field(default_factory=dict)
    changes: dict[int, Any] = field(default_factory=dict)
    _rotations: dict[int, Matrix] = field(default_factory=dict, repr=False)
    _arms: dict[int, Vector] = field(default_factory=dict, repr=False)
    _axes: dict[int, Vector] = field(default_factory=dict, repr=False)

    def with_numbers(self, numbers: dict[int, Any]) -> "Pose":
        """Return a pose with further coordinates, given in m and rad."""
        return Pose(self.mechanism, {**self.values, **{i: self.value(i, x) for i, x in numbers.items()}})

    def value(self, coordinate: int, number: Any) -> Any:
        """Return a coordinate in m or rad as `values` has it."""
        frame = self.mechanism.frames[self.mechanism.frame_of(coordinate)]
        return number if frame.slides else Angle.of(number)

    def rotation(self, frame: int) -> Matrix:
        """Return the rotation of a frame."""
        if frame not in self._rotations:
            of = self.mechanism.frames[frame]
            R = self.base_rotation(frame)
            if of.coordinate is not None and not of.slides:
                R = compose(R, about(of.axis, *self.values[of.coordinate]))
            self._rotations[frame] = R
        return self._rotations[frame]

    def base_rotation(self, frame: int) -> Matrix:
        """Return the rotation of a frame at a coordinate of 0."""
        of = self.mechanism.frames[frame]
        return IDENTITY if of.parent < 0 else compose(self.rotation(of.parent), of.rotation)

    def axis(self, frame: int) -> Vector:
        """Return the axis of a frame."""
        if frame not in self._axes:
            self._axes[frame] = turn(self.base_rotation(frame), self.mechanism.frames[frame].axis)
        return self._axes[frame]

    def arm(self, frame: int) -> Vector:
        """Return the origin of a frame relative to that of its parent, in m."""
        if frame not in self._arms:
            of = self.mechanism.frames[frame]
            arm = NONE if of.parent < 0 else turn(self.rotation(of.parent), of.at)
            if of.slides and of.coordinate is not None:
                arm = add(arm, scale(self.values[of.coordinate], self.axis(frame)))
            self._arms[frame] = arm
        return self._arms[frame]

    def reach(self, end: End) -> Vector:
        """Return an end relative to the origin of its frame, in m."""
        return turn(self.rotation(end.frame), end.at)

    def point(self, end: End) -> Vector:
        """Return the position of an end in m."""
        return self.apart(End(0, NONE), end)

    def apart(self, start: End, end: End) -> Vector:
        """Return the position of one end relative to another one in m."""
        to_start, to_end = self.mechanism.paths(start.frame, end.frame)
        from_carrier = [self.reach(start), self.reach(end)]
        for i, path in enumerate((to_start, to_end)):
            for frame in reversed(path):
                from_carrier[i] = add(self.arm(frame), from_carrier[i])
        return subtract(from_carrier[1], from_carrier[0])


class Direction(NamedTuple):
    """A bar's length in m and its direction from start to end."""

    length: Any
    u: Vector


def direction(pose: Pose, bar: Bar, length: Any = None) -> Direction:
    """Return length and direction of a bar; `length` if it is known."""
    apart = pose.apart(bar.start, bar.end)
    if bar.slide is not None:
        axis = pose.axis(bar.slide)
        return Direction(dot(axis, apart) if length is None else length, axis)
    length = norm(apart) if length is None else length
    return Direction(length, scale(ONE / length, apart))


@dataclass
class Relative:
    """Motion of two ends from their last common carrier, as if it were at rest.

    `rates` and `growths` are the coordinates' speeds and accelerations by number; missing ones are zero.
    """

    pose: Pose
    start: End
    end: End
    rates: dict[int, Any]
    growths: dict[int, Any]

    def speed(self) -> Vector:
        """Return the velocity of the end relative to the start, m/s."""
        return subtract(self._of(self.end)[0], self._of(self.start)[0])

    def acceleration(self) -> Vector:
        """Return the acceleration of the end relative to the start, m/s2."""
        return subtract(self._of(self.end)[1], self._of(self.start)[1])

    def _of(self, end: End) -> tuple[Vector, Vector]:
        paths = self.pose.mechanism.paths(self.start.frame, self.end.frame)
        motion = AT_REST
        for frame in paths[0] if end is self.start else paths[1]:
            motion = carry(self.pose, motion, frame, self.rates, self.growths)
        arm = self.pose.reach(end)
        return motion.speed_at(arm), motion.acceleration_at(arm)


class Motion(NamedTuple):
    """Velocity and acceleration of a frame's origin, its angular velocity and acceleration."""

    v: Vector
    a: Vector
    omega: Vector
    alpha: Vector

    def speed_at(self, arm: Vector) -> Vector:
        """Return the velocity of a point at `arm` from the origin."""
        return add(self.v, cross(self.omega, arm))

    def acceleration_at(self, arm: Vector) -> Vector:
        """Return the acceleration of a point at `arm` from the origin."""
        return add(self.a, swing(self.omega, self.alpha, arm))


AT_REST = Motion(NONE, NONE, NONE, NONE)


def swing(omega: Vector, alpha: Vector, arm: Vector) -> Vector:
    """Return alpha x arm + omega x (omega x arm)."""
    across = cross(alpha, arm)
    if is_none(omega):
        return across
    if all(is_zero(x) for x in (*omega[:2], arm[2])):  # in the plane
        return add(across, scale(-(omega[2] * omega[2]), arm))
    return add(across, cross(omega, cross(omega, arm)))


def carry(pose: Pose, carrier: Motion, frame: int, rates: dict[int, Any], growths: dict[int, Any]) -> Motion:
    """Return the motion of a frame from that of its parent."""
    of = pose.mechanism.frames[frame]
    arm = pose.arm(frame)
    v, a = carrier.speed_at(arm), carrier.acceleration_at(arm)
    if of.coordinate is None:
        return Motion(v, a, carrier.omega, carrier.alpha)
    axis = pose.axis(frame)
    along, growth = (scale(x.get(of.coordinate, ZERO), axis) for x in (rates, growths))
    if of.slides:
        coriolis = cross(carrier.omega, along)
        a = add(a, add(growth, add(coriolis, coriolis)))
        return Motion(add(v, along), a, carrier.omega, carrier.alpha)
    alpha = add(add(carrier.alpha, growth), cross(carrier.omega, along))
    return Motion(v, a, add(carrier.omega, along), alpha)
