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

_NEAR, _ROUGHLY = 1e-9, 1e-3
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

    def way(q: np.ndarray) -> float:
        return float(np.sum(((q - start) / width) ** 2))

    samples, tips = _sampled(reach)
    distances = np.linalg.norm(tips - aim, axis=1)
    close = np.argsort(distances)[: max(len(samples) // 20, _STARTS)]
    ways = np.sum(((samples[close] - start) / width) ** 2, axis=1)
    begins = [np.array(start), *samples[close[np.argsort(ways)[:_STARTS]]], samples[close[0]]]
    reached = [q for begin in begins if (q := _reach(reach, aim, begin)) is not None]
    better = [_approach(reach, aim, q, way, margins) for q in reached]
    allowed = [q for q in (*reached, *better) if q is not None and np.all(margins(q[None]) >= -_NEAR)]
    if not allowed:
        return None
    return tuple(min(allowed, key=way).tolist())


def nearest_position(reach: Reach, position: Sequence[float]) -> tuple[float, ...]:
    """Return the position that the tip can reach nearest to one that it cannot, in m."""
    aim = np.array(position)
    samples, tips = _sampled(reach)
    begins = np.argsort(np.linalg.norm(tips - aim, axis=1))[:_STARTS]
    found = [reach.tip(_closest(reach, aim, samples[i])[None])[0] for i in begins]
    return tuple(min(found, key=lambda tip: float(np.linalg.norm(tip - aim))).tolist())


def _reach(reach: Reach, aim: np.ndarray, begin: np.ndarray) -> np.ndarray | None:
    """Return strokes near others that bring the tip to a position, if there are any."""
    q = _closest(reach, aim, begin)
    tolerance = _NEAR if len(q) >= len(aim) else _ROUGHLY
    return q if np.linalg.norm(reach.tip(q[None])[0] - aim) <= tolerance else None


def _closest(reach: Reach, aim: np.ndarray, begin: np.ndarray) -> np.ndarray:
    """Return strokes near others that bring the tip as close to a position as is possible from there."""
    low, high = np.array(reach.machine.q_LB), np.array(reach.machine.q_UB)

    def apart(q: np.ndarray) -> np.ndarray:
        return np.nan_to_num(reach.tip(q[None])[0] - aim, nan=1e3)

    inner = np.clip(begin, low + 1e-6 * (high - low), high - 1e-6 * (high - low))
    found = least_squares(
        apart,
        inner,
        lambda q: _slopes(reach.tip, q),  # pyright: ignore[reportArgumentType]
        bounds=(low, high),
        xtol=1e-12,
        ftol=1e-12,
        gtol=1e-12,
    )
    return _polish(reach, aim, found.x)


def _polish(reach: Reach, aim: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return strokes after steps of Newton's method to a position, if these come closer."""
    best, distance = q, float(np.linalg.norm(reach.tip(q[None])[0] - aim))
    for _ in range(4):
        slopes = _slopes(reach.tip, best)
        if not np.isfinite(slopes).all():
            break
        change = np.linalg.pinv(slopes) @ (reach.tip(best[None])[0] - aim)
        trial = np.clip(best - change, reach.machine.q_LB, reach.machine.q_UB)
        apart = float(np.linalg.norm(reach.tip(trial[None])[0] - aim))
        if not apart < distance:
            break
        best, distance = trial, apart
    return best


def _approach(
    reach: Reach,
    aim: np.ndarray,
    begin: np.ndarray,
    way: Callable[[np.ndarray], float],
    margins: Rows,
) -> np.ndarray | None:
    """Return the posture with the shortest way near another one that has its tip at the same position."""
    if len(begin) <= len(aim):
        return None
    constraints = [
        {
            "type": "eq",
            "fun": lambda q: reach.tip(q[None])[0] - aim,
            "jac": lambda q: _slopes(reach.tip, q),
        },
        {"type": "ineq", "fun": lambda q: margins(q[None])[0], "jac": lambda q: _slopes(margins, q)},
    ]
    bounds = list(zip(reach.machine.q_LB, reach.machine.q_UB, strict=True))
    found = minimize(
        way, begin, method="SLSQP", bounds=bounds, constraints=constraints, options={"ftol": 1e-12}
    )
    if not np.isfinite(found.x).all():
        return None
    q = _polish(reach, aim, np.clip(found.x, reach.machine.q_LB, reach.machine.q_UB))
    return q if np.linalg.norm(reach.tip(q[None])[0] - aim) <= _NEAR else None


def _slopes(function: Rows, q: np.ndarray) -> np.ndarray:
    """Return the derivatives of columns with respect to strokes, by central differences."""
    steps = _STEP * np.eye(len(q))
    values = function(np.concatenate([q + steps, q - steps]))
    return (values[: len(q)] - values[len(q) :]).T / (2.0 * _STEP)


@lru_cache(maxsize=8)
def _sampled(reach: Reach) -> tuple[np.ndarray, np.ndarray]:
    """Return postures over all strokes, and the positions of the tip."""
    low, high, n = np.array(reach.machine.q_LB), np.array(reach.machine.q_UB), len(reach.machine.names)
    count = _SLOW_SAMPLES if reach.machine.closure.iterated else _SAMPLES
    if n <= _GRID_JOINTS:
        places = np.linspace(0.0, 1.0, round(count ** (1.0 / n)))
        shares = np.array(list(product(*[places] * n)))
    else:
        shares = qmc.Halton(n, scramble=False).random(count)
    samples = low + shares * (high - low)
    tips = reach.tip(samples)
    closes = np.isfinite(tips).all(axis=1)
    return samples[closes], tips[closes]
