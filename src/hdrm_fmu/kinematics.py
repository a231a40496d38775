"""Kinematics of the manipulator: from strokes to angles, lever arms, and points in the plane.

`p` is any object with the attributes of HdrmParameters, `q` the strokes of lift, tilt and telescope in m.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

from fmublock import arccos, sqrt

from .plane import Vector, added, scaled, turned, turned_back, unit


class Triangle(NamedTuple):
    """The closed chain of a turning actuator: turning point O, fixed pin A, boom pin B."""

    L: Any
    """Length of the actuator from A to B, m."""
    cos_gamma: Any
    """Cosine of the angle gamma at O, between A and B."""
    sin_gamma: Any
    """Sine of gamma."""
    r: Any
    """Lever arm dL/dgamma: distance of O from the line through A and B, m."""
    d: Any
    """Part of OB along the actuator, m: B moves across the actuator at the speed gamma' d."""


def triangle(a: Any, b: Any, L: Any) -> Triangle:
    """Return the triangle with the sides a and b at O and the actuator's length L, in m.

    It closes if |a - b| < L < a + b; otherwise its values are NaN.
    """
    cos_gamma = (a * a + b * b - L * L) / (2.0 * a * b)
    sin_gamma = sqrt(1.0 - cos_gamma * cos_gamma)
    return Triangle(L, cos_gamma, sin_gamma, a * b * sin_gamma / L, (b * b + L * L - a * a) / (2.0 * L))


class Posture(NamedTuple):
    """The manipulator at rest in one posture. Points are in m from O1, directions have length 1."""

    lift: Triangle
    tilt: Triangle
    lift_axis: Vector
    """Direction of the lift boom, from O1 to O2."""
    boom_axis: Vector
    """Direction of outer and inner boom, from O2 to the tip."""
    lift_actuator: Vector
    """Direction of the lift actuator, from A1 to B1."""
    tilt_actuator: Vector
    """Direction of the tilt actuator, from A2 to B2."""
    A_1: Vector
    B_1: Vector
    O_2: Vector
    A_2: Vector
    B_2: Vector
    tip: Vector


def posture(p: Any, q: Sequence[Any]) -> Posture:
    """Return directions and points of the manipulator at the strokes q."""
    lift = triangle(p.lift_a, p.lift_b, p.lift_L_0 + q[0])
    to_A = unit(p.lift_delta)
    to_B = turned(to_A, (lift.cos_gamma, lift.sin_gamma))
    lift_axis = turned_back(to_B, unit(p.lift_epsilon))
    A_1, B_1 = scaled(p.lift_a, to_A), scaled(p.lift_b, to_B)
    O_2 = scaled(p.lift_length, lift_axis)

    tilt = triangle(p.tilt_a, p.tilt_b, p.tilt_L_0 + q[1])
    to_A = turned(lift_axis, unit(p.tilt_delta))
    to_B = turned(to_A, (tilt.cos_gamma, tilt.sin_gamma))
    boom_axis = turned_back(to_B, unit(p.tilt_epsilon))
    A_2, B_2 = added(O_2, scaled(p.tilt_a, to_A)), added(O_2, scaled(p.tilt_b, to_B))
    tip = added(O_2, scaled(p.reach + q[2], boom_axis))

    lift_actuator, tilt_actuator = _direction(A_1, B_1, lift.L), _direction(A_2, B_2, tilt.L)
    axes = (lift_axis, boom_axis, lift_actuator, tilt_actuator)
    return Posture(lift, tilt, *axes, A_1, B_1, O_2, A_2, B_2, tip)


def _direction(start: Vector, end: Vector, length: Any) -> Vector:
    return (end[0] - start[0]) / length, (end[1] - start[1]) / length


def joint_angles(p: Any, q: Sequence[Any]) -> tuple[Any, Any]:
    """Return the angles theta_1 of the lift boom and theta_2 of the outer boom in rad.

    theta_1 is relative to the horizontal, theta_2 to the lift boom.

    theta = gamma + delta - epsilon, with cos gamma = (a^2 + b^2 - L^2) / (2 a b) and L = L_0 + q.
    """
    lift = triangle(p.lift_a, p.lift_b, p.lift_L_0 + q[0])
    tilt = triangle(p.tilt_a, p.tilt_b, p.tilt_L_0 + q[1])
    theta_1 = arccos(lift.cos_gamma) + p.lift_delta - p.lift_epsilon
    theta_2 = arccos(tilt.cos_gamma) + p.tilt_delta - p.tilt_epsilon
    return theta_1, theta_2


def lever_arms(p: Any, q: Sequence[Any]) -> tuple[Any, Any]:
    """Return the lever arms of lift and tilt actuator, dq/dtheta = a b sin gamma / L, in m/rad."""
    lift = triangle(p.lift_a, p.lift_b, p.lift_L_0 + q[0])
    tilt = triangle(p.tilt_a, p.tilt_b, p.tilt_L_0 + q[1])
    return lift.r, tilt.r


def tip(p: Any, q: Sequence[Any]) -> Vector:
    """Return the position of the tip, which carries the payload, in m from O1: x horizontal, y up."""
    return posture(p, q).tip


def outline(p: Any, q: Sequence[Any]) -> dict[str, list[Vector]]:
    """Return the lines of a drawing of the machine by name, each a list of points in m from O1.

    `lift_boom`, `outer_boom` and `inner_boom` are the booms. `lift_triangle` and `tilt_triangle` go from the
    turning point to the fixed pin, to the boom pin and back. `lift_actuator`, `tilt_actuator` and
    `telescope_actuator` have three points each: fixed end, end of the housing, and moving end.
    """
    at = posture(p, q)
    O_1 = (0.0, 0.0)
    outer_end = added(at.O_2, scaled(p.reach, at.boom_axis))
    return {
        "lift_boom": [O_1, at.O_2],
        "outer_boom": [at.O_2, outer_end],
        "inner_boom": [outer_end, at.tip],
        "lift_triangle": [O_1, at.A_1, at.B_1, O_1],
        "tilt_triangle": [at.O_2, at.A_2, at.B_2, at.O_2],
        "lift_actuator": [at.A_1, added(at.A_1, scaled(p.lift_L_0, at.lift_actuator)), at.B_1],
        "tilt_actuator": [at.A_2, added(at.A_2, scaled(p.tilt_L_0, at.tilt_actuator)), at.B_2],
        "telescope_actuator": [at.O_2, outer_end, at.tip],
    }
