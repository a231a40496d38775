"""Loss functions of `scipy.optimize.least_squares`: what its result does not have, cost and scaling.

Source: B. Triggs et al., "Bundle Adjustment: A Modern Synthesis", Vision Algorithms (1999), section 4.3.
"""

from collections.abc import Callable

import numpy as np

from ...base.arrays import Vector

LINEAR = "linear"

_MEDIAN = 1.4826
"""Standard deviation of a normal distribution, divided by the median of its absolute values."""

_Rho = tuple[Vector, Vector, Vector]


def _linear(z: Vector) -> _Rho:
    return z, np.ones_like(z), np.zeros_like(z)


def _soft_l1(z: Vector) -> _Rho:
    t = 1.0 + z
    return 2.0 * (np.sqrt(t) - 1.0), t**-0.5, -0.5 * t**-1.5


def _huber(z: Vector) -> _Rho:
    far = np.maximum(z, 1.0)
    inside = z <= 1.0
    return (
        np.where(inside, z, 2.0 * np.sqrt(far) - 1.0),
        np.where(inside, 1.0, far**-0.5),
        np.where(inside, 0.0, -0.5 * far**-1.5),
    )


def _cauchy(z: Vector) -> _Rho:
    t = 1.0 + z
    return np.log1p(z), 1.0 / t, -1.0 / t**2


def _arctan(z: Vector) -> _Rho:
    t = 1.0 + z**2
    return np.arctan(z), 1.0 / t, -2.0 * z / t**2


_RHO: dict[str, Callable[[Vector], _Rho]] = {
    LINEAR: _linear,
    "soft_l1": _soft_l1,
    "huber": _huber,
    "cauchy": _cauchy,
    "arctan": _arctan,
}

LOSSES = tuple(_RHO)
"""Loss functions; all but the first reduce the weight of outliers."""


def find_cost(loss: str, residuals: Vector) -> float:
    """Return half the sum of the losses of residuals in standard deviations, shape (n,)."""
    return 0.5 * float(_RHO[loss](residuals**2)[0].sum())


def scale_for_loss(loss: str, residuals: Vector) -> tuple[Vector, Vector]:
    """Return the derivatives of the cost by the residuals, and factors for those of the residuals.

    With these factors, a linear problem has about the curvature of this one at its minimum.

    Args:
        loss: A name of `LOSSES`.
        residuals: Residuals in standard deviations, shape (n,).
    """
    _, first, second = _RHO[loss](residuals**2)
    factors = np.sqrt(np.maximum(first + 2.0 * second * residuals**2, np.finfo(float).eps))
    return residuals * first, factors


def find_robust_deviation(values: Vector) -> float:
    """Return the standard deviation about 0 of normal values from their median: outliers do not move it."""
    return _MEDIAN * float(np.median(np.abs(values)))
