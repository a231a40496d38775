"""Postures that bring the tip to a position, and positions that the tip can reach."""

from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import product

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


def nearest_posture(
    machine: MachineModel, position: Sequence[float], start: Sequence[float], margins: Rows
) -> tuple[float, ...] | None:
    """Return the strokes in m that bring the tip to a position; None if no posture does.

    Of all postures it is the one nearest to `start`: the sum of squares of the joints' ways, each as a
    fraction of its range, is the smallest.

    Args:
        machine: The machine.
        position: Coordinates in m.
        start: Strokes, m.
        margins: Returns what must not be negative for each row of strokes, in columns.
    """
    aim, low, high = np.array(position), np.array(machine.q_LB), np.array(machine.q_UB)
    width = high - low

    def way(q: np.ndarray) -> float:
        return float(np.sum(((q - start) / width) ** 2))

    samples, tips = _sampled(machine)
    distances = np.linalg.norm(tips - aim, axis=1)
    close = np.argsort(distances)[: max(len(samples) // 20, _STARTS)]
    ways = np.sum(((samples[close] - start) / width) ** 2, axis=1)
    begins = [np.array(start), *samples[close[np.argsort(ways)[:_STARTS]]], samples[close[0]]]
    reached = [q for begin in begins if (q := _reach(machine, aim, begin)) is not None]
    better = [_approach(machine, aim, q, way, margins) for q in reached]
    allowed = [q for q in (*reached, *better) if q is not None and np.all(margins(q[None]) >= -_NEAR)]
    if not allowed:
        return None
    return tuple(min(allowed, key=way).tolist())


def nearest_position(machine: MachineModel, position: Sequence[float]) -> tuple[float, ...]:
    """Return the position that the tip can reach nearest to one that it cannot, in m."""
    aim = np.array(position)
    samples, tips = _sampled(machine)
    begins = np.argsort(np.linalg.norm(tips - aim, axis=1))[:_STARTS]
    found = [machine.tip(_closest(machine, aim, samples[i])[None])[0] for i in begins]
    return tuple(min(found, key=lambda tip: float(np.linalg.norm(tip - aim))).tolist())


def _reach(machine: MachineModel, aim: np.ndarray, begin: np.ndarray) -> np.ndarray | None:
    """Return strokes near others that bring the tip to a position, if there are any."""
    q = _closest(machine, aim, begin)
    tolerance = _NEAR if len(q) >= len(aim) else _ROUGHLY
    return q if np.linalg.norm(machine.tip(q[None])[0] - aim) <= tolerance else None


def _closest(machine: MachineModel, aim: np.ndarray, begin: np.ndarray) -> np.ndarray:
    """Return strokes near others that bring the tip as close to a position as is possible from there."""
    low, high = np.array(machine.q_LB), np.array(machine.q_UB)

    def apart(q: np.ndarray) -> np.ndarray:
        return np.nan_to_num(machine.tip(q[None])[0] - aim, nan=1e3)

    inner = np.clip(begin, low + 1e-6 * (high - low), high - 1e-6 * (high - low))
    found = least_squares(
        apart,
        inner,
        lambda q: _slopes(machine.tip, q),  # pyright: ignore[reportArgumentType]
        bounds=(low, high),
        xtol=1e-12,
        ftol=1e-12,
        gtol=1e-12,
    )
    return _polish(machine, aim, found.x)


def _polish(machine: MachineModel, aim: np.ndarray, q: np.ndarray) -> np.ndarray:
    """Return strokes after steps of Newton's method to a position, if these come closer."""
    best, distance = q, float(np.linalg.norm(machine.tip(q[None])[0] - aim))
    for _ in range(4):
        slopes = _slopes(machine.tip, best)
        if not np.isfinite(slopes).all():
            break
        change = np.linalg.pinv(slopes) @ (machine.tip(best[None])[0] - aim)
        trial = np.clip(best - change, machine.q_LB, machine.q_UB)
        apart = float(np.linalg.norm(machine.tip(trial[None])[0] - aim))
        if not apart < distance:
            break
        best, distance = trial, apart
    return best


def _approach(
    machine: MachineModel,
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
            "fun": lambda q: machine.tip(q[None])[0] - aim,
            "jac": lambda q: _slopes(machine.tip, q),
        },
        {"type": "ineq", "fun": lambda q: margins(q[None])[0], "jac": lambda q: _slopes(margins, q)},
    ]
    bounds = list(zip(machine.q_LB, machine.q_UB, strict=True))
    found = minimize(
        way, begin, method="SLSQP", bounds=bounds, constraints=constraints, options={"ftol": 1e-12}
    )
    if not np.isfinite(found.x).all():
        return None
    q = _polish(machine, aim, np.clip(found.x, machine.q_LB, machine.q_UB))
    return q if np.linalg.norm(machine.tip(q[None])[0] - aim) <= _NEAR else None


def _slopes(function: Rows, q: np.ndarray) -> np.ndarray:
    """Return the derivatives of columns with respect to strokes, by central differences."""
    steps = _STEP * np.eye(len(q))
    values = function(np.concatenate([q + steps, q - steps]))
    return (values[: len(q)] - values[len(q) :]).T / (2.0 * _STEP)


@lru_cache(maxsize=8)
def _sampled(machine: MachineModel) -> tuple[np.ndarray, np.ndarray]:
    """Return postures over all strokes, and the positions of the tip."""
    low, high, n = np.array(machine.q_LB), np.array(machine.q_UB), len(machine.names)
    count = _SLOW_SAMPLES if machine.closure.iterated else _SAMPLES
    if n <= _GRID_JOINTS:
        places = np.linspace(0.0, 1.0, round(count ** (1.0 / n)))
        shares = np.array(list(product(*[places] * n)))
    else:
        shares = qmc.Halton(n, scramble=False).random(count)
    samples = low + shares * (high - low)
    tips = machine.tip(samples)
    closes = np.isfinite(tips).all(axis=1)
    return samples[closes], tips[closes]
