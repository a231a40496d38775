"""The machine's base, as pictures draw it and as motions stay clear of it; positions in m from O1."""

from typing import Any

from .plane import Vector, scaled, unit

_OVERHANG = 0.3
"""Overhang of the base at its foot, beside and below its pins, m."""

TOP = 0.16
"""Half of the base's width at O1, m."""


def foot_corners(p: Any) -> tuple[Vector, Vector]:
    """Return the left and the right corner of the base's foot; `p` is as in `kinematics`."""
    x, y = _fixed_pin(p)
    foot = min(0.0, y) - _OVERHANG
    return (min(0.0, x) - _OVERHANG, foot), (max(0.0, x) + _OVERHANG, foot)


def lowest_ground(p: Any) -> float:
    """Return the height of the ground under the machine in m: that of the foot."""
    return foot_corners(p)[0][1]


def base_corners(p: Any) -> list[Vector]:
    """Return points whose convex hull is the base: its foot, the lift actuator's fixed pin, its top at O1."""
    return [*foot_corners(p), _fixed_pin(p), (TOP, TOP), (-TOP, TOP)]


def _fixed_pin(p: Any) -> Vector:
    return scaled(p.lift_a, unit(p.lift_delta))
