"""The parts of a machine's drawing: bodies, actuators, pins and payload, in any pose."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from machine_fmu.description import GROUND
from machine_fmu.exact import plain
from machine_fmu.mechanism import Bar

from ...base.arrays import Vector
from .layout import Layout, distance

if TYPE_CHECKING:
    from machine_fmu.model import MachineModel

_PIN, _BOX = 0.05, 0.38
"""Radius of a pin, and side of the box that represents the payload of the description, in units."""

_HOUSING, _ROD, _LINK, _INSIDE = 0.12, 0.06, 0.09, 0.5
"""Widths of housing, rod and link in units, and the factor for an actuator inside a boom."""

_POINT = 1e-6
"""Radius in m of a corner between round ones."""

_BRACKET, _PLATE, _OVERHANG = 0.22, 0.12, 0.3
"""Half of a bracket's foot, margin of a plate around its pins, and of the base around its own, in units."""

_LAYERS = (
    *("base", "standing payload", "inner", "bracket", "body"),
    *("link", "rod", "housing", "payload", "pin"),
)
"""Looks of parts in the plane, the rear ones first."""


@dataclass(frozen=True)
class Part:
    """A part: all between discs (in space, spheres) around its points, or a closed line through them.

    Attributes:
        name: Its name.
        look: What it is, which gives its style.
        points: Positions, one row each, m.
        radii: Radii of the discs, m; all 0 for a closed line.
        faces: Of a convex solid in space, the points of each face.
        bar: Name of the actuator or link that it is part of; it has the colour of the actuator.
    """

    name: str
    look: str
    points: Vector
    radii: Vector
    faces: tuple[Sequence[int], ...] = ()
    bar: str = ""

    @property
    def is_line(self) -> bool:
        """Whether it is a closed line."""
        return not self.radii.any()


Posture = dict[str, Part]
"""The parts of a machine in a pose by name, the rear ones first in the plane."""


class MachineParts:
    """The parts of a machine.

    Attributes:
        unit: The length in m by which widths of parts grow.
        base: The part that does not move.
    """

    def __init__(self, model: "MachineModel") -> None:
        self._model, self._layout = model, Layout(model)
        self.unit = self._layout.unit
        self._bodies = [(body, part) for body in model.machine.bodies for part in self._build_body(body)]
        self._pins = list(self._place_pins())
        self.base = self._build_base()

    def postures(self, strokes: Vector, payload: Vector, passive: Vector | None = None) -> list[Posture]:
        """Return the parts in several poses.

        Args:
            strokes: Strokes in m, one row per pose.
            payload: Mass of the payload in kg for each pose, which gives the size of its box.
            passive: Coordinates in m or rad of what swings freely; as it hangs by default.
        """
        frames = self._model.frames(strokes, passive, payload)
        postures = []
        for row in range(len(strokes)):
            placed = {body: (origins[row], rotations[row]) for body, (origins, rotations) in frames.items()}
            parts = [self.base]
            parts += [_move_part(part, *placed[body]) for body, part in self._bodies]
            parts += [_move_part(part, *placed[body]) for body, part in self._build_box(float(payload[row]))]
            for bar in self._model.mechanism.bars:
                ends = [
                    placed[body][0] + placed[body][1] @ self._layout.at(end)
                    for end in (bar.start, bar.end)
                    for body in [self._layout.body_of(end)]
                ]
                parts += self._build_bar(bar, *ends)
            parts += [_move_part(part, *placed[body]) for body, part in self._pins]
            ordered = sorted(parts, key=lambda part: _LAYERS.index(part.look))
            postures.append({part.name: part for part in ordered})
        return postures

    def _build_body(self, body: str) -> Iterator[Part]:
        """Yield the parts of a body: its outline if it has one, a plate, or a beam with brackets."""
        layout, unit = self._layout, self.unit
        is_flat = self._model.dimensions == 2
        if body in layout.outlines:
            yield _build_outlined(body, layout.outlines[body], unit)
            return
        if layout.is_plate(body):
            pins = np.array([*layout.pins(body), *layout.joints(body)] or [np.zeros(self._model.dimensions)])
            margin = _PLATE * unit
            yield _build_hull(body, "body", pins, margin) if is_flat else _build_plate(body, pins, margin)
            return
        beam, width = layout.beam(body), layout.width(body)
        if beam is None:
            yield _build_hull(body, "body", np.zeros((1, self._model.dimensions)), width)
            return
        is_inner = layout.kind(body) == "prismatic"
        end_width = width if is_inner or layout.machine.bodies[body].joint.is_passive else 0.8 * width
        radii = 0.5 * np.array([width, end_width])
        yield Part(body, "inner" if is_inner else "body", np.array(beam), radii)
        for i, pin in enumerate([*layout.pins(body), *layout.joints(body)]):
            if distance(pin, *beam)[0] > _PIN * unit:
                yield _build_bracket(f"{body} bracket {i + 1}", beam, pin, unit)

    def _build_box(self, payload: float) -> Iterator[tuple[str, Part]]:
        """Yield the box of the payload, whose volume is proportional to its mass, and its body.

        Beside a beam or above a plate it rests on the body; otherwise it is around the point that carries it.
        """
        model, layout = self._model, self._layout
        if model.mechanism.payload is None:
            return
        body = layout.body_of(model.mechanism.payload)
        position = layout.at(model.mechanism.payload)
        # the volume is proportional to the mass
        growth = math.cbrt(max(payload, 0.0) / (model.payload or 1.0))
        n = model.dimensions
        look, axes, half = "payload", np.eye(n), np.full(n, 0.5 * growth * _BOX * self.unit)
        if body != GROUND:
            foot, along, thickness, span = self._find_foot(body, position)
            height = float(np.linalg.norm(position - foot)) - 0.5 * thickness
            if height > 0.5 * _BOX * self.unit:
                look, along = "standing payload", position - foot
                half = growth * np.array([height, *[min(1.3 * height, 0.35 * span)] * (n - 1)])
                position = foot + (0.5 * thickness + half[0]) * along / np.linalg.norm(along)
            if np.linalg.norm(along) > 0.0:
                axes = _find_directions(along)
        corners = np.array(np.meshgrid(*[(-1.0, 1.0)] * n, indexing="ij")).reshape(n, -1).T
        points = position + (corners * half) @ axes
        if n == 2:
            yield body, Part("payload", look, points[[0, 1, 3, 2]], np.zeros(4))
        else:
            yield body, replace(_build_solid("payload", points), look=look)

    def _find_foot(self, body: str, position: Vector) -> tuple[Vector, Vector, float, float]:
        """Return where a point is above a body, the body's direction there, its thickness and size in m."""
        beam = self._layout.beam(body)
        if beam is not None:
            direction = beam[1] - beam[0]
            foot, thickness = distance(position, *beam)[1], self._layout.width(body)
            return foot, direction, thickness, float(np.linalg.norm(direction))
        pins = np.array(self._layout.pins(body) or [position])
        middle = pins.mean(axis=0)
        return middle, position - middle, _PLATE * self.unit, float(np.ptp(pins, axis=0).max())

    def _build_bar(self, bar: Bar, start: Vector, end: Vector) -> Iterator[Part]:
        """Yield housing and rod of an actuator, or a link."""
        if not bar.is_actuator:
            link = _build_hull(bar.name, "link", np.array([start, end]), 0.5 * _LINK * self.unit)
            yield replace(link, bar=bar.name)
            return
        scale = _INSIDE if self._layout.is_inside(bar) else 1.0
        housing = start + float(plain(bar.length)) * (end - start) / max(np.linalg.norm(end - start), 1e-9)
        for look, end_of_part, width in (("rod", end, _ROD), ("housing", housing, _HOUSING)):
            radius = 0.5 * scale * width * self.unit
            yield replace(
                _build_hull(f"{bar.name} {look}", look, np.array([start, end_of_part]), radius), bar=bar.name
            )

    def _place_pins(self) -> Iterator[tuple[str, Part]]:
        """Yield a pin at each joint that turns, and at the ends of bars, with its body."""
        zero = np.zeros(self._model.dimensions)
        bodies = self._model.machine.bodies
        turning_bodies = [
            body for body in bodies if self._layout.kind(body) not in ("prismatic", "fixed", "free")
        ]
        pins = [(body, zero, f"pin of {body}", "") for body in turning_bodies]
        for bar in self._model.mechanism.bars:
            if not self._layout.is_inside(bar):
                pins += [
                    (self._layout.body_of(end), self._layout.at(end), f"{bar.name} {side}", bar.name)
                    for end, side in ((bar.start, "first pin"), (bar.end, "second pin"))
                ]
        loops = zip(self._model.machine.loops, self._model.mechanism.loops, strict=True)
        pins += [
            (self._layout.body_of(a), self._layout.at(a), f"pin of {name}", "") for name, (a, _) in loops
        ]
        for body, at, name, bar in pins:
            yield body, replace(_build_hull(name, "pin", at[None, :], _PIN * self.unit), bar=bar)

    def _build_base(self) -> Part:
        """Return the base: around the pins of the ground and its outline, or a foot below the pins."""
        layout, unit = self._layout, self.unit
        corners_of_ground = layout.outlines.get(GROUND)
        if corners_of_ground is not None and self._model.dimensions == 3:
            return replace(_build_outlined(GROUND, corners_of_ground, unit), look="base")
        joints = np.array(layout.joints(GROUND) or [np.zeros(self._model.dimensions)])
        pins = layout.pins(GROUND)
        is_free = all(layout.is_plate(body) for body in layout.children(GROUND))
        supports = np.array(pins if is_free and pins else [*joints, *pins])
        margin = _OVERHANG * unit
        low, high = supports.min(axis=0) - margin, supports.max(axis=0) + margin
        if self._model.dimensions == 2:
            feet = corners_of_ground
            if feet is None:
                feet = np.array([[low[0], low[1]], [high[0], low[1]]])
            radii = np.where([not any(np.array_equal(x, p) for p in pins) for x in supports], 0.16, 0.13)
            points, margins = np.concatenate([supports, feet]), np.full(len(feet), _POINT)
            return Part(GROUND, "base", points, np.concatenate([radii * unit, margins]))
        top = supports - np.array([0.0, 0.0, _PIN * unit])
        corners = np.array([[x, y, low[2]] for x in (low[0], high[0]) for y in (low[1], high[1])])
        if np.ptp(supports[:, 2]) < 0.1 * unit and len(supports) > 2:
            return replace(
                _build_plate(GROUND, top - [0.0, 0.0, _PLATE * unit], 2.0 * _PLATE * unit), look="base"
            )
        around = np.concatenate(
            [top + unit * _PLATE * np.array([x, y, 0.0]) for x in (-1, 1) for y in (-1, 1)]
        )
        return replace(_build_solid(GROUND, np.concatenate([corners, around])), look="base")


def _move_part(part: Part, origin: Vector, rotation: Vector) -> Part:
    return replace(part, points=origin + part.points @ rotation.T)


def _build_hull(name: str, look: str, points: Vector, radius: float) -> Part:
    return Part(name, look, points, np.full(len(points), radius))


def _build_outlined(body: str, corners: Vector, unit: float) -> Part:
    """Return the part within an outline; in space a plate or a convex solid."""
    if corners.shape[1] == 2:
        return Part(body, "body", corners, np.zeros(len(corners)))
    spread = np.linalg.svd(corners - corners.mean(axis=0), compute_uv=False)
    is_flat = spread[-1] < 1e-3 * spread[0]
    return _build_plate(body, corners, 0.0, 0.5 * _PLATE * unit) if is_flat else _build_solid(body, corners)


def _build_bracket(name: str, beam: tuple[Vector, Vector], pin: Vector, unit: float) -> Part:
    """Return the bracket of a pin beside a beam: from the beam's axis, around the pin."""
    start, end = beam
    along = (end - start) / np.linalg.norm(end - start)
    _, foot = distance(pin, start, end)
    feet = [distance(foot + side * _BRACKET * unit * along, start, end)[1] for side in (-1.0, 1.0)]
    thin = 0.2 * _PIN * unit
    return Part(name, "bracket", np.array([*feet, pin]), np.array([thin, thin, 1.7 * _PIN * unit]))


def _build_plate(name: str, pins: Vector, margin: float, half: float | None = None) -> Part:
    """Return a solid plate through points in space, with a margin around them."""
    middle = pins.mean(axis=0)
    axes = np.linalg.svd(pins - middle)[2]
    half = 0.5 * margin if half is None else half
    angles = np.linspace(0.0, 2.0 * math.pi, 12, endpoint=False)
    circle = margin * np.column_stack([np.cos(angles), np.sin(angles)]) @ axes[:2]
    flat = pins - np.outer((pins - middle) @ axes[2], axes[2])
    rim = (flat[:, None, :] + circle).reshape(-1, 3) if margin > 0.0 else flat
    return _build_solid(name, np.concatenate([rim + half * axes[2], rim - half * axes[2]]))


def _build_solid(name: str, points: Vector) -> Part:
    """Return the convex solid around points in space; points that are one get a size."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
    except QhullError:  # of no volume
        return _build_hull(name, "body", points, 0.0)
    groups = dict[tuple[float, ...], set[int]]()
    for corners, equation in zip(hull.simplices, hull.equations, strict=True):
        # Qhull divides a plane face into triangles
        groups.setdefault(tuple(np.round(equation, 6)), set()).update(map(int, corners))
    faces = tuple(_sort_around(points, sorted(group), np.array(plane[:3])) for plane, group in groups.items())
    return Part(name, "body", points, np.zeros(len(points)), faces)


def _sort_around(points: Vector, corners: list[int], normal: Vector) -> list[int]:
    """Return the corners of a face anticlockwise, as seen from outside."""
    _, first, second = _find_directions(normal)
    relative = points[corners] - points[corners].mean(axis=0)
    angles = np.arctan2(relative @ second, relative @ first)
    return [corners[i] for i in np.argsort(angles)]


def _find_directions(along: Vector) -> Vector:
    """Return a right-handed set of directions, one row each, whose first is the given one."""
    first = along / np.linalg.norm(along)
    if len(first) == 2:
        return np.array([first, [-first[1], first[0]]])
    # the axis farthest from the direction, so that the product is not small
    helper = np.eye(3)[int(np.argmin(np.abs(first)))]
    second = np.cross(first, helper)
    second = second / np.linalg.norm(second)
    return np.array([first, second, np.cross(first, second)], dtype=float)
