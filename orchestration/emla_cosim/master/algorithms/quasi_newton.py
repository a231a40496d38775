"""Multi-vector quasi-Newton iteration (IQN-MVJ) for values that must agree with themselves.

A loop of slaves answers a guess x of its coupling values with F(x). Plain repetition of x <- F(x)
diverges where the coupling is strong. The iteration learns the inverse of the residual's Jacobian
from the differences V of residuals r = F(x) - x and W of answers F(x) seen so far,

    J <- J + (W - J V) V^+,    x <- F(x) - J r,

and keeps J from one step to the next, so that a loop that changes little needs two sweeps. Newer
differences count first; one that says little besides them is left out (QR2 filter), because an old
one is no secant of where a nonlinear loop is now.

Bogaers, Kok, Reddy, Franz: Quasi-Newton methods for implicit black-box FSI coupling, Comput.
Methods Appl. Mech. Engrg. 279 (2014), doi:10.1016/j.cma.2014.06.033. Haelterman, Bogaers, Scheufele,
Uekermann, Mehl: Improving the performance of the partitioned QN-ILS procedure for fluid-structure
interaction problems: filtering, Comput. Struct. 171 (2016).
"""

from collections.abc import Callable

import numpy as np

from ...arrays import Vector

RELAXATION = 0.1
"""How much of the first residual is followed while nothing is known of the Jacobian."""

NOISE = 1e-10
"""Changes of the residual below this fraction of it are taken for rounding errors."""

FILTER = 1e-3
"""A difference counts where this part of it is in no direction of newer ones."""


class NoAgreementError(Exception):
    """The guesses and answers came no closer than `gap`, in the end, after `sweeps` tries."""

    def __init__(self, gap: Vector, sweeps: int) -> None:
        super().__init__(gap, sweeps)
        self.gap = gap
        self.sweeps = sweeps


class QuasiNewton:
    """Solves x = F(x) for `count` values, better and better from call to call."""

    def __init__(self, count: int) -> None:
        self.jacobian = _unknown(count)

    def solve(
        self,
        guess: Vector,
        answer: Callable[[Vector], Vector],
        agreed: Callable[[Vector], bool],
        sweeps: int,
        sizes: Vector,
    ) -> int:
        """Find x with `agreed(answer(x) - x)`, beginning at a guess; returns the sweeps it took.

        `sizes` says how large the values usually are, so that newtons and micrometres weigh alike.
        `answer` was last called with the solution. Raises NoAgreementError after `sweeps` calls of
        `answer`, or when one of them is not finite.
        """
        x, earlier = guess.copy(), self.jacobian
        residuals: list[Vector] = []
        answers: list[Vector] = []
        for sweep in range(sweeps):
            answers.append(answer(x).copy())
            residuals.append(answers[-1] - x)
            if agreed(residuals[-1]):
                return sweep + 1
            if not np.isfinite(residuals[-1]).all():
                break
            self.jacobian = _learned(earlier, residuals, answers, sizes)
            x = answers[-1] - self.jacobian @ residuals[-1]
        self.jacobian = _unknown(len(guess))
        raise NoAgreementError(residuals[-1], len(residuals))


def _unknown(count: int) -> Vector:
    return np.eye(count) * (1.0 - RELAXATION)


def _learned(jacobian: Vector, residuals: list[Vector], answers: list[Vector], sizes: Vector) -> Vector:
    if len(residuals) < 2:
        return jacobian
    relative = np.array(residuals) / sizes
    V = np.diff(relative, axis=0).T
    W = np.diff(np.array(answers), axis=0).T
    lengths = np.linalg.norm(V, axis=0)
    useful = lengths > NOISE * np.linalg.norm(relative, axis=1).max()
    V, W = V[:, useful] / lengths[useful], W[:, useful] / lengths[useful]
    chosen = _independent(V)
    V, W = V[:, chosen], W[:, chosen]
    return jacobian + (W - jacobian @ (sizes[:, None] * V)) @ np.linalg.pinv(V) / sizes


def _independent(V: Vector) -> list[int]:
    """Columns of length 1 that are not nearly made up of later ones, the last first."""
    basis, chosen = np.empty((len(V), 0)), []
    for i in reversed(range(V.shape[1])):
        rest = V[:, i] - basis @ (basis.T @ V[:, i])
        if (length := np.linalg.norm(rest)) > FILTER:
            basis, chosen = np.column_stack([basis, rest / length]), [*chosen, i]
    return chosen
