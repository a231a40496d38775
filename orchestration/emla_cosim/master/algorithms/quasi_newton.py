"""Multi-vector quasi-Newton iteration (IQN-MVJ) for fixed points x = F(x), which `quasi_newton.h` does.

A loop of instances answers a guess x of its coupling values with F(x). Plain repetition of x <- F(x)
diverges if the coupling is strong. The iteration learns the inverse of the residual's Jacobian
from the differences V of residuals r = F(x) - x and W of answers F(x) so far,

    J <- J + (W - J V) V^+,    x <- F(x) - J r,

and keeps J from one step to the next, so that a loop that changes little needs two sweeps. Newer
differences come first. A difference that adds little to them is left out (QR2 filter), because an old
one is not a secant at the present point of a nonlinear loop. The pseudoinverse is computed from the
orthogonal basis that the filter makes of V, one secant after the other.

Bogaers, Kok, Reddy, Franz: Quasi-Newton methods for implicit black-box FSI coupling, Comput.
Methods Appl. Mech. Engrg. 279 (2014), doi:10.1016/j.cma.2014.06.033. Haelterman, Bogaers, Scheufele,
Uekermann, Mehl: Improving the performance of the partitioned QN-ILS procedure for fluid-structure
interaction problems: filtering, Comput. Struct. 171 (2016).
"""

import numpy as np

from ...base.arrays import Vector

RELAXATION = 0.1
"""Relaxation factor before the first secant."""

NOISE = 1e-10
"""Changes of the residual below this fraction of it count as rounding errors."""

FILTER = 1e-3
"""A difference is used if at least this fraction of it is orthogonal to newer ones."""


def estimate_jacobian(count: int, derivatives: Vector | None = None) -> Vector:
    """Return J before the first step, shape (count, count).

    Args:
        count: Number of values.
        derivatives: F' = dF/dx, so that J = F' (F' - 1)^-1; None if it is not known.
    """
    default = np.eye(count) * (1.0 - RELAXATION)
    if derivatives is None:
        return default
    try:
        with np.errstate(all="ignore"):
            jacobian = np.linalg.solve((derivatives - np.eye(count)).T, derivatives.T).T
    except np.linalg.LinAlgError:
        return default
    return np.array(jacobian, dtype=float) if np.isfinite(jacobian).all() else np.array(default)
