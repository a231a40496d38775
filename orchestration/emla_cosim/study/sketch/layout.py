"""What a machine looks like where no outline says it: beams, brackets, plates and pins, from its points."""

import math
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from machine_fmu.assembly import locate_outlines
from machine_fmu.description import GROUND
from machine_fmu.exact import plain
from machine_fmu.mechanism import Bar, End

from ...base.arrays import Vector

if TYPE_CHECKING:
    from machine_fmu.model import MachineModel

_SIZE, _LENGTH = 3.7, 1.0
"""Size of a machine and length of its actuators in m at which the unit of drawing is 1 m."""

_PIN_DISTANCE = 0.3
"""Distance of a pin from a beam in units above which it is beside the beam."""


class Layout:
    """Points of a machine by what they are for. All are in the frames of their bodies.

    Attributes:
        model: The machine.
        unit: The length in m by which widths of parts and radii of pins grow.
    """

    def __init__(self, model: "MachineModel") -> None:
        self.model, self.machine = model, model.machine
        self.outlines = {
            body: np.array([self.at(end) for end in corners])
            for body, corners in locate_outlines(self.machine).items()
        }
        points = np.array([at[0] for at in model.points(np.array([model.start])).values()])
        size = float(np.linalg.norm(np.ptp(points, axis=0)))
        lengths = [float(plain(bar.length)) for bar in model.mechanism.actuators]
        # between a size from the reach and one from the actuators: a machine can be large with small ones
        self.unit = math.sqrt(max(size, 1e-3) / _SIZE * float(np.median(lengths)) / _LENGTH)
        self._bodies = {model.ends[name].frame: name for name in (GROUND, *self.machine.bodies)}

    def at(self, end: End) -> Vector:
        """Return a point in the frame of its body, m."""
        return np.array([float(plain(x)) for x in end.at[: self.model.dimensions]])

    def point(self, name: str) -> Vector:
        """Return a point by BODY or BODY.POINT in the frame of its body, m."""
        return self.at(self.model.ends[name])

    def body_of(self, end: End) -> str:
        """Return the body of an end."""
        return self._bodies[end.frame]

    def kind(self, body: str) -> str:
        """Return the kind of a body's joint."""
        return self.machine.bodies[body].joint.kind

    def start(self, body: str) -> Vector:
        """Return the point of the parent where the joint of a body is."""
        joint = self.machine.bodies[body].joint
        return self.point(f"{joint.parent}.{joint.at}" if joint.at else joint.parent)

    def slide(self, body: str) -> Vector:
        """Return how far a prismatic body is moved along its axis at the start, in its parent's frame, m."""
        origins, _ = self._start_frames[body]
        parents, parent_rotations = self._start_frames[self.machine.bodies[body].joint.parent]
        return (origins[0] - parents[0]) @ parent_rotations[0] - self.start(body)

    def axis(self, body: str) -> Vector:
        """Return the axis of a prismatic body in its own frame."""
        axis = np.array(self.machine.bodies[body].joint.axis[: self.model.dimensions], dtype=float)
        return axis / np.linalg.norm(axis)

    def children(self, body: str) -> list[str]:
        """Return the bodies whose joints are on a body."""
        return [name for name, child in self.machine.bodies.items() if child.joint.parent == body]

    def joints(self, body: str) -> list[Vector]:
        """Return the points of a body where its children are; for those that slide along it, two."""
        points = []
        for child in self.children(body):
            points.append(self.start(child))
            if self.kind(child) == "prismatic" and not self.is_inner(child):
                points.append(points[-1] + self.slide(child))
        return points

    def pins(self, body: str) -> list[Vector]:
        """Return the ends of actuators, links and loops on a body, without actuators inside beams."""
        ends = [
            end
            for bar in self.model.mechanism.bars
            if not self.is_inside(bar)
            for end in (bar.start, bar.end)
        ]
        ends += [end for loop in self.model.mechanism.loops for end in loop]
        return [self.at(end) for end in ends if self.body_of(end) == body]

    def payload(self, body: str) -> Vector | None:
        """Return the point of a body that carries the payload; None if another body does."""
        end = self.model.mechanism.payload
        return None if end is None or self.body_of(end) != body else self.at(end)

    def is_plate(self, body: str) -> bool:
        """Return whether a body is drawn around its pins, because no joint carries it."""
        return self.kind(body) == "free"

    def beam(self, body: str) -> tuple[Vector, Vector] | None:
        """Return both ends of the axis of a body that is a beam; None if it is a plate, or small."""
        if self.is_plate(body):
            return None
        payload = self.payload(body)
        ends = self.joints(body) + ([] if payload is None else [payload])
        start = np.zeros(self.model.dimensions)
        # children at its own joint say nothing of its length
        if np.linalg.norm(max(ends, key=np.linalg.norm, default=start)) < 0.5 * _PIN_DISTANCE * self.unit:
            names = [f"{body}.{point}" for point in self.machine.points(body)]
            ends += [*self.pins(body), *map(self.point, names)]
        end = max(ends, key=np.linalg.norm, default=start)
        if self.kind(body) == "prismatic":
            start = -self._find_overlap(body) * self.axis(body) if self.is_inner(body) else start
        return (start, end) if np.linalg.norm(end - start) > 0.5 * _PIN_DISTANCE * self.unit else None

    def width(self, body: str) -> float:
        """Return the width of a beam in m at its start."""
        if self.machine.bodies[body].joint.is_passive:
            return 0.045 * self.unit
        beam = self.beam(body)
        if beam is None:
            return 0.1 * self.unit
        parent = self.machine.bodies[body].joint.parent
        if self.is_inner(body):
            return 0.55 * self.width(parent)
        # long beams are slender
        return 0.12 * math.sqrt(float(np.linalg.norm(beam[1] - beam[0])) * 1.75 * self.unit)

    def is_inner(self, body: str) -> bool:
        """Return whether a body slides out of its parent, as a telescope does."""
        return self.kind(body) == "prismatic" and self._find_overlap(body) > _PIN_DISTANCE * self.unit

    def is_inside(self, bar: Bar) -> bool:
        """Return whether an actuator is inside the beams that it moves."""
        body, moving = self.body_of(bar.start), self.body_of(bar.end)
        if not bar.is_actuator or GROUND in (body, moving) or self.kind(moving) != "prismatic":
            return False
        beam = self.beam_of_start(body)
        near = 0.5 * self.width(body)
        return beam is not None and distance(self.at(bar.start), *beam)[0] < near and bar.slide is not None

    def beam_of_start(self, body: str) -> tuple[Vector, Vector] | None:
        """Return the axis of a body from its own joint to those of its children; None without children."""
        ends = self.joints(body)
        return (np.zeros(self.model.dimensions), max(ends, key=np.linalg.norm)) if ends else None

    def _find_overlap(self, body: str) -> float:
        """Return the length in m of the parent behind the joint of a prismatic body."""
        parent = self.machine.bodies[body].joint.parent
        relative_rotation = self._start_frames[parent][1][0].T @ self._start_frames[body][1][0]
        return 0.0 if parent == GROUND else float(self.start(body) @ relative_rotation @ self.axis(body))

    @cached_property
    def _start_frames(self) -> dict[str, tuple[Vector, Vector]]:
        return self.model.frames(np.array([self.model.start]))


def distance(point: Vector, start: Vector, end: Vector) -> tuple[float, Vector]:
    """Return the distance of a point from a segment in m, and the nearest point of the segment."""
    direction = end - start
    share = float(np.clip((point - start) @ direction / (direction @ direction), 0.0, 1.0))
    foot = start + share * direction
    return float(np.linalg.norm(point - foot)), foot
