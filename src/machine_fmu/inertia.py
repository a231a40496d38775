"""Inertia of bodies about the origins of frames."""

from dataclasses import dataclass
from typing import Any

from .exact import ZERO
from .vectors import IDENTITY, NONE, Matrix, Vector, add, dot, is_none, scale, subtract, turn, turn_tensor


@dataclass(frozen=True)
class Inertia:
    """Mass, its first moment, and its inertia about the origin of a frame, in the frame."""

    m: Any = ZERO
    S: Vector = NONE
    J: Matrix = (NONE, NONE, NONE)

    def __add__(self, other: "Inertia") -> "Inertia":
        (a, b, c), (d, e, f) = self.J, other.J
        return Inertia(self.m + other.m, add(self.S, other.S), (add(a, d), add(b, e), add(c, f)))

    def turned(self, R: Matrix) -> "Inertia":
        """Return it in the directions of an outer frame."""
        return Inertia(self.m, turn(R, self.S), turn_tensor(R, self.J))

    def shifted(self, arm: Vector) -> "Inertia":
        """Return it about a point from which its origin is at `arm`."""
        if is_none(arm):
            return self
        S = add(self.S, scale(self.m, arm))
        square = dot(add(S, self.S), arm)

        def row(i: int) -> Vector:
            outer = add(scale(self.S[i], arm), scale(arm[i], S))
            return add(self.J[i], subtract(scale(square, IDENTITY[i]), outer))

        return Inertia(self.m, S, (row(0), row(1), row(2)))


NO_INERTIA = Inertia()


def in_plane(J: Any) -> Matrix:
    """Return the inertia J about z, the only one in the plane."""
    return NONE, NONE, (ZERO, ZERO, J)


def uniform(J: Any, is_plane: bool) -> Matrix:
    """Return the inertia J about all axes."""
    return in_plane(J) if is_plane else ((J, ZERO, ZERO), (ZERO, J, ZERO), (ZERO, ZERO, J))


def slender(J: Any, axis: Vector, is_plane: bool) -> Matrix:
    """Return the inertia J across an axis, and none about it."""
    if is_plane:
        return in_plane(J)

    def row(i: int) -> Vector:
        return scale(J, subtract(IDENTITY[i], scale(axis[i], axis)))

    return row(0), row(1), row(2)
