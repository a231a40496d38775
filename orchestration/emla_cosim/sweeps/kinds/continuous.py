"""Distributions of real numbers."""

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ...base.arrays import Vector
from ...system.model import Value
from .distribution import Distribution

_OUTERMOST = 2.0**-53
"""Quantile used instead of 0 (and its complement instead of 1) without a bound; random numbers reach 0."""

_LEAST_PROBABILITY = 1e-15
"""A truncation that leaves less probability than this is refused."""


class _Continuous(Distribution):
    """A distribution of real numbers from `low` to `high`; None means no bound."""

    low: Any
    high: Any

    def at(self, quantiles: Vector) -> list[Value]:
        """Return the inverse distribution function, exact at the bounds."""
        low, high = self.low, self.high
        given = np.asarray(quantiles, dtype=np.float64)
        inner = np.clip(given, _OUTERMOST if low is None else 0, 1 - _OUTERMOST if high is None else 1)
        with np.errstate(over="ignore"):
            values = np.array(self._inverse(inner))
        if low is not None:
            values = np.where(given <= 0, low, np.maximum(values, low))
        if high is not None:
            values = np.where(given >= 1, high, np.minimum(values, high))
        return values.tolist()

    @property
    def ends(self) -> tuple[Value, Value]:
        """The bounds; without a bound, the 5 % or 95 % quantile."""
        low, high = self.low, self.high
        inner = self.at(np.array([0.05, 0.95]))
        return inner[0] if low is None else low, inner[1] if high is None else high

    @abstractmethod
    def _inverse(self, q: Vector) -> Vector:
        """Return the inverse distribution function, except for rounding at the bounds."""

    def _check(self) -> None:
        low, high = self.low, self.high
        if low is not None and high is not None and low >= high:
            self.refuse(f"needs low < high; {low!r} to {high!r} is an empty range.", low=low, high=high)

    def _check_positive(self, *names: str) -> None:
        for name in names:
            value = getattr(self, name)
            if value is not None and value <= 0:
                self.refuse(f"needs {name} > 0; it is {value!r}.", value=value)

    def _check_width(self, low: float, high: float) -> None:
        if math.isinf(high - low):
            self.refuse(f"cannot be as wide as {low!r} to {high!r}: high - low must be below 1.8e308.")

    def _check_extremes(self) -> None:
        """Refuse a distribution with quantiles beyond the largest double."""
        if not np.isfinite(self.at(np.array([0.0, 1.0]))).all():
            self.refuse("as wide as this exceeds 1.8e308; reduce the deviation, or set low and high.")


@dataclass(frozen=True)
class _Spaced(_Continuous):
    """A bounded distribution with optional grid points."""

    low: float
    high: float
    points: int | None = None

    @property
    def level_count(self) -> int | None:
        """The number of points."""
        return self.points

    @property
    def levels(self) -> Sequence[Value] | None:
        """The values at evenly spaced quantiles, both bounds among them."""
        return None if self.points is None else self.at(np.arange(self.points) / (self.points - 1))

    def _check(self) -> None:
        super()._check()
        if self.points is not None and self.points < 2:
            self.refuse(f"needs 2 points or more, including both ends; points is {self.points}.")


@dataclass(frozen=True)
class Uniform(_Spaced):
    """Equally likely everywhere from `low` to `high`; a grid takes `points` levels, evenly spaced."""

    name: ClassVar[str] = "uniform"
    noun: ClassVar[str] = "a uniform distribution"

    def _inverse(self, q: Vector) -> Vector:
        return self.low + q * (self.high - self.low)

    def _check(self) -> None:
        super()._check()
        self._check_width(self.low, self.high)


@dataclass(frozen=True)
class LogUniform(_Spaced):
    """The logarithm is uniform; `points` levels of a grid are evenly spaced in the logarithm."""

    name: ClassVar[str] = "log-uniform"
    noun: ClassVar[str] = "a log-uniform distribution"

    def _inverse(self, q: Vector) -> Vector:
        low, high = math.log(self.low), math.log(self.high)
        return np.exp(low + q * (high - low))

    def _check(self) -> None:
        self._check_positive("low", "high")
        super()._check()


class _Truncated(_Continuous):
    """A normal distribution of values, or of their logarithms."""

    deviation: float

    @abstractmethod
    def _standard(self, value: float) -> float:
        """Return how many standard deviations a value is above the middle."""

    @property
    def _standard_bounds(self) -> tuple[float, float]:
        low = -math.inf if self.low is None else self._standard(self.low)
        return low, math.inf if self.high is None else self._standard(self.high)

    def _away(self, q: Vector) -> Vector:
        """Return how far quantiles are above the middle."""
        return self.deviation * _truncated_normal(q, *self._standard_bounds)

    def _check(self) -> None:
        super()._check()
        _check_truncation(self, *self._standard_bounds)
        self._check_extremes()


@dataclass(frozen=True)
class Normal(_Truncated):
    """A normal distribution by mean and standard deviation; `low` and `high` truncate it."""

    name: ClassVar[str] = "normal"
    noun: ClassVar[str] = "a normal distribution"

    mean: float
    deviation: float
    low: float | None = None
    high: float | None = None

    def _standard(self, value: float) -> float:
        return (value - self.mean) / self.deviation

    def _inverse(self, q: Vector) -> Vector:
        return self.mean + self._away(q)

    def _check(self) -> None:
        self._check_positive("deviation")
        super()._check()


@dataclass(frozen=True)
class LogNormal(_Truncated):
    """The natural logarithm is normal; `low` and `high` truncate it.

    `median` is that of the value, `deviation` the standard deviation of the logarithm.
    """

    name: ClassVar[str] = "log-normal"
    noun: ClassVar[str] = "a log-normal distribution"

    median: float
    deviation: float
    low: float | None = None
    high: float | None = None

    def _standard(self, value: float) -> float:
        return (math.log(value) - math.log(self.median)) / self.deviation

    def _inverse(self, q: Vector) -> Vector:
        return np.exp(math.log(self.median) + self._away(q))

    def _check(self) -> None:
        self._check_positive("median", "deviation", "low", "high")
        super()._check()


@dataclass(frozen=True)
class Triangular(_Continuous):
    """Density rises linearly from `low` to `mode`, the most likely value, and falls linearly to `high`."""

    name: ClassVar[str] = "triangular"
    noun: ClassVar[str] = "a triangular distribution"

    low: float
    mode: float
    high: float

    def _inverse(self, q: Vector) -> Vector:
        width = self.high - self.low
        below = (self.mode - self.low) / width
        rising = self.low + width * np.sqrt(q * below)
        falling = self.high - width * np.sqrt((1 - q) * (1 - below))
        return np.where(q < below, rising, falling)

    def _check(self) -> None:
        super()._check()
        self._check_width(self.low, self.high)
        if not self.low <= self.mode <= self.high:
            self.refuse(
                f"needs low <= mode <= high; mode is {self.mode!r}, outside {self.low!r} to {self.high!r}."
            )


def _truncated_normal(q: Vector, low: float, high: float) -> Vector:
    """Return the inverse distribution function of the standard normal distribution between two bounds.

    It uses the probability below in the lower half and above in the upper half, to resolve both tails.
    """
    from scipy.special import ndtr, ndtri  # slow to import, and most sweeps have no normal distribution

    probability = _probability(low, high)
    below = ndtr(low) + q * probability
    above = ndtr(-high) + (1 - q) * probability
    return np.where(below < 0.5, ndtri(below), -ndtri(above))


def _probability(low: float, high: float) -> float:
    """Return the probability of the standard normal distribution between two bounds."""
    from scipy.special import ndtr

    return float(ndtr(-low) - ndtr(-high) if low > 0 else ndtr(high) - ndtr(low))


def _check_truncation(distribution: Distribution, low: float, high: float) -> None:
    """Raise CommandError if there is no probability between two bounds in standard deviations."""
    if _probability(low, high) < _LEAST_PROBABILITY:
        distribution.refuse("has no values between its low and high; choose bounds nearer to its middle.")
