"""A machine with its numbers: frames with one coordinate each, their inertia, and bars between them.

Joints with several coordinates become frames without mass in between. Numbers are floats or symbols, and
exact where the description has 0, 1 or -1 without a name.
"""

from dataclasses import dataclass
from typing import Any

from .description import Machine
from .exact import ZERO, is_zero
from .inertia import NO_INERTIA, Inertia
from .vectors import Matrix, Vector, add, cross, dot, subtract, turn


@dataclass(frozen=True)
class Frame:
    """A frame that turns about its axis, slides along it, or is fixed, at a point of its parent.

    Attributes:
        name: The coordinate's name; that of the body for a fixed frame.
        parent: Number of the parent; -1 for the ground.
        coordinate: Number of the coordinate; None for a fixed frame.
        slides: Whether it slides.
        at: The frame's origin in the parent at a coordinate of 0.
        rotation: Its rotation in the parent at a coordinate of 0.
        axis: Its axis, of length 1.
        inertia: Of all that moves with it.
    """

    name: str
    parent: int
    coordinate: int | None
    slides: bool
    at: Vector
    rotation: Matrix
    axis: Vector
    inertia: Inertia = NO_INERTIA


@dataclass(frozen=True)
class End:
    """A point of a frame."""

    frame: int
    at: Vector


@dataclass(frozen=True)
class Bar:
    """An actuator or a link between two ends; see `Actuator` for its numbers.

    Attributes:
        length: Length of a link, or of an actuator at stroke 0; None for a link as in the assembly pose.
        is_actuator: Whether its length is that and a stroke.
        slide: The frame whose slide it is parallel to, with its ends on frame and parent; its masses are
            part of these then.
    """

    name: str
    start: End
    end: End
    length: Any
    is_actuator: bool
    m: Any
    c: Any
    J: Any
    rod_m: Any = ZERO
    rod_c: Any = ZERO
    rod_J: Any = ZERO
    slide: int | None = None

    @property
    def has_mass(self) -> bool:
        """Whether it has an inertia of its own."""
        return self.slide is None and not all(is_zero(x) for x in (self.m, self.rod_m, self.J, self.rod_J))


@dataclass(frozen=True)
class Mechanism:
    """All frames, the first of which is the ground, and what connects them.

    Attributes:
        machine: The description.
        frames: Each follows its parent.
        bars: Actuators, then links.
        loops: Pairs of ends that coincide.
        passive: Coordinates that are free.
        gravity: Acceleration of free fall.
        payload: Where the payload is.
        actuator_masses: Masses of the actuators without their motors, kg.
        dampings: Torque or force per speed of the passive coordinates.
    """

    machine: Machine
    frames: tuple[Frame, ...]
    bars: tuple[Bar, ...]
    loops: tuple[tuple[End, End], ...]
    passive: tuple[int, ...]
    gravity: Vector
    payload: End | None
    actuator_masses: tuple[Any, ...]
    dampings: tuple[Any, ...]

    @property
    def coordinates(self) -> int:
        """Number of coordinates."""
        return sum(frame.coordinate is not None for frame in self.frames)

    @property
    def is_plane(self) -> bool:
        """Whether it moves in the plane."""
        return self.machine.dimensions == 2

    @property
    def actuators(self) -> tuple[Bar, ...]:
        """The bars that are actuators."""
        return tuple(bar for bar in self.bars if bar.is_actuator)

    def frame_of(self, coordinate: int) -> int:
        """Return the number of the frame with a coordinate."""
        return next(i for i, frame in enumerate(self.frames) if frame.coordinate == coordinate)

    def beside_slide(self, bar: Bar) -> Any:
        """Return the square of the distance in m2 between a bar that is parallel to a slide and its axis."""
        assert bar.slide is not None
        frame = self.frames[bar.slide]
        apart = subtract(add(frame.at, turn(frame.rotation, bar.end.at)), bar.start.at)
        across = cross(turn(frame.rotation, frame.axis), apart)
        return dot(across, across)

    def ancestors(self, frame: int) -> list[int]:
        """Return a frame and all that carry it, from the frame to the ground."""
        found = []
        while frame >= 0:
            found.append(frame)
            frame = self.frames[frame].parent
        return found

    def paths(self, a: int, b: int) -> tuple[list[int], list[int]]:
        """Return the frames from the last common carrier of two frames to each of them, without it."""
        of_a, of_b = self.ancestors(a), self.ancestors(b)
        common = set(of_a) & set(of_b)
        return [f for f in reversed(of_a) if f not in common], [f for f in reversed(of_b) if f not in common]

    def carrier(self, a: int, b: int) -> int:
        """Return the last common carrier of two frames."""
        return next(f for f in self.ancestors(a) if f in self.ancestors(b))
