"""Small systems of linear equations, of floats or symbols, without a choice that depends on values."""

from collections.abc import Sequence
from typing import Any

from fmublock import sqrt, where

from .exact import ONE, ZERO, is_zero, plain
from .vectors import dot

Rows = list[list[Any]]
"""Rows of a matrix."""


class Factors:
    """A square matrix as product of reflections and a triangle (Householder).

    Elimination would need a choice of pivots, which symbols cannot make; reflections are stable without.
    """

    def __init__(self, rows: Sequence[Sequence[Any]]) -> None:
        n = len(rows)
        self._R: Rows = [list(row) for row in rows]
        self._reflections: list[list[Any] | None] = []
        for k in range(n):
            column = [self._R[i][k] for i in range(k, n)]
            if n - k == 1 or all(is_zero(x) for x in column[1:]):
                self._reflections.append(None)
                continue
            self._reflections.append(_reflection(column))
            for j in range(k, n):
                reflected = self._reflect(k, [self._R[i][j] for i in range(k, n)])
                for i, x in enumerate(reflected, k):
                    self._R[i][j] = x if j > k or i == k else ZERO
        self._inverse = [ONE / self._R[i][i] for i in range(n)]

    def solve(self, b: Sequence[Any]) -> list[Any]:
        """Return x with A x = b."""
        n, x = len(b), list(b)
        for k in range(n):
            x[k:] = self._reflect(k, x[k:])
        for i in reversed(range(n)):
            x[i] = (x[i] - dot(self._R[i][i + 1 :], x[i + 1 :])) * self._inverse[i]
        return x

    def solve_transposed(self, b: Sequence[Any]) -> list[Any]:
        """Return x with A^T x = b."""
        n, x = len(b), list(b)
        for i in range(n):
            x[i] = (x[i] - dot([self._R[j][i] for j in range(i)], x[:i])) * self._inverse[i]
        for k in reversed(range(n)):
            x[k:] = self._reflect(k, x[k:])
        return x

    def diagonal(self) -> list[Any]:
        """Return the diagonal of the triangle; an element is 0 if the matrix is singular."""
        return [self._R[i][i] for i in range(len(self._R))]

    @property
    def orientation(self) -> float:
        """1 or -1: the determinant is this times the product of the diagonal."""
        return -1.0 if sum(v is not None for v in self._reflections) % 2 else 1.0

    def _reflect(self, k: int, x: list[Any]) -> list[Any]:
        v = self._reflections[k]
        if v is None:
            return x
        amount = dot(v, x)
        return [x_i - v_i * amount for x_i, v_i in zip(x, v, strict=True)]


def _reflection(column: Sequence[Any]) -> list[Any]:
    """Return v such that x - v (v . x) is zero but for its first element, for the column x; v . v = 2."""
    length = sqrt(plain(dot(column, column)))
    first = plain(column[0])
    signed = where(first >= 0.0, length, -length)
    v = [first + signed, *column[1:]]
    square = 2.0 * length * (length + abs(first))
    factor = sqrt(2.0 / square)
    return [factor * x for x in v]


def solve_symmetric(M: Sequence[Sequence[Any]], b: Sequence[Any]) -> list[Any]:
    """Solve M x = b for a symmetric, positive definite matrix by M = L D L^T, from its lower triangle."""
    n = len(b)
    L: Rows = [[ZERO] * n for _ in range(n)]
    inverse, x = [ZERO] * n, list(b)
    for j in range(n):
        scaled = [L[j][k] for k in range(j)]  # of L D, until its columns are divided
        for k in range(j):
            L[j][k] = scaled[k] * inverse[k]
        inverse[j] = 1.0 / (M[j][j] - dot(scaled, L[j][:j]))
        for i in range(j + 1, n):
            L[i][j] = M[i][j] - dot(L[i][:j], L[j][:j])
        x[j] = x[j] - dot(L[j][:j], x[:j])
    for j in range(n):
        x[j] = x[j] * inverse[j]
    for j in reversed(range(n)):
        x[j] = x[j] - dot([L[i][j] for i in range(j + 1, n)], x[j + 1 :])
    return x
