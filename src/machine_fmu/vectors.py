"""Vectors and matrices in space, of floats, arrays, symbols, and exact numbers."""

from collections.abc import Sequence
from typing import Any

from fmublock import sqrt

from .exact import MINUS_ONE, ONE, ZERO, Exact, is_zero, plain

Vector = tuple[Any, Any, Any]
"""x, y and z."""

Matrix = tuple[Vector, Vector, Vector]
"""Rows of a matrix."""

NONE: Vector = (ZERO, ZERO, ZERO)
IDENTITY: Matrix = ((ONE, ZERO, ZERO), (ZERO, ONE, ZERO), (ZERO, ZERO, ONE))
AXES: tuple[Vector, Vector, Vector] = IDENTITY
"""The directions x, y and z."""


def add(a: Vector, b: Vector) -> Vector:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def subtract(a: Vector, b: Vector) -> Vector:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def scale(factor: Any, a: Vector) -> Vector:
    """Return a, multiplied by a number."""
    return factor * a[0], factor * a[1], factor * a[2]


def dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    """Return the scalar product."""
    total: Any = ZERO
    for x, y in zip(a, b, strict=True):
        total = total + x * y
    return total


def cross(a: Vector, b: Vector) -> Vector:
    """Return the vector product."""
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def norm(a: Vector) -> Any:
    """Return the length of a vector."""
    return sqrt(plain(dot(a, a)))


def is_none(a: Vector) -> bool:
    """Return whether all components are the exact zero."""
    return all(is_zero(x) for x in a)


def turn(R: Matrix, a: Vector) -> Vector:
    """Return R a: a vector in the outer frame."""
    return dot(R[0], a), dot(R[1], a), dot(R[2], a)


def turn_back(R: Matrix, a: Vector) -> Vector:
    """Return R^T a: a vector in the inner frame."""
    return tuple(R[0][i] * a[0] + R[1][i] * a[1] + R[2][i] * a[2] for i in range(3))  # type: ignore[return-value]


def turn_tensor(R: Matrix, J: Matrix) -> Matrix:
    """Return R J R^T of a symmetric J: an inertia in the outer frame."""
    half = [tuple(dot(R[i], J[k]) for k in range(3)) for i in range(3)]  # R J
    lower = [[dot(half[i], R[j]) for j in range(i + 1)] for i in range(3)]
    return tuple(tuple(lower[max(i, j)][min(i, j)] for j in range(3)) for i in range(3))  # type: ignore[return-value]


def compose(R: Matrix, S: Matrix) -> Matrix:
    """Return the rotation R S."""
    if _is_about_z(R) and _is_about_z(S):  # each element once
        (c, _, _), (s, _, _) = R[:2]
        (d, _, _), (t, _, _) = S[:2]
        return about_z(c * d - s * t, s * d + c * t)
    columns = [turn(R, (S[0][j], S[1][j], S[2][j])) for j in range(3)]
    return tuple(tuple(column[i] for column in columns) for i in range(3))  # type: ignore[return-value]


def about_z(cosine: Any, sine: Any) -> Matrix:
    """Return the rotation about z."""
    return (cosine, -sine, ZERO), (sine, cosine, ZERO), IDENTITY[2]


def about(axis: Vector, cosine: Any, sine: Any) -> Matrix:
    """Return the rotation about an axis of length 1."""
    if is_zero(axis[0]) and is_zero(axis[1]) and isinstance(axis[2], Exact):
        return about_z(cosine, axis[2] * sine)
    rest = ONE - cosine
    x, y, z = axis
    xy, yz, zx = x * y * rest, y * z * rest, z * x * rest
    return (
        (cosine + x * x * rest, xy - z * sine, zx + y * sine) if not _is_unit(x) else IDENTITY[0],
        (xy + z * sine, cosine + y * y * rest, yz - x * sine) if not _is_unit(y) else IDENTITY[1],
        (zx - y * sine, yz + x * sine, cosine + z * z * rest) if not _is_unit(z) else IDENTITY[2],
    )


def _is_about_z(R: Matrix) -> bool:
    return R[2] == IDENTITY[2] and is_zero(R[0][2]) and is_zero(R[1][2])


def _is_unit(x: Any) -> bool:
    return x is ONE or x is MINUS_ONE
