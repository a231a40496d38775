"""Kinds of distributions: how one quantity varies."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, ClassVar, NoReturn, get_type_hints

import numpy as np

from ...base.arrays import Vector
from ...base.errors import CommandError
from ...base.values import convert_value
from ...system.model import Value

MOST_LEVELS = 1000
"""Most integers that are levels of a grid; a longer range has no levels."""

_MIN_Q = 2.0**-53
"""Quantile used instead of 0 (and its complement instead of 1) without a bound; random numbers reach 0."""

_MIN_PROBABILITY = 1e-15
"""A truncation that leaves less probability than this is refused."""


@dataclass(frozen=True)
class Distribution(ABC):
    """Base class of distributions: how one quantity varies.

    Args:
        relative: whether values are factors of the nominal value of the quantity.

    Raises:
        CommandError: a value has a wrong type, is not finite, or leaves no range.
    """

    name: ClassVar[str]
    noun: ClassVar[str]
    """Its name in messages, with an article."""

    relative: bool = field(default=False, kw_only=True)

    def __post_init__(self) -> None:
        types = get_type_hints(type(self))
        for f in fields(self):
            label = f"{f.name} of {self.noun}"
            value = convert_value(getattr(self, f.name), types[f.name], label)
            if isinstance(value, float) and not math.isfinite(value):
                raise CommandError(f"{label} is {value}; it must be a finite number.", value=value)
            object.__setattr__(self, f.name, value)
        self._check()

    @abstractmethod
    def at(self, quantiles: Vector) -> list[Value]:
        """Return the inverse distribution function: a finite value for each quantile from 0 to 1."""

    @property
    def level_count(self) -> int | None:
        """The number of levels in a grid, without listing them; None if there are none."""
        return None

    @property
    def levels(self) -> Sequence[Value] | None:
        """The levels in a grid, in order; None if there are none."""
        count = self.level_count
        return None if count is None else self.at((np.arange(count) + 0.5) / count)

    @property
    def ends(self) -> tuple[Value, Value]:
        """The lowest and highest value; without a bound, the 5 % or 95 % quantile."""
        low, high = self.at(np.array([0.0, 1.0]))
        return low, high

    @abstractmethod
    def _check(self) -> None:
        """Raise CommandError for inconsistent values."""

    def _check_integer_size(self, value: int) -> None:
        if abs(value) > 2**53:  # a double holds every integer up to this one
            self.refuse(f"supports integers up to 2^53, {2**53}; {value} is larger.")

    def refuse(self, sentence: str, **details: Any) -> NoReturn:
        """Raise CommandError with a message that begins with the name of the distribution."""
        raise CommandError(f"{self.noun} {sentence}", distribution=self.name, **details)


@dataclass(frozen=True)
class ValueList(Distribution):
    """The values of a list, equally likely, in this order. A value that occurs twice is twice as likely.

    If one number is real, all numbers are.
    """

    name = "values"
    noun = "a list of values"

    values: Sequence[Value]

    def __post_init__(self) -> None:
        if isinstance(self.values, Sequence) and not isinstance(self.values, str):
            plain = [str(v) if isinstance(v, Path) else v for v in self.values]
            object.__setattr__(self, "values", plain)
        super().__post_init__()
        real = all(map(is_number, self.values)) and any(isinstance(v, float) for v in self.values)
        object.__setattr__(self, "values", tuple(map(float, self.values) if real else self.values))

    def at(self, quantiles: Vector) -> list[Value]:
        """Return the value whose share of 0 to 1 holds each quantile."""
        return [self.values[i] for i in _find_share(quantiles, len(self.values)).tolist()]

    @property
    def level_count(self) -> int:
        """The number of values."""
        return len(self.values)

    @property
    def ends(self) -> tuple[Value, Value]:
        """The lowest and highest number; for other values the first and last."""
        if all(map(is_number, self.values)):
            return min(self.values), max(self.values)
        return self.values[0], self.values[-1]

    def _check(self) -> None:
        if not self.values:
            self.refuse("needs one value or more; it is empty.")
        for value in self.values:
            if isinstance(value, float) and not math.isfinite(value):
                self.refuse(f"holds {value}; its numbers must be finite.", value=value)
            if type(value) is int:
                self._check_integer_size(value)
            if self.relative and not is_number(value):
                self.refuse(f"that is relative needs factors; {value!r} is not a number.", value=value)


@dataclass(frozen=True)
class Integers(Distribution):
    """Whole numbers from `low` to `high`, both included, equally likely.

    Up to 1000 of them (`MOST_LEVELS`) are levels of a grid; a longer range has none.
    """

    name = "integers"
    noun = "a range of integers"

    low: int
    high: int

    def at(self, quantiles: Vector) -> list[Value]:
        """Return the value whose share of 0 to 1 holds each quantile."""
        return (self.low + _find_share(quantiles, self.high - self.low + 1)).tolist()

    @property
    def level_count(self) -> int | None:
        """The number of integers, up to `MOST_LEVELS`."""
        count = self.high - self.low + 1
        return count if count <= MOST_LEVELS else None

    def _check(self) -> None:
        self._check_integer_size(self.low)
        self._check_integer_size(self.high)
        if self.low > self.high:
            self.refuse(f"needs low <= high; {self.low} to {self.high} is an empty range.")


def _find_share(quantiles: Vector, count: int) -> np.ndarray:
    """Return the position of each quantile among `count` equal shares of 0 to 1."""
    return np.clip(np.floor(np.asarray(quantiles) * count), 0, count - 1).astype(np.int64)


def is_number(value: Any) -> bool:
    """Return whether a value is a number; Booleans are not."""
    return isinstance(value, (int, float)) and not isinstance(value, bool)


class _Continuous(Distribution):
    """A distribution of real numbers from `low` to `high`, None if unbounded; `positive` fields exceed 0."""

    low: Any
    high: Any
    positive: ClassVar[Sequence[str]] = ()

    def at(self, quantiles: Vector) -> list[Value]:
        """Return the inverse distribution function, exact at the bounds."""
        low, high = self.low, self.high
        q = np.asarray(quantiles, dtype=np.float64)
        inner = np.clip(q, _MIN_Q if low is None else 0, 1 - _MIN_Q if high is None else 1)
        with np.errstate(
            over="ignore"
        ):  # `_check` of truncated distributions looks for infinite values itself
            values = np.array(self._invert(inner))
        if low is not None:
            values = np.where(q <= 0, low, np.maximum(values, low))
        if high is not None:
            values = np.where(q >= 1, high, np.minimum(values, high))
        return values.tolist()

    @property
    def ends(self) -> tuple[Value, Value]:
        """The bounds; without a bound, the 5 % or 95 % quantile."""
        low, high = self.low, self.high
        inner = self.at(np.array([0.05, 0.95]))
        return inner[0] if low is None else low, inner[1] if high is None else high

    @abstractmethod
    def _invert(self, q: Vector) -> Vector:
        """Return the inverse distribution function, except for rounding at the bounds."""

    def _check(self) -> None:
        for name in self.positive:
            value = getattr(self, name)
            if value is not None and value <= 0:
                self.refuse(f"needs {name} > 0; it is {value!r}.", value=value)
        low, high = self.low, self.high
        if low is None or high is None:
            return
        if low >= high:
            self.refuse(f"needs low < high; {low!r} to {high!r} is an empty range.", low=low, high=high)
        if math.isinf(high - low):
            self.refuse(f"cannot be as wide as {low!r} to {high!r}: high - low must be below 1.8e308.")


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


class Uniform(_Spaced):
    """Equally likely everywhere from `low` to `high`; a grid takes `points` levels, evenly spaced."""

    name = "uniform"
    noun = "a uniform distribution"

    def _invert(self, q: Vector) -> Vector:
        return self.low + q * (self.high - self.low)


class LogUniform(_Spaced):
    """The logarithm is uniform; `points` levels of a grid are evenly spaced in the logarithm."""

    name = "log-uniform"
    noun = "a log-uniform distribution"
    positive = ("low", "high")

    def _invert(self, q: Vector) -> Vector:
        low, high = math.log(self.low), math.log(self.high)
        return np.exp(low + q * (high - low))


class _Truncated(_Continuous):
    """A normal distribution of values, or of their logarithms."""

    deviation: float

    @abstractmethod
    def _standardize(self, value: float) -> float:
        """Return how many standard deviations a value is above the middle."""

    def _standardize_bounds(self) -> tuple[float, float, float]:
        """Return the bounds as standard deviations above the middle, and the probability between them."""
        from scipy.special import ndtr  # slow to import, and most sweeps have no normal distribution

        # as the difference of the smaller tails: that of numbers near 1 would lose all digits
        low = -math.inf if self.low is None else self._standardize(self.low)
        high = math.inf if self.high is None else self._standardize(self.high)
        return low, high, float(ndtr(-low) - ndtr(-high) if low > 0 else ndtr(high) - ndtr(low))

    def _find_deviations(self, q: Vector) -> Vector:
        """Return how far quantiles are above the middle.

        It uses the probability below in the lower half and above in the upper half, to resolve both tails.
        """
        from scipy.special import ndtr, ndtri

        low, high, probability = self._standardize_bounds()
        below = ndtr(low) + q * probability
        above = ndtr(-high) + (1 - q) * probability
        return self.deviation * np.where(below < 0.5, ndtri(below), -ndtri(above))

    def _check(self) -> None:
        super()._check()
        if self._standardize_bounds()[2] < _MIN_PROBABILITY:
            self.refuse("has no values between its low and high; choose bounds nearer to its middle.")
        if not np.isfinite(self.at(np.array([0.0, 1.0]))).all():
            self.refuse("as wide as this exceeds 1.8e308; reduce the deviation, or set low and high.")


@dataclass(frozen=True)
class Normal(_Truncated):
    """A normal distribution by mean and standard deviation; `low` and `high` truncate it."""

    name = "normal"
    noun = "a normal distribution"
    positive = ("deviation",)

    mean: float
    deviation: float
    low: float | None = None
    high: float | None = None

    def _standardize(self, value: float) -> float:
        return (value - self.mean) / self.deviation

    def _invert(self, q: Vector) -> Vector:
        return self.mean + self._find_deviations(q)


@dataclass(frozen=True)
class LogNormal(_Truncated):
    """The natural logarithm is normal; `low` and `high` truncate it.

    `median` is that of the value, `deviation` the standard deviation of the logarithm.
    """

    name = "log-normal"
    noun = "a log-normal distribution"
    positive = ("median", "deviation", "low", "high")

    median: float
    deviation: float
    low: float | None = None
    high: float | None = None

    def _standardize(self, value: float) -> float:
        return (math.log(value) - math.log(self.median)) / self.deviation

    def _invert(self, q: Vector) -> Vector:
        return np.exp(math.log(self.median) + self._find_deviations(q))


@dataclass(frozen=True)
class Triangular(_Continuous):
    """Density rises linearly from `low` to `mode`, the most likely value, and falls linearly to `high`."""

    name = "triangular"
    noun = "a triangular distribution"

    low: float
    mode: float
    high: float

    def _invert(self, q: Vector) -> Vector:
        width = self.high - self.low
        below = (self.mode - self.low) / width
        rising = self.low + width * np.sqrt(q * below)
        falling = self.high - width * np.sqrt((1 - q) * (1 - below))
        return np.where(q < below, rising, falling)

    def _check(self) -> None:
        super()._check()
        if not self.low <= self.mode <= self.high:
            self.refuse(
                f"needs low <= mode <= high; mode is {self.mode!r}, outside {self.low!r} to {self.high!r}."
            )
