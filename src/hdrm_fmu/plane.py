"""Vectors in the plane: pairs (x, y) of numbers or symbols."""

from typing import Any

from fmublock import cos, sin

Vector = tuple[Any, Any]
"""x and y."""


def unit(angle: Any) -> Vector:
    """Return the unit vector at this angle in rad, anticlockwise from the x axis."""
    return cos(angle), sin(angle)


def turned(v: Vector, direction: Vector) -> Vector:
    """Turn v by the angle of a direction."""
    return v[0] * direction[0] - v[1] * direction[1], v[0] * direction[1] + v[1] * direction[0]


def turned_back(v: Vector, direction: Vector) -> Vector:
    """Turn v by the angle of a direction, clockwise."""
    return v[0] * direction[0] + v[1] * direction[1], v[1] * direction[0] - v[0] * direction[1]


def normal(v: Vector) -> Vector:
    """Turn v by a right angle, anticlockwise: the velocity of the point v about the origin at 1 rad/s."""
    return -v[1], v[0]


def scaled(factor: Any, v: Vector) -> Vector:
    """Multiply v by a number."""
    return factor * v[0], factor * v[1]


def added(a: Vector, b: Vector) -> Vector:
    """Add a and b."""
    return a[0] + b[0], a[1] + b[1]


def cross(a: Vector, b: Vector) -> Any:
    """Return the out-of-plane component of a x b: the moment of the force b at the point a."""
    return a[0] * b[1] - a[1] * b[0]
