"""Distributions of discrete values."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ...base.arrays import Vector
from ...system.model import Value
from .distribution import Distribution

MOST_LEVELS = 1000
"""Most integers that are levels of a grid; a longer range has no levels."""

_LARGEST_INTEGER = 2**53
"""A double holds every integer up to this one."""


@dataclass(frozen=True)
class ValueList(Distribution):
    """The values of a list, equally likely, in this order. A value that occurs twice is twice as likely.

    If one number is real, all numbers are.
    """

    name: ClassVar[str] = "values"
    noun: ClassVar[str] = "a list of values"

    values: Sequence[Value]

    def __post_init__(self) -> None:
        if isinstance(self.values, Sequence) and not isinstance(self.values, str):
            plain = [str(v) if isinstance(v, Path) else v for v in self.values]
            object.__setattr__(self, "values", plain)
        super().__post_init__()
        real = all(map(_is_number, self.values)) and any(isinstance(v, float) for v in self.values)
        object.__setattr__(self, "values", tuple(map(float, self.values) if real else self.values))

    def at(self, quantiles: Vector) -> list[Value]:
        """The value whose share of 0 to 1 holds each quantile."""
        count = len(self.values)
        places = np.clip(np.floor(np.asarray(quantiles) * count), 0, count - 1).astype(np.intp)
        return [self.values[i] for i in places.tolist()]

    @property
    def level_count(self) -> int:
        """The number of values."""
        return len(self.values)

    @property
    def levels(self) -> Sequence[Value]:
        """The values in the order of the list."""
        return self.values

    @property
    def ends(self) -> tuple[Value, Value]:
        """The lowest and highest number; for other values the first and last."""
        if all(map(_is_number, self.values)):
            return min(self.values), max(self.values)
        return self.values[0], self.values[-1]

    def _check(self) -> None:
        if not self.values:
            self.refuse("needs one value or more; it is empty.")
        for value in self.values:
            if isinstance(value, float) and not math.isfinite(value):
                self.refuse(f"holds {value}; its numbers must be finite.", value=value)
            if type(value) is int:
                _check_integer(self, value)
            if self.relative and not _is_number(value):
                self.refuse(f"that is relative needs factors; {value!r} is not a number.", value=value)


@dataclass(frozen=True)
class Integers(Distribution):
    """Whole numbers from `low` to `high`, both included, equally likely.

    Up to 1000 of them (`MOST_LEVELS`) are levels of a grid; a longer range has none.
    """

    name: ClassVar[str] = "integers"
    noun: ClassVar[str] = "a range of integers"

    low: int
    high: int

    def at(self, quantiles: Vector) -> list[Value]:
        """The value whose share of 0 to 1 holds each quantile."""
        steps = np.clip(np.floor(np.asarray(quantiles) * self._count), 0, self._count - 1)
        return (self.low + steps.astype(np.int64)).tolist()

    @property
    def level_count(self) -> int | None:
        """The number of integers, up to `MOST_LEVELS`."""
        return self._count if self._count <= MOST_LEVELS else None

    @property
    def levels(self) -> Sequence[Value] | None:
        """All integers, up to `MOST_LEVELS` of them."""
        return None if self.level_count is None else range(self.low, self.high + 1)

    @property
    def ends(self) -> tuple[Value, Value]:
        """The lowest and highest integer."""
        return self.low, self.high

    @property
    def _count(self) -> int:
        return self.high - self.low + 1

    def _check(self) -> None:
        _check_integer(self, self.low)
        _check_integer(self, self.high)
        if self.low > self.high:
            self.refuse(f"needs low <= high; {self.low} to {self.high} is an empty range.")


def _check_integer(distribution: Distribution, value: int) -> None:
    if abs(value) > _LARGEST_INTEGER:
        distribution.refuse(f"supports integers up to 2^53, {_LARGEST_INTEGER}; {value} is larger.")


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)
