"""Multi-vector quasi-Newton iteration (IQN-MVJ) for fixed points x = F(x).

A loop of instances answers a guess x of its coupling values with F(x). Plain repetition of x <- F(x)
diverges if the coupling is strong. The iteration learns the inverse of the residual's Jacobian
from the differences V of residuals r = F(x) - x and W of answers F(x) so far,

    J <- J + (W - J V) V^+,    x <- F(x) - J r,

and keeps J from one step to the next, so that a loop that changes little needs two sweeps. Newer
differences come first. A difference that adds little to them is left out (QR2 filter), because an old
one is no secant at the present point of a nonlinear loop. The pseudoinverse is computed from the orthogonal
basis that the filter makes of V, one secant after the other.

Bogaers, Kok, Reddy, Franz: Quasi-Newton methods for implicit black-box FSI coupling, Comput.
Methods Appl. Mech. Engrg. 279 (2014), doi:10.1016/j.cma.2014.06.033. Haelterman, Bogaers, Scheufele,
Uekermann, Mehl: Improving the performance of the partitioned QN-ILS procedure for fluid-structure
interaction problems: filtering, Comput. Struct. 171 (2016).
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from ...base.arrays import Vector

RELAXATION = 0.1
"""Relaxation factor while nothing is known of the Jacobian."""

NOISE = 1e-10
"""Changes of the residual below this fraction of it count as rounding errors."""

FILTER = 1e-3
"""A difference is used if at least this fraction of it is orthogonal to newer ones."""


class NoAgreementError(Exception):
    """Guess and answer still differ by `gap` after `sweeps` tries."""

    def __init__(self, gap: Vector, sweeps: int) -> None:
        super().__init__(gap, sweeps)
        self.gap = gap
        self.sweeps = sweeps


class QuasiNewton:
    """Solve x = F(x) for `count` values, and learn J (`jacobian`, changed in place) from call to call."""

    def __init__(self, count: int) -> None:
        self.jacobian: Vector = np.empty((count, count))
        self.forget()

    def forget(self, derivatives: Vector | None = None) -> None:
        """Reset J, from the derivatives F' = dF/dx if they are known: J = F' (F' - 1)^-1."""
        count = len(self.jacobian)
        self.jacobian[:] = np.eye(count) * (1.0 - RELAXATION)
        if derivatives is None:
            return
        try:
            with np.errstate(all="ignore"):
                found = np.linalg.solve((derivatives - np.eye(count)).T, derivatives.T).T
        except np.linalg.LinAlgError:
            return
        if np.isfinite(found).all():
            self.jacobian[:] = found

    def solve(
        self,
        guess: Vector,
        answer: Callable[[Vector], Vector],
        agreed: Callable[[Vector], bool],
        sweeps: int,
        sizes: Vector,
    ) -> int:
        """Find x with `agreed(answer(x) - x)`. The last call of `answer` has the solution as argument.

        Args:
            guess: First guess, shape (n,).
            answer: F, from shape (n,) to shape (n,).
            agreed: Return whether a residual F(x) - x is small enough.
            sweeps: Largest number of calls of `answer`.
            sizes: Typical sizes of the values, shape (n,), so that newtons and micrometres have equal weight.

        Returns:
            Number of calls of `answer`.

        Raises:
            NoAgreementError: No x was found, or an answer is not finite.
        """
        n, x, residual = len(guess), guess.copy(), guess
        earlier, jacobian = self.jacobian.ravel().tolist(), self.jacobian.ravel().tolist()
        room, scales = [[0.0] * n * n, [0.0] * n, [0.0] * n], sizes.tolist()
        residuals: list[float] = []
        answers: list[float] = []
        for sweep in range(sweeps):
            found = answer(x).copy()
            residual = found - x
            answers += found.tolist()
            residuals += residual.tolist()
            agrees = agreed(residual)
            if not np.isfinite(residual).all():
                break
            if 0 < sweep <= n or not agrees:  # n differences are enough; the last, small one adds least
                improve(n, sweep + 1, residuals, answers, scales, earlier, jacobian, *room)
                self.jacobian.reshape(-1)[:] = jacobian
                x = np.array(room[-1])
            if agrees:
                return sweep + 1
        self.forget()
        raise NoAgreementError(residual, len(residuals) // n)


def improve(
    n: int,
    sweeps: int,
    residuals: Any,
    answers: Any,
    sizes: Any,
    earlier: Any,
    jacobian: Any,
    basis: Any,
    direction: Any,
    guess: Any,
) -> None:
    """Learn J from all sweeps of this step, and compute the next guess.

    This function runs in Python and compiled, with the same bits. All arrays are flat, matrices row by row.

    Args:
        n: Number of values.
        sweeps: Number of sweeps in this step so far.
        residuals: n residuals per sweep.
        answers: n answers per sweep.
        sizes: Typical sizes of the values.
        earlier: J before this step.
        jacobian: Output: J.
        basis: Work space for n^2 numbers.
        direction: Work space for n numbers.
        guess: Output: the next guess.
    """
    for e in range(n * n):
        jacobian[e] = earlier[e]
    largest = 0.0
    for k in range(sweeps):
        square = 0.0
        for i in range(n):
            relative = residuals[k * n + i] / sizes[i]
            square += relative * relative
        largest = max(largest, square)
    used = 0
    for k in range(sweeps - 1, 0, -1):
        new, old = k * n, (k - 1) * n
        square = 0.0
        for i in range(n):
            direction[i] = residuals[new + i] / sizes[i] - residuals[old + i] / sizes[i]
            square += direction[i] * direction[i]
        if used == n or not square > NOISE * NOISE * largest:
            continue
        for b in range(used):
            along, norm = 0.0, 0.0
            for i in range(n):
                along += basis[b * n + i] * direction[i]
                norm += basis[b * n + i] * basis[b * n + i]
            for i in range(n):
                direction[i] -= along / norm * basis[b * n + i]
        rest = 0.0
        for i in range(n):
            rest += direction[i] * direction[i]
        if not rest > FILTER * FILTER * square:
            continue
        for i in range(n):  # the part of this difference that J does not explain yet
            basis[used * n + i] = direction[i]
            guess[i] = answers[new + i] - answers[old + i]
            for j in range(n):
                guess[i] -= jacobian[i * n + j] * (residuals[new + j] - residuals[old + j])
        for i in range(n):
            for j in range(n):
                jacobian[i * n + j] += guess[i] / rest * direction[j] / sizes[j]
        used += 1
    last = (sweeps - 1) * n
    for i in range(n):
        guess[i] = answers[last + i]
        for j in range(n):
            guess[i] -= jacobian[i * n + j] * residuals[last + j]
