"""A shift in time between prediction and measurement, and how much of each estimate it makes.

Inputs and measurements are compared at the times that their files name. A sensor with a filter, a controller
that samples, or a recorder that writes a sample late shift them against each other. A model without it
fits a part of the shift with its parameters. Standard errors do not show that: it is the same in each cycle.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Vector
from .certainty import Certainty, find_covariance
from .loss import scale_for_loss
from .measurement import MeasuredSignal
from .parameters import Parameters

_CERTAIN = 3.0
"""Shift in its standard errors from which it is taken as real."""


@dataclass(frozen=True)
class TimeShift:
    """A measured signal that is later than predicted, or earlier if negative.

    Attributes:
        signal: the signal.
        seconds: by how much.
        error: standard error of that in s.
    """

    signal: str
    seconds: float
    error: float

    def __str__(self) -> str:
        way = "later" if self.seconds > 0.0 else "earlier"
        return (
            f"{self.signal} is {1e3 * abs(self.seconds):.3g} ± {1e3 * self.error:.1g} ms {way} than predicted"
        )


def find_time_shifts(
    samples: Sequence[MeasuredSignal],
    residuals: Vector,
    jacobian: NDArray[np.float64],
    sigma: Sequence[float],
    loss: str,
    known: Collection[str],
) -> tuple[list[TimeShift], Vector]:
    """Return the shifts that the residuals show, and by how much the estimates would move without them.

    Shifts and parameters are estimated together, by one Gauss-Newton step.

    Args:
        samples: the measured signals, in the order of the residuals.
        residuals: prediction minus measurement in standard deviations, shape (n,).
        jacobian: derivatives of the residuals by the places, shape (n, p).
        sigma: standard deviation of each signal in its unit.
        loss: the loss function, a name of `LOSSES`.
        known: signals whose delay is a parameter.

    Returns:
        The shifts, and the moves of the places, shape (p,).
    """
    pulls, factors = scale_for_loss(loss, residuals)
    lengths = [len(one.time) for one in samples]
    ends = np.cumsum([0, *lengths])
    slopes = np.zeros((len(residuals), len(samples)))
    for k, (one, deviation) in enumerate(zip(samples, sigma, strict=True)):
        part = slice(ends[k], ends[k + 1])
        predicted = one.values / deviation + residuals[part]
        if one.signal not in known and len(one.time) > 2:
            with np.errstate(all="ignore"):  # two samples at one time, where the signal jumps, have no slope
                slope = np.gradient(predicted, one.time)
            slopes[part, k] = np.where(np.isfinite(slope), slope, 0.0)
    moved = [k for k in range(len(samples)) if slopes[:, k].any()]
    free = np.flatnonzero(np.linalg.norm(jacobian, axis=0) > 0.0)
    while moved:
        every = np.column_stack([jacobian[:, free], slopes[:, moved]])
        sizes = np.linalg.norm(every, axis=0)
        every = every / sizes
        curvature = (every * factors[:, None] ** 2).T @ every
        change = np.linalg.lstsq(curvature, -every.T @ pulls, rcond=None)[0]
        try:
            # what is left: the shift itself is no noise that would hide it
            rest, weights = scale_for_loss(loss, residuals + every @ change)
            covariance = find_covariance(every * weights[:, None], every * rest[:, None], rest, lengths)
        except np.linalg.LinAlgError:  # a shift that the parameters can make as well
            break
        errors = np.sqrt(np.diag(covariance))
        certain = np.abs(change) > _CERTAIN * errors
        if certain[len(free) :].all():
            moves = np.zeros(jacobian.shape[1])
            moves[free] = (change / sizes)[: len(free)]
            seconds, of = (change / sizes)[len(free) :], (errors / sizes)[len(free) :]
            shifts = [
                TimeShift(samples[k].signal, float(-s), float(e))
                for k, s, e in zip(moved, seconds, of, strict=True)
            ]
            return shifts, moves
        moved = [k for k, is_certain in zip(moved, certain[len(free) :], strict=True) if is_certain]
    return [], np.zeros(jacobian.shape[1])


def describe_shifts(
    shifts: Sequence[TimeShift], parameters: Parameters, point: Vector, moves: Vector, found: Certainty
) -> list[str]:
    """Return a note on shifts in time.

    Args:
        shifts: the shifts.
        parameters: the parameters.
        point: places of the estimates, shape (p,).
        moves: by how much these would move without the shifts, shape (p,).
        found: the certainty without regard to the shifts.
    """
    if not shifts:
        return []
    changes = [
        abs(item.extrapolate(float(x + move)) - item.extrapolate(float(x))) / one.error
        for item, x, move, one in zip(parameters.items, point, moves, found.estimates, strict=True)
        if one.error
    ]
    most = max(changes, default=0.0)
    return [
        f"{' and '.join(map(str, shifts))}. Without this shift in time, estimates would change by up to "
        f"{most:.2g} standard errors; these contain that. Check the times of the data; a sensor that is late "
        "is 'delay(SIGNAL)' in --vary"
    ]
