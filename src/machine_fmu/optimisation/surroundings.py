"""The ground and the machine's own body, as obstacles of a motion.

All bodies are lines and convex polygons in the plane, in m from O1. Clearances are distances of the axes of
booms and actuators, so they must cover half of their widths.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import casadi
import numpy as np

from hdrm_fmu.base import base_corners
from hdrm_fmu.kinematics import posture
from hdrm_fmu.parameters import HdrmParameters

GROUND_POINTS = {
    "O_2": "the elbow",
    "B_1": "the lift actuator's boom pin",
    "A_2": "the tilt actuator's fixed pin",
    "B_2": "the tilt actuator's boom pin",
    "tip": "the tip",
}
"""Points of `Posture` that stay above the ground, with their names. All lines of the machine end in them."""

BOOM = "the boom"
"""Name of outer and inner boom together."""


@dataclass(frozen=True)
class Approach:
    """The smallest distance of a motion from an obstacle.

    `distance` and the place `x`, `y` from O1 are in m, `time` in s. `part` is the part of the machine that
    is there.
    """

    distance: float
    part: str
    x: float
    y: float
    time: float


def heights(p: HdrmParameters) -> casadi.Function:
    """Return a function from strokes to the heights of GROUND_POINTS in m from O1."""
    q = casadi.SX.sym("q", 3)
    return casadi.Function("heights", [q], [_points(p)(q)[1::2]])


def postures(p: HdrmParameters, strokes: np.ndarray) -> dict[str, np.ndarray]:
    """Return the points of GROUND_POINTS by name, one row (x, y) in m for each row of strokes."""
    found = _points(p).map(len(strokes))(strokes.T).full()
    return {name: found[2 * i : 2 * i + 2].T for i, name in enumerate(GROUND_POINTS)}


@cache
def _points(p: HdrmParameters) -> casadi.Function:
    q = casadi.SX.sym("q", 3)
    at = posture(p, casadi.vertsplit(q))
    return casadi.Function(
        "points", [q], [casadi.vertcat(*(casadi.vertcat(*getattr(at, n)) for n in GROUND_POINTS))]
    )


def ground_approach(p: HdrmParameters, ground: float, times: np.ndarray, strokes: np.ndarray) -> Approach:
    """Return the smallest height above the ground of all points of the machine that move."""
    at, found = postures(p, strokes), list[Approach]()
    for name, part in GROUND_POINTS.items():
        i = int(np.argmin(at[name][:, 1]))
        x, y = at[name][i].tolist()
        found.append(Approach(y - ground, part, x, y, float(times[i])))
    return min(found, key=lambda approach: approach.distance)


def body_approach(p: HdrmParameters, times: np.ndarray, strokes: np.ndarray) -> Approach:
    """Return the smallest distance of the boom from the machine's body; 0 if they touch.

    It is measured between the boom and all lines that join two corners of the body.
    """
    at = postures(p, strokes)
    corners = _body(p, at)
    pairs = [(a, b) for i, a in enumerate(corners) for b in corners[i + 1 :]]
    distances = np.array([_between_segments(at["O_2"], at["tip"], a, b)[0] for a, b in pairs])
    pair, row = np.unravel_index(int(np.argmin(distances)), distances.shape)
    a, b = pairs[pair]
    x, y = _between_segments(at["O_2"], at["tip"], a, b)[1][row].tolist()
    return Approach(float(distances[pair, row]), BOOM, x, y, float(times[row]))


def _body(p: HdrmParameters, at: dict[str, np.ndarray]) -> list[np.ndarray]:
    fixed = [np.broadcast_to(np.array(corner), at["tip"].shape) for corner in base_corners(p)]
    return [*fixed, at["B_1"]]


def _between_segments(
    a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the distances of the segments ab and cd in each row, and the nearest points on ab."""
    found: Sequence[tuple[np.ndarray, np.ndarray]] = [
        *(_to_segment(point, a, b) for point in (c, d)),
        *((_to_segment(point, c, d)[0], point) for point in (a, b)),
    ]
    distances, places = np.array([x for x, _ in found]), np.array([x for _, x in found])
    nearest, rows = np.argmin(distances, axis=0), np.arange(len(a))
    crossing = (_side(a, b, c) * _side(a, b, d) < 0.0) & (_side(c, d, a) * _side(c, d, b) < 0.0)
    return np.where(crossing, 0.0, distances[nearest, rows]), places[nearest, rows]


def _to_segment(point: np.ndarray, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    along = b - a
    part = np.sum((point - a) * along, axis=1) / np.maximum(np.sum(along * along, axis=1), 1e-300)
    foot = a + np.clip(part, 0.0, 1.0)[:, None] * along
    return np.linalg.norm(point - foot, axis=1), foot


def _side(a: np.ndarray, b: np.ndarray, point: np.ndarray) -> Any:
    return (b - a)[:, 0] * (point - a)[:, 1] - (b - a)[:, 1] * (point - a)[:, 0]
