"""Coordinates that the length of one bar determines: of a slide, or by a triangle, without iteration."""

import math
from typing import Any

from fmublock import sqrt

from .exact import MINUS_ONE, ONE, ZERO, Exact, plain
from .mechanism import Bar, End
from .pose import Angle, Lever, Pose
from .vectors import AXES, Vector, cross, dot, norm, scale, subtract, turn_back


def close_bar(pose: Pose, bar: Bar, coordinate: int, side: int, length: Any) -> None:
    """Add the coordinate that the length of a bar determines by a slide or a triangle.

    `side` is the sign of the slope of the length.
    """
    mechanism, sign = pose.mechanism, ONE if side > 0 else MINUS_ONE
    number = mechanism.frame_of(coordinate)
    frame = mechanism.frames[number]
    moving, fixed = (bar.end, bar.start) if bar.end.frame == number else (bar.start, bar.end)
    if fixed.frame == frame.parent:
        w = turn_back(frame.rotation, subtract(fixed.at, frame.at))
    else:
        w = turn_back(pose.base_rotation(number), pose.apart(End(frame.parent, frame.at), fixed))
    if not frame.slides:
        angle, slope, along = _triangle(frame.axis, w, moving.at, sign, length)
        pose.values[coordinate], pose.levers[bar.name] = angle, Lever(coordinate, slope, along)
        return
    d = subtract(moving.at, w)
    along = dot(frame.axis, d)
    if bar.slide is not None:
        pose.values[coordinate] = length - along
        return
    across = subtract(d, scale(along, frame.axis))
    pose.values[coordinate] = sign * sqrt(plain(length * length - dot(across, across))) - along


def _triangle(axis: Vector, w: Vector, b: Vector, sign: Exact, length: Any) -> tuple[Angle, Any, Any]:
    """Return the angle about an axis that brings the pin at b to the distance `length` from the pin at w.

    The others are the derivative of the length, and the part of b along the bar in the plane, as in `Lever`.
    """
    e_1, e_2 = _across(axis)
    w_1, w_2, b_1, b_2 = dot(e_1, w), dot(e_2, w), dot(e_1, b), dot(e_2, b)
    h = dot(axis, subtract(w, b))
    a_square, b_square = w_1 * w_1 + w_2 * w_2, b_1 * b_1 + b_2 * b_2
    ab = norm((w_1, w_2, ZERO)) * norm((b_1, b_2, ZERO))
    cosine = (a_square + b_square + h * h - length * length) * (0.5 / ab)  # the factor is constant, mostly
    sine = sign * sqrt(plain(1.0 - cosine * cosine))
    # from the direction of the moving pin at an angle of 0 to that of the fixed pin
    c, s = (w_1 * b_1 + w_2 * b_2) / ab, (w_2 * b_1 - w_1 * b_2) / ab
    angle = Angle(c * cosine - s * sine, s * cosine + c * sine)
    along = (b_square - a_square + length * length) / (2.0 * length)
    return angle, ab * sine / length, along


def _across(axis: Vector) -> tuple[Vector, Vector]:
    """Return two directions that make a right-handed frame with an axis."""
    for i in range(3):
        if axis[i] is ONE:
            return AXES[(i + 1) % 3], AXES[(i + 2) % 3]
    k = tuple(float(plain(x)) for x in axis)
    least = min(range(3), key=lambda i: abs(k[i]))
    first = cross(AXES[least], k)  # type: ignore[arg-type]
    size = math.sqrt(float(plain(dot(first, first))))
    e_1 = tuple(float(plain(x)) / size for x in first)
    return e_1, cross(k, e_1)  # type: ignore[arg-type,return-value]
