"""The reachable positions of the tip, as a polygon: the paper's workspace."""

from typing import Any

import numpy as np

from hdrm_fmu.kinematics import joint_angles, tip

from ...base.arrays import Vector

_SIDE, _ARC = 80, 60
"""Number of pieces of each side of the box of tilt and telescope strokes, and of an arc of the lift."""


def outline_workspace(p: Any) -> Vector:
    """Return the closed line around all points that the tip reaches within the box of strokes.

    The lift turns everything about O1. Points that tilt and telescope reach at its lower end are therefore
    swept along arcs about O1: at each radius from the first angle reached to the last one, plus the turn of
    the
    lift. A hole that no turning closes is filled. O1 itself, where the base is, must be out of reach.
    """
    turn = joint_angles(p, p.q_UB)[0] - joint_angles(p, p.q_LB)[0]
    radius, first, last = _slices(_outer_line(p))
    last = last + turn
    begin = np.linspace(last[0], first[0], _ARC)
    end = np.linspace(first[-1], last[-1], _ARC)
    angles = np.concatenate([begin, first, end, last[::-1]])
    radii = np.concatenate([np.full(_ARC, radius[0]), radius, np.full(_ARC, radius[-1]), radius[::-1]])
    return np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])


def _outer_line(p: Any) -> Vector:
    """Return the tip along the sides of the box of tilt and telescope strokes, with the lift retracted."""
    corners = [(p.q_LB[1], p.q_LB[2]), (p.q_UB[1], p.q_LB[2]), (p.q_UB[1], p.q_UB[2]), (p.q_LB[1], p.q_UB[2])]
    sides = zip(corners, corners[1:] + corners[:1], strict=True)
    strokes = np.concatenate([np.linspace(a, b, _SIDE, endpoint=False) for a, b in sides])
    return np.array([tip(p, (float(p.q_LB[0]), float(tilt), float(tele))) for tilt, tele in strokes])


def _slices(line: Vector) -> tuple[Vector, Vector, Vector]:
    """Return radii of a closed line's points, with the first and the last angle about O1 at each."""
    radius = np.hypot(line[:, 0], line[:, 1])
    angle = np.unwrap(np.arctan2(line[:, 1], line[:, 0]))
    level = np.unique(radius)[:, None]
    r, a = radius, angle
    r_next, a_next = np.roll(r, -1), np.roll(a, -1)
    low, high = np.minimum(r, r_next), np.maximum(r, r_next)
    crossed = (low <= level) & (level <= high)
    part = (level - r) / np.where(r_next == r, 1.0, r_next - r)
    crossing = a + part * (a_next - a)
    first = np.where(crossed, crossing, np.inf).min(axis=1)
    last = np.where(crossed, crossing, -np.inf).max(axis=1)
    return level[:, 0], first, last
