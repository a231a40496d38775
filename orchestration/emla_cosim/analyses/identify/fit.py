"""How well a prediction fits what was measured, and what its residuals still contain."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from ...base.arrays import Vector
from .certainty import autocorrelation
from .loss import find_robust_deviation
from .measurement import EXACT, MeasuredSignal

_LAGS = 20
"""Lags of the tests of residuals."""

_PROBABILITY = 0.01
"""Probability with which the tests call residuals of a perfect model correlated."""

_OUTLIER = 6.0
"""Distance from the median of residuals in robust standard deviations from which a sample is an outlier."""


@dataclass(frozen=True)
class Fit:
    """The fit of a signal in an experiment.

    Attributes:
        experiment: the experiment.
        signal: the signal.
        unit: its unit.
        held_out: whether the experiment serves to validate only.
        samples: number of samples.
        rms: root mean square of prediction minus measurement.
        fit: 1 - norm(prediction - measurement) / norm(measurement - its mean); 1 is perfect.
        r2: coefficient of determination.
        autocorrelation: autocorrelation of the residuals at a lag of one sample.
        is_white: whether a Ljung-Box test over 20 lags finds no autocorrelation (at 1 %).
        related_input: the input with which residuals are correlated most, if significantly (at 1 %).
        outliers: number of samples further than 6 robust standard deviations from the median.
    """

    experiment: str
    signal: str
    unit: str
    held_out: bool
    samples: int
    rms: float
    fit: float
    r2: float
    autocorrelation: float
    is_white: bool
    related_input: str | None
    outliers: int


def assess_fit(
    experiment: str,
    held_out: bool,
    one: MeasuredSignal,
    differences: Vector,
    inputs: Mapping[str, tuple[Vector, Vector]],
) -> Fit:
    """Return the fit of a signal.

    Args:
        experiment: its experiment.
        held_out: whether that serves to validate only.
        one: the measured signal.
        differences: prediction minus measurement, shape (n,).
        inputs: times and values of the data that drive inputs, by column.
    """
    count = len(differences)
    spread = float(np.sum((one.values - one.values.mean()) ** 2))
    squares = float(differences @ differences)
    exact = squares <= EXACT**2 * spread
    found = autocorrelation(differences)
    lags = min(_LAGS, max(count // 4, 1))
    statistic = (
        count * (count + 2.0) * float(np.sum(found[1 : lags + 1] ** 2 / (count - np.arange(1, lags + 1))))
    )
    centred = differences - np.median(differences)
    deviation = find_robust_deviation(centred)
    beyond = np.abs(centred) > _OUTLIER * deviation
    return Fit(
        experiment,
        one.signal,
        one.unit,
        held_out,
        count,
        float(np.sqrt(squares / count)),
        1.0 - float(np.sqrt(squares / spread)),
        1.0 - squares / spread,
        float(found[1]) if count > 1 else 0.0,
        exact or bool(statistic <= chi2.ppf(1.0 - _PROBABILITY, lags)),
        None if exact else _find_related_input(one.time, differences, found, inputs),
        int(beyond.sum()) if deviation > 0.0 and not exact else 0,
    )


def _find_related_input(
    time: Vector, differences: Vector, own: Vector, inputs: Mapping[str, tuple[Vector, Vector]]
) -> str | None:
    """Return the input with the largest significant cross-correlation at lags up to 20 samples.

    The band widens with the autocorrelations of both (Bartlett's formula).
    """
    best, worst = None, 1.0
    count = len(differences)
    for name, (at, values) in inputs.items():
        driven = np.interp(time, at, values)
        if np.ptp(driven) == 0.0 or np.ptp(differences) == 0.0 or count < 4 * _LAGS:
            continue
        its = autocorrelation(driven)
        far = min(count // 4, 1000)
        weight = max(1.0 + 2.0 * float(np.sum(own[1:far] * its[1:far])), 1.0)
        band = 2.576 * np.sqrt(weight / count) * np.sqrt(np.log(2 * _LAGS + 1.0))
        a = (differences - differences.mean()) / differences.std()
        b = (driven - driven.mean()) / driven.std()
        most = max(abs(float(a[lag:] @ b[: count - lag])) / count for lag in range(_LAGS + 1))
        if most / band > worst:
            best, worst = name, most / band
    return best


def list_poor_fits(fits: Sequence[Fit]) -> list[Fit]:
    """Return the fits whose residuals still contain something."""
    return [one for one in fits if not one.is_white or one.related_input is not None]
