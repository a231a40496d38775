"""Shapes of the manipulator in one posture, in the plane, in m from O1."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from hdrm_fmu.base import TOP, foot_corners
from hdrm_fmu.kinematics import outline
from hdrm_fmu.parameters import PAYLOAD
from machine_fmu.trajectory import JOINTS

from ...base.arrays import Vector

_ROUND = np.linspace(-0.5 * math.pi, 0.5 * math.pi, 9)
"""Angles of a rounded end."""

_PIN, _BOX = 0.05, 0.38
"""Radius of a pin, and side of the box that represents the study's payload, m."""

_LIFT_BOOM, _OUTER_BOOM, _INNER_BOOM = (0.22, 0.16), (0.20, 0.17), (0.11, 0.11)
"""Widths of the booms at their beginnings and ends, m."""

_HOUSING, _TUBE, _INSIDE = 0.12, 0.06, 0.5
"""Widths of an actuator's housing and tube in m, and the factor for an actuator inside a boom."""


def build_shapes(p: Any, q: Sequence[float], payload: float = PAYLOAD) -> dict[str, Vector]:
    """Return closed lines by name, the rear ones first, of the manipulator at the strokes q in m.

    `p` is as in `hdrm_fmu.kinematics`; `payload` in kg sets the size of its box.
    """
    lines = {name: np.array(line) for name, line in outline(p, [float(x) for x in q]).items()}
    (O_1, O_2), (_, tip) = lines["lift_boom"], lines["inner_boom"]
    _, boom_end = lines["outer_boom"]
    _, A_1, B_1, _ = lines["lift_triangle"]
    _, A_2, B_2, _ = lines["tilt_triangle"]
    found = {
        "base": _around(_disc(O_1, TOP), _disc(A_1, 0.13), np.array(foot_corners(p))),
        "inner_boom": _bar(O_2, tip, *_INNER_BOOM),
        "lift_bracket": _bracket(O_1, O_2, B_1),
        "tilt_fixed_bracket": _bracket(O_1, O_2, A_2),
        "lift_boom": _bar(O_1, O_2, *_LIFT_BOOM),
        "tilt_bracket": _bracket(O_2, boom_end, B_2),
        "outer_boom": _bar(O_2, boom_end, *_OUTER_BOOM),
    }
    for joint in JOINTS:
        part = _INSIDE if joint == "telescope" else 1.0
        fixed, housing_end, moving = lines[f"{joint}_actuator"]
        found[f"{joint}_tube"] = _bar(fixed, moving, part * _TUBE, part * _TUBE)
        found[f"{joint}_housing"] = _bar(fixed, housing_end, part * _HOUSING, part * _HOUSING)
    found["payload"] = _box(tip, tip - O_2, payload)
    pins = {"O_1": O_1, "A_1": A_1, "B_1": B_1, "O_2": O_2, "A_2": A_2, "B_2": B_2}
    return found | {name: _disc(at, _PIN) for name, at in pins.items()}


def _disc(at: Vector, radius: float) -> Vector:
    return at + radius * _directions(np.linspace(0.0, 2.0 * math.pi, 25))


def _directions(angles: Vector) -> Vector:
    return np.column_stack([np.cos(angles), np.sin(angles)])


def _bar(start: Vector, end: Vector, width: float, end_width: float) -> Vector:
    """Return a bar between two points, round at both ends."""
    angle = math.atan2(*(end - start)[::-1])
    there = end + 0.5 * end_width * _directions(angle + _ROUND)
    return np.concatenate([there, start + 0.5 * width * _directions(angle + math.pi + _ROUND)])


def _bracket(start: Vector, end: Vector, pin: Vector) -> Vector:
    """Return the bracket of a pin beside a boom: from the boom's axis, around the pin."""
    axis = (end - start) / np.linalg.norm(end - start)
    foot = start + axis * ((pin - start) @ axis)
    return _around(np.array([foot - 0.22 * axis, foot + 0.22 * axis]), _disc(pin, 1.7 * _PIN))


def _box(at: Vector, along: Vector, payload: float) -> Vector:
    """Return a square at the tip, aligned with the boom, whose volume is proportional to the mass."""
    side = _BOX * math.cbrt(max(payload, 0.0) / PAYLOAD)
    corners = math.atan2(*along[::-1]) + math.pi * np.array([0.25, 0.75, 1.25, 1.75])
    return at + math.sqrt(0.5) * side * _directions(corners)


def _around(*points: Vector) -> Vector:
    """Return the convex line around points."""
    from scipy.spatial import ConvexHull

    found = np.concatenate(points)
    return found[ConvexHull(found).vertices]
