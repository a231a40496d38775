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
    found = dict[str, str]()
    fixed = _fixed(machine)
    for name, body in machine.machine.bodies.items():
        if name in fixed:
            continue
        if _slides(body):
            found[name] = f"the origin of '{name}'"
        for point in machine.machine.points(name):
            found[f"{name}.{point}"] = f"the point {name}.{point}"
    if machine.machine.payload is not None:
        at = machine.machine.payload.at
        found.pop(at, None)
        found[at] = "the tip"
    return found


def axes(machine: MachineModel) -> list[Axis]:
    """Return the axes of all bodies that carry something, from their origin to what they carry.

    These are joints of other bodies and the payload; of a body without any, they are all its points. Bodies
    that turn about a point of the ground touch it, and are left out.
    """
    fixed = _fixed(machine)
    return [
        axis
        for name, body in machine.machine.bodies.items()
        if name not in fixed and (body.joint.parent not in fixed or _slides(body))
        for axis in _body_axes(machine, name, _carried(machine, name))
    ]


def all_lines(machine: MachineModel) -> list[Axis]:
    """Return lines from origins of moving bodies to all their points, and those of actuators and links."""
    found, fixed = list[Axis](), _fixed(machine)
    for name in machine.machine.bodies:
        if name not in fixed:
            points = [f"{name}.{point}" for point in machine.machine.points(name)]
            found += _body_axes(machine, name, [*dict.fromkeys([*points, *_carried(machine, name)])])
    for name, strut in machine.machine.struts():
        if not all(place.partition(".")[0] in fixed for place in strut.ends):
            found.append(Axis(f"'{name}'", *strut.ends))
    return found


def ground_approach(machine: MachineModel, ground: float, times: np.ndarray, at: Points) -> Approach:
    """Return the smallest height above the ground of all points of the machine that move."""
    found = list[Approach]()
    for name, part in moving_points(machine).items():
        heights = at[name][:, -1]
        i = int(np.nanargmin(heights))
        found.append(_approach(float(heights[i]) - ground, part, at[name][i], times[i]))
    return min(found, key=lambda approach: approach.distance)


def base_approach(machine: MachineModel, times: np.ndarray, at: Points) -> Approach | None:
    """Return the smallest distance of all axes from the machine's base; 0 if they touch, None without a base.

    The base is the convex hull of the ground's outline and of the moving pins of the actuators on the ground,
    in the plane. The distance is that from all lines that join two of its corners.
    """
    if not len(machine.outline) or machine.dimensions == 3:
        return None
    rows, fixed = len(times), _fixed(machine)
    corners = [np.broadcast_to(corner, (rows, 2)) for corner in machine.outline]
    for actuator in machine.machine.actuators.values():
        on_ground = [end.partition(".")[0] in fixed for end in actuator.ends]
        corners += [
            at[end]
            for end, is_fixed in zip(actuator.ends, on_ground, strict=True)
            if any(on_ground) and not is_fixed
        ]
    found = [
        nearest(segment_distances(at[axis.start], at[axis.end], a, b), axis.part, times)
        for axis in axes(machine)
        for a, b in combinations(corners, 2)
    ]
    return min(found, key=lambda approach: approach.distance, default=None)


def nearest(seen: tuple[np.ndarray, np.ndarray], part: str, times: np.ndarray) -> Approach:
    """Return the approach of a part with these distances and nearest points, one row for each time in s."""
    distances, places = seen
    i = int(np.nanargmin(distances))
    return _approach(float(distances[i]), part, places[i], times[i])


def segment_distances(
    a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the distances of the segments ab and cd in the plane in each row, and nearest points on ab."""
    found: Sequence[tuple[np.ndarray, np.ndarray]] = [
        *(point_distances(point, a, b) for point in (c, d)),
        *((point_distances(point, c, d)[0], point) for point in (a, b)),
    ]
    distances, places = np.array([x for x, _ in found]), np.array([x for _, x in found])
    nearest, rows = np.argmin(distances, axis=0), np.arange(len(a))
    of_a, of_b = _side(c, d, a), _side(c, d, b)
    crossing = (_side(a, b, c) * _side(a, b, d) < 0.0) & (of_a * of_b < 0.0)
    parts = np.divide(of_a, of_a - of_b, out=np.zeros_like(of_a), where=crossing)
    meeting = a + parts[:, None] * (b - a)
    nearest_places = np.where(crossing[:, None], meeting, places[nearest, rows])
    return np.where(crossing, 0.0, distances[nearest, rows]), nearest_places


def point_distances(point: np.ndarray, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the distances of a point from the segment ab in each row, and the nearest points on ab."""
    along = b - a
    part = np.sum((point - a) * along, axis=1) / np.maximum(np.sum(along * along, axis=1), 1e-300)
    foot = a + np.clip(part, 0.0, 1.0)[:, None] * along
    return np.linalg.norm(point - foot, axis=1), foot


def _body_axes(machine: MachineModel, name: str, ends: Sequence[str]) -> list[Axis]:
    joint, part = machine.machine.bodies[name].joint, f"'{name}'"
    found = [Axis(part, name, end) for end in ends if end != name]
    if joint.kind == "prismatic":
        found.append(Axis(part, f"{joint.parent}.{joint.at}" if joint.at else joint.parent, name))
    return found


def _carried(machine: MachineModel, name: str) -> list[str]:
    """Return the points of a body that carry bodies or the payload; all its points if there are none."""
    joints = [body.joint for body in machine.machine.bodies.values() if body.joint.parent == name]
    found = [f"{name}.{joint.at}" for joint in joints if joint.at]
    payload = machine.machine.payload
    if payload is not None and payload.at.partition(".")[0] == name:
        found.append(payload.at)
    return found or [f"{name}.{point}" for point in machine.machine.points(name)]


def _slides(body: Body) -> bool:
    return body.joint.kind in ("prismatic", "free")


def _fixed(machine: MachineModel) -> set[str]:
    """Return the ground and the bodies that do not move."""
    fixed = {GROUND}
    for name, body in machine.machine.bodies.items():
        if body.joint.kind == "fixed" and body.joint.parent in fixed:
            fixed.add(name)
    return fixed


def _approach(distance: float, part: str, place: np.ndarray, time: float) -> Approach:
    x, y, *rest = place.tolist()
    return Approach(distance, part, x, y, rest[0] if rest else None, float(time))


def _side(a: np.ndarray, b: np.ndarray, point: np.ndarray) -> np.ndarray:
    return (b - a)[:, 0] * (point - a)[:, 1] - (b - a)[:, 1] * (point - a)[:, 0]
