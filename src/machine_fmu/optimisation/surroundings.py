"""Points and axes of a machine, and their distances from the ground and from the machine's own base.

Distances are those of axes and pins, so clearances must cover half of the widths of bodies.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..description import GROUND, Body
from ..model import MachineModel

Points = Mapping[str, np.ndarray]
"""Positions in m by name of the point, one row per pose."""


@dataclass(frozen=True)
class Approach:
    """The smallest distance of a motion from an obstacle.

    `distance` and the place `x`, `y`, in space also `z`, are in m, `time` in s. `part` is the part of the
    machine that is there.
    """

    distance: float
    part: str
    x: float
    y: float
    z: float | None
    time: float


@dataclass(frozen=True)
class Axis:
    """A straight line of a part of the machine between two of its points, by their names."""

    part: str
    start: str
    end: str


def moving_points(machine: MachineModel) -> dict[str, str]:
    """Return the points that move, each with what messages call it.

    A body's origin is left out where it is another point, as at a pin.
    """
    labels = dict[str, str]()
    fixed = _find_fixed_bodies(machine)
    for name, body in machine.machine.bodies.items():
        if name in fixed:
            continue
        if _slides(body):
            labels[name] = f"the origin of '{name}'"
        for point in machine.machine.points(name):
            labels[f"{name}.{point}"] = f"the point {name}.{point}"
    if machine.machine.payload is not None:
        tip = machine.machine.payload.at
        labels.pop(tip, None)
        labels[tip] = "the tip"
    return labels


def axes(machine: MachineModel) -> list[Axis]:
    """Return the axes of all bodies that carry something, from their origin to what they carry.

    These are joints of other bodies and the payload; of a body without any, they are all its points. Bodies
    that turn about a point of the ground touch it, and are left out.
    """
    fixed = _find_fixed_bodies(machine)
    return [
        axis
        for name, body in machine.machine.bodies.items()
        if name not in fixed and (body.joint.parent not in fixed or _slides(body))
        for axis in _list_body_axes(machine, name, _list_carried_points(machine, name))
    ]


def all_lines(machine: MachineModel) -> list[Axis]:
    """Return lines from origins of moving bodies to all their points, and those of actuators and links."""
    lines, fixed = list[Axis](), _find_fixed_bodies(machine)
    for name in machine.machine.bodies:
        if name not in fixed:
            points = [f"{name}.{point}" for point in machine.machine.points(name)]
            lines += _list_body_axes(
                machine, name, [*dict.fromkeys([*points, *_list_carried_points(machine, name)])]
            )
    for name, strut in machine.machine.struts():
        if not all(end.partition(".")[0] in fixed for end in strut.ends):
            lines.append(Axis(f"'{name}'", *strut.ends))
    return lines


def ground_approach(machine: MachineModel, ground: float, times: np.ndarray, points: Points) -> Approach:
    """Return the smallest height above the ground of all points of the machine that move."""
    approaches = list[Approach]()
    for name, part in moving_points(machine).items():
        heights = points[name][:, -1]
        i = int(np.nanargmin(heights))
        approaches.append(_build_approach(float(heights[i]) - ground, part, points[name][i], times[i]))
    return min(approaches, key=lambda approach: approach.distance)


def base_approach(machine: MachineModel, times: np.ndarray, points: Points) -> Approach | None:
    """Return the smallest distance of all axes from the machine's base; 0 if they touch, None without a base.

    The base is the convex hull of the ground's outline and of the moving pins of the actuators on the ground,
    in the plane. The distance is that from all lines that join two of its corners.
    """
    if not len(machine.outline) or machine.dimensions == 3:
        return None
    rows, fixed = len(times), _find_fixed_bodies(machine)
    corners = [np.broadcast_to(corner, (rows, 2)) for corner in machine.outline]
    for actuator in machine.machine.actuators.values():
        on_ground = [end.partition(".")[0] in fixed for end in actuator.ends]
        corners += [
            points[end]
            for end, is_fixed in zip(actuator.ends, on_ground, strict=True)
            if any(on_ground) and not is_fixed
        ]
    approaches = [
        nearest(segment_distances(points[axis.start], points[axis.end], a, b), axis.part, times)
        for axis in axes(machine)
        for a, b in combinations(corners, 2)
    ]
    return min(approaches, key=lambda approach: approach.distance, default=None)


def nearest(measured: tuple[np.ndarray, np.ndarray], part: str, times: np.ndarray) -> Approach:
    """Return the approach of a part with these distances and nearest points, one row for each time in s."""
    distances, points = measured
    i = int(np.nanargmin(distances))
    return _build_approach(float(distances[i]), part, points[i], times[i])


def segment_distances(
    a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the distances of the segments ab and cd in the plane in each row, and nearest points on ab."""
    pairs: Sequence[tuple[np.ndarray, np.ndarray]] = [
        *(point_distances(point, a, b) for point in (c, d)),
        *((point_distances(point, c, d)[0], point) for point in (a, b)),
    ]
    distances, points = np.array([x for x, _ in pairs]), np.array([x for _, x in pairs])
    nearest, rows = np.argmin(distances, axis=0), np.arange(len(a))
    side_of_a, side_of_b = _compute_side(c, d, a), _compute_side(c, d, b)
    is_crossing = (_compute_side(a, b, c) * _compute_side(a, b, d) < 0.0) & (side_of_a * side_of_b < 0.0)
    # parallel segments would divide by 0
    parts = np.divide(side_of_a, side_of_a - side_of_b, out=np.zeros_like(side_of_a), where=is_crossing)
    intersections = a + parts[:, None] * (b - a)
    nearest_places = np.where(is_crossing[:, None], intersections, points[nearest, rows])
    return np.where(is_crossing, 0.0, distances[nearest, rows]), nearest_places


def point_distances(point: np.ndarray, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the distances of a point from the segment ab in each row, and the nearest points on ab."""
    direction = b - a
    part = np.sum((point - a) * direction, axis=1) / np.maximum(np.sum(direction * direction, axis=1), 1e-300)
    foot = a + np.clip(part, 0.0, 1.0)[:, None] * direction
    return np.linalg.norm(point - foot, axis=1), foot


def _list_body_axes(machine: MachineModel, name: str, ends: Sequence[str]) -> list[Axis]:
    joint, part = machine.machine.bodies[name].joint, f"'{name}'"
    body_axes = [Axis(part, name, end) for end in ends if end != name]
    if joint.kind == "prismatic":
        body_axes.append(Axis(part, f"{joint.parent}.{joint.at}" if joint.at else joint.parent, name))
    return body_axes


def _list_carried_points(machine: MachineModel, name: str) -> list[str]:
    """Return the points of a body that carry bodies or the payload; all its points if there are none."""
    joints = [body.joint for body in machine.machine.bodies.values() if body.joint.parent == name]
    points = [f"{name}.{joint.at}" for joint in joints if joint.at]
    payload = machine.machine.payload
    if payload is not None and payload.at.partition(".")[0] == name:
        points.append(payload.at)
    return points or [f"{name}.{point}" for point in machine.machine.points(name)]


def _slides(body: Body) -> bool:
    return body.joint.kind in ("prismatic", "free")


def _find_fixed_bodies(machine: MachineModel) -> set[str]:
    """Return the ground and the bodies that do not move."""
    fixed = {GROUND}
    for name, body in machine.machine.bodies.items():
        if body.joint.kind == "fixed" and body.joint.parent in fixed:
            fixed.add(name)
    return fixed


def _build_approach(distance: float, part: str, position: np.ndarray, time: float) -> Approach:
    x, y, *further = position.tolist()
    return Approach(distance, part, x, y, further[0] if further else None, float(time))


def _compute_side(a: np.ndarray, b: np.ndarray, point: np.ndarray) -> np.ndarray:
    return (b - a)[:, 0] * (point - a)[:, 1] - (b - a)[:, 1] * (point - a)[:, 0]
