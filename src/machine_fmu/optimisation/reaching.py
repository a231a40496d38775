"""Postures that bring the tip to a position, and positions that the tip can reach.

A position leaves one stroke of three free: for each stroke of the telescope, the two other booms form a
triangle with the position, which closes in two ways.
"""

from collections.abc import Callable, Sequence
from itertools import product

import numpy as np
from scipy.optimize import minimize

from hdrm_fmu.parameters import HdrmParameters, Three

from .surroundings import postures

_STROKES = 2001
"""Number of the telescope's strokes that are tried, first over its range, then between two of these."""

_GRID = 15
"""Number of strokes of each joint from which the nearest position in reach is sought."""


def nearest_posture(
    p: HdrmParameters,
    position: Sequence[float],
    start: Sequence[float],
    is_allowed: Callable[[np.ndarray], np.ndarray],
) -> Three | None:
    """Return the strokes in m that bring the tip to a position; None if no posture does.

    Of all postures it is the one nearest to `start`: the sum of squares of the joints' ways, each as a
    fraction of its range, is the smallest. `is_allowed` says of each row of strokes whether it may be chosen.
    """
    low, high = p.q_LB[2], p.q_UB[2]
    width = np.array(p.q_UB) - np.array(p.q_LB)
    best = None
    for _ in range(2):
        tried = np.linspace(low, high, _STROKES)
        found = _reaching(p, position, tried)
        found = found[is_allowed(found)] if len(found) else found
        if not len(found):
            break
        lift, tilt, telescope = found[np.argmin(np.sum(((found - start) / width) ** 2, axis=1))].tolist()
        best = (lift, tilt, telescope)
        step = tried[1] - tried[0]
        low, high = max(p.q_LB[2], telescope - step), min(p.q_UB[2], telescope + step)
    return best


def _reaching(p: HdrmParameters, position: Sequence[float], telescope: np.ndarray) -> np.ndarray:
    """Return all strokes that bring the tip to a position, for strokes of the telescope."""
    x, y = position
    near, far = p.lift_length, p.reach + telescope
    cosine = (x * x + y * y - near * near - far * far) / (2.0 * near * far)
    found = []
    for sign in (-1.0, 1.0):
        with np.errstate(invalid="ignore"):
            theta_2 = sign * np.arccos(cosine)
            theta_1 = np.arctan2(y, x) - np.arctan2(far * np.sin(theta_2), near + far * cosine)
        lift = _stroke(theta_1 - p.lift_delta + p.lift_epsilon, p.lift_a, p.lift_b) - p.lift_L_0
        tilt = _stroke(theta_2 - p.tilt_delta + p.tilt_epsilon, p.tilt_a, p.tilt_b) - p.tilt_L_0
        found.append(np.column_stack([lift, tilt, telescope]))
    strokes = np.concatenate(found)
    return strokes[np.all((strokes >= p.q_LB) & (strokes <= p.q_UB), axis=1)]


def _stroke(gamma: np.ndarray, a: float, b: float) -> np.ndarray:
    """Return an actuator's length for the angle between its pins; NaN if its triangle does not close so."""
    turned = np.mod(gamma + np.pi, 2.0 * np.pi) - np.pi
    return np.where(turned > 0.0, np.sqrt(a * a + b * b - 2.0 * a * b * np.cos(turned)), np.nan)


def nearest_position(p: HdrmParameters, position: Sequence[float]) -> tuple[float, float]:
    """Return the position that the tip can reach nearest to one that it cannot, in m from O1."""
    bounds = list(zip(p.q_LB, p.q_UB, strict=True))
    strokes = np.array(list(product(*(np.linspace(low, high, _GRID) for low, high in bounds))))
    wanted = np.array(position)

    def distances(rows: np.ndarray) -> np.ndarray:
        return np.linalg.norm(postures(p, rows)["tip"] - wanted, axis=1)

    first = strokes[np.argmin(distances(strokes))]
    found = minimize(lambda q: float(distances(q[None])[0]), first, bounds=bounds, method="Nelder-Mead")
    x, y = postures(p, found.x[None])["tip"][0].tolist()
    return x, y
