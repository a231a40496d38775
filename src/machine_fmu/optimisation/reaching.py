"""Postures that bring the tip to a position, and positions that the tip can reach."""

from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares, minimize
from scipy.stats import qmc

from ..model import MachineModel

_SAMPLES, _SLOW_SAMPLES = 3375, 216
"""Number of postures from which solutions are sought; fewer where each pose needs Newton's method."""

_GRID_JOINTS = 3
"""Largest number of actuators whose samples are a grid."""

_TOLERANCE, _ROUGH_TOLERANCE = 1e-9, 1e-3
"""Largest distance in m of a tip that has reached a position; with fewer actuators than coordinates, which
cannot reach a position with rounded coordinates, the second one."""

_STARTS = 4
"""Number of samples from which a search begins."""

_STEP = 1e-6
"""Change of strokes in m for derivatives."""

Rows = Callable[[np.ndarray], np.ndarray]
"""A function of rows of strokes in m."""


class Reach(NamedTuple):
    """A machine that carries a payload in kg."""

    machine: MachineModel
    payload: float

    def tip(self, strokes: np.ndarray) -> np.ndarray:
        """Return positions of the tip in m, one row for each row of strokes."""
        return self.machine.tip(strokes, payload=self.payload)


def nearest_posture(
    reach: Reach, position: Sequence[float], start: Sequence[float], margins: Rows
) -> tuple[float, ...] | None:
    """Return the strokes in m that bring the tip to a position; None if no posture does.

    Of all postures it is the one nearest to `start`: the sum of squares of the joints' ways, each as a
    fraction of its range, is the smallest.

    Args:
        reach: The machine with its payload.
        position: Coordinates in m.
        start: Strokes, m.
        margins: Returns what must not be negative for each row of strokes, in columns.
    """
    aim, low, high = np.array(position), np.array(reach.machine.q_LB), np.array(reach.machine.q_UB)
    width = high - low

    def get_distance(q: np.ndarray) -> float:
        return float(np.sum(((q - start) / width) ** 2))

    samples, tips = _sample_postures(reach)
    distances = np.linalg.norm(tips - aim, axis=1)
    nearest_samples = np.argsort(distances)[: max(len(samples) // 20, _STARTS)]
    squares = np.sum(((samples[nearest_samples] - start) / width) ** 2, axis=1)
    starts = [
        np.array(start),
        *samples[nearest_samples[np.argsort(squares)[:_STARTS]]],
        samples[nearest_samples[0]],
    ]
    postures = [q for guess in starts if (q := _find_posture(reach, aim, guess)) is not None]
    shortened = [_shorten(reach, aim, q, get_distance, margins) for q in postures]
    allowed = [
        q for q in (*postures, *shortened) if q is not None and np.all(margins(q[None]) >= -_TOLERANCE)
    ]
    if not allowed:
        return None
    return tuple(min(allowed, key=get_distance).tolist())


def nearest_position(reach: Reach, position: Sequence[float]) -> tuple[float, ...]:
    """Return the position that the tip can reach nearest to one that it cannot, in m."""
    aim = np.array(position)
    samples, tips = _sample_postures(reach)
    starts = np.argsort(np.linalg.norm(tips - aim, axis=1))[:_STARTS]
    positions = [reach.tip(_find_closest(reach, aim, samples[i])[None])[0] for i in starts]
    return tuple(min(positions, key=lambda tip: float(np.linalg.norm(tip - aim))).tolist())


def _find_posture(reach: Reach, aim: np.ndarray, start: np.ndarray) -> np.ndarray | None:
    """Return strokes near others that bring the tip to a position, if there are any."""
    q = _find_closest(reach, aim, start)
    tolerance = _TOLERANCE if len(q) >= len(aim) else _ROUGH_TOLERANCE
    return q if np.linalg.norm(reach.tip(q[None])[0] - aim) <= tolerance else None


def _find_closest(reach: Reach, aim: np.ndarray, start: np.ndarray) -> np.ndarray:
    """Return strokes near others that bring the tip as close to a position as is possible from there."""
    low, high = np.array(reach.machine.q_LB), np.array(reach.machine.q_UB)

    def get_error(q: np.ndarray) -> np.ndarray:
        return np.nan_to_num(reach.tip(q[None])[0] - aim, nan=1e3)

    inner = np.clip(start, low + 1e-6 * (high - low), high - 1e-6 * (high - low))
    solution = least_squares(
        get_error,
        inner,
        lambda q: _differentiate(reach.tip, q),  # pyright: ignore[reportArgumentType]
        bounds=(low, high),
        xtol=1e-12,
        ftol=1e-12,
        gtol=1e-12,
    )
    return _refine(reach, aim, solution.x)


def _refine(reach: Reach, aim: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return strokes after steps of Newton's method to a position, if these come closer."""
    refined, distance = q, float(np.linalg.norm(reach.tip(q[None])[0] - aim))
    for _ in range(4):
        slopes = _differentiate(reach.tip, refined)
        if not np.isfinite(slopes).all():
            break
        step = np.linalg.pinv(slopes) @ (reach.tip(refined[None])[0] - aim)
        trial = np.clip(refined - step, reach.machine.q_LB, reach.machine.q_UB)
        trial_distance = float(np.linalg.norm(reach.tip(trial[None])[0] - aim))
        if not trial_distance < distance:
            break
        refined, distance = trial, trial_distance
    return refined


def _shorten(
    reach: Reach,
    aim: np.ndarray,
    start: np.ndarray,
    get_distance: Callable[[np.ndarray], float],
    margins: Rows,
) -> np.ndarray | None:
    """Return the posture with the shortest way near another one that has its tip at the same position."""
    if len(start) <= len(aim):
        return None
    constraints = [
        {
            "type": "eq",
            "fun": lambda q: reach.tip(q[None])[0] - aim,
            "jac": lambda q: _differentiate(reach.tip, q),
        },
        {"type": "ineq", "fun": lambda q: margins(q[None])[0], "jac": lambda q: _differentiate(margins, q)},
    ]
    bounds = list(zip(reach.machine.q_LB, reach.machine.q_UB, strict=True))
    solution = minimize(
        get_distance, start, method="SLSQP", bounds=bounds, constraints=constraints, options={"ftol": 1e-12}
    )
    if not np.isfinite(solution.x).all():
        return None
    q = _refine(reach, aim, np.clip(solution.x, reach.machine.q_LB, reach.machine.q_UB))
    return q if np.linalg.norm(reach.tip(q[None])[0] - aim) <= _TOLERANCE else None


def _differentiate(function: Rows, q: np.ndarray) -> np.ndarray:
    """Return the derivatives of columns with respect to strokes, by central differences."""
    steps = _STEP * np.eye(len(q))
    values = function(np.concatenate([q + steps, q - steps]))
    return (values[: len(q)] - values[len(q) :]).T / (2.0 * _STEP)


@lru_cache(maxsize=8)
def _sample_postures(reach: Reach) -> tuple[np.ndarray, np.ndarray]:
    """Return postures over all strokes, and the positions of the tip."""
    low, high, n = np.array(reach.machine.q_LB), np.array(reach.machine.q_UB), len(reach.machine.names)
    count = _SLOW_SAMPLES if reach.machine.closure.iterated else _SAMPLES
    if n <= _GRID_JOINTS:
        shares_of_axis = np.linspace(0.0, 1.0, round(count ** (1.0 / n)))
        shares = np.array(list(product(*[shares_of_axis] * n)))
    else:
        # a grid of 3375 points would have less than four steps for each of six actuators
        shares = qmc.Halton(n, scramble=False).random(count)
    samples = low + shares * (high - low)
    tips = reach.tip(samples)
    closes = np.isfinite(tips).all(axis=1)
    return samples[closes], tips[closes]
