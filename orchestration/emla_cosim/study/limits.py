"""The ranges of a joint's plant, and the first time that each joint leaves one of its own."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

from ..arrays import Vector
from .roles import Named, variable


class Range(NamedTuple):
    """The role of a signal and of what bounds it; without a lower bound, plus and minus the upper."""

    role: str
    what: str
    unit: str
    low: str | None
    high: str


RANGES = (
    Range("x_L", "stroke", "m", "q_LB", "q_UB"),
    Range("v_L", "speed", "m/s", None, "v_max"),
    Range("i_q", "current", "A", None, "i_max"),
    Range("i_d", "current", "A", None, "i_max"),
    Range("temperature_rise", "winding temperature", "K", None, "permitted_rise"),
)
"""What a joint should stay within; a plant without these parameters has no ranges."""


@dataclass(frozen=True)
class LeftLimits:
    """Where a joint first was outside a range: the signal by its full name, and the range in its unit."""

    signal: str
    time_s: float
    value: float
    minimum: float
    maximum: float


class _Watched(NamedTuple):
    joint: str
    range: Range
    signal: str
    column: int
    minimum: float
    maximum: float


class LimitWatch:
    """Looks at every row for the first value outside a range, for each joint."""

    def __init__(
        self,
        joints: Iterable[str],
        columns: Mapping[str, int],
        parameters: Mapping[str, float],
        roles: Mapping[str, str],
    ) -> None:
        """Take the columns of signals and the values of parameters, both by full name, and given roles."""
        columns, parameters = Named(columns), Named(parameters)
        self._watched = [
            watched
            for joint in joints
            for range_ in RANGES
            if (watched := _watched(joint, range_, columns, parameters, roles)) is not None
        ]
        self._ranges = {watched.signal: watched.range for watched in self._watched}
        self._left: dict[str, LeftLimits] = {}
        self._prepare()

    def left(self, joint: str) -> LeftLimits | None:
        """Where a joint first was outside; None while it never was."""
        return self._left.get(joint)

    def sentence(self, joint: str) -> str | None:
        """The same in words."""
        left = self._left.get(joint)
        if left is None:
            return None
        range_ = self._ranges[left.signal]
        value = _told_apart(left.value, left.minimum if left.value < left.minimum else left.maximum)
        return (
            f"{joint} left its {range_.what} range at t = {left.time_s:.6g} s: {left.signal} = {value} "
            f"{range_.unit}, not within {left.minimum:.6g} to {left.maximum:.6g} {range_.unit}."
        )

    def write(self, rows: Vector) -> None:
        """Take the next rows (time first)."""
        values = rows[:, self._columns]
        outside = ~((self._minima <= values) & (values <= self._maxima))  # NaN is outside
        places = np.flatnonzero(outside.any(axis=0))
        first = outside[:, places].argmax(axis=0)
        for row, place in sorted(zip(first.tolist(), places.tolist(), strict=True)):
            joint, _, signal, _, low, high = self._watched[place]
            time, value = float(rows[row, 0]), float(values[row, place])
            self._left.setdefault(joint, LeftLimits(signal, time, value, low, high))
        self._prepare()

    def memory(self) -> dict[str, Any]:
        """What was found so far, as plain data by joint."""
        return {joint: asdict(left) for joint, left in self._left.items()}

    def remember(self, memory: Mapping[str, Any]) -> None:
        """Go on from what `memory` gave."""
        self._left = {joint: self._remembered(left) for joint, left in memory.items()}
        self._prepare()

    def _remembered(self, left: Mapping[str, Any]) -> LeftLimits:
        """What a memory holds, which may come from a file that somebody made; KeyError, ValueError if so."""
        signal = left["signal"]
        if signal not in self._ranges:
            raise KeyError(signal)
        return LeftLimits(signal, *(float(left[n]) for n in ("time_s", "value", "minimum", "maximum")))

    def _prepare(self) -> None:
        """Leave out the joints that were outside already: only the first time counts."""
        self._watched = [w for w in self._watched if w.joint not in self._left]
        self._columns = np.array([w.column for w in self._watched], dtype=int)
        self._minima = np.array([w.minimum for w in self._watched])
        self._maxima = np.array([w.maximum for w in self._watched])


def _watched(
    joint: str,
    range_: Range,
    columns: Mapping[str, int],
    parameters: Mapping[str, float],
    roles: Mapping[str, str],
) -> _Watched | None:
    signal = variable(joint, range_.role, columns, roles)
    highest = variable(joint, range_.high, parameters, roles)
    if signal is None or highest is None:
        return None
    high = parameters[highest]
    lowest = None if range_.low is None else variable(joint, range_.low, parameters, roles)
    low = -high if range_.low is None else -np.inf if lowest is None else parameters[lowest]
    return _Watched(joint, range_, signal, columns[signal], low, high)


def _told_apart(value: float, limit: float) -> str:
    """A value with as many digits as it takes to see that it is not its limit, but no fewer than 4."""
    texts: Sequence[tuple[str, str]] = [(f"{value:.{n}g}", f"{limit:.{n}g}") for n in range(4, 18)]
    return next((text for text, other in texts if text != other), repr(value))
