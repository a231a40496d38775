"""The ranges of a joint's plant, and the first time that each joint leaves one of its own."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

from ..arrays import Vector


class Range(NamedTuple):
    """A signal of a joint and the parameters that bound it; without a lower one, plus and minus the upper."""

    signal: str
    what: str
    unit: str
    low: str | None
    high: str


RANGES = (
    Range("plant.x_L", "stroke", "m", "plant.screw.q_LB", "plant.screw.q_UB"),
    Range("plant.v_L", "speed", "m/s", None, "plant.screw.v_max"),
    Range("plant.i_q", "current", "A", None, "plant.motor.i_max"),
    Range("plant.i_d", "current", "A", None, "plant.motor.i_max"),
    Range("plant.motor.temperature_rise", "winding temperature", "K", None, "plant.motor.permitted_rise"),
)
"""What a joint should stay within; a plant without these parameters has no ranges."""

_RANGE_OF = {range_.signal: range_ for range_ in RANGES}


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
    column: int
    minimum: float
    maximum: float


class LimitWatch:
    """Looks at every row for the first value outside a range, for each joint."""

    def __init__(
        self, joints: Iterable[str], columns: Mapping[str, int], parameters: Mapping[str, float]
    ) -> None:
        """Take the columns of signals and the values of parameters, both by full name."""
        self._watched = [
            watched
            for joint in joints
            for range_ in RANGES
            if (watched := _watched(joint, range_, columns, parameters)) is not None
        ]
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
        range_ = _RANGE_OF[left.signal.removeprefix(f"{joint}.")]
        value = _told_apart(left.value, left.minimum if left.value < left.minimum else left.maximum)
        return (
            f"{joint} left its {range_.what} range at t = {left.time_s:.6g} s: {left.signal} = {value} "
            f"{range_.unit}, not within {left.minimum:.6g} to {left.maximum:.6g} {range_.unit}."
        )

    def write(self, rows: Vector) -> None:
        """Take the next rows (time first)."""
        values = rows[:, self._columns]
        outside = ~((self._minima <= values) & (values <= self._maxima))  # NaN is outside
        while outside.any():
            row, place = divmod(int(np.argmax(outside)), outside.shape[1])
            joint, range_, _, low, high = self._watched[place]
            time, value = float(rows[row, 0]), float(values[row, place])
            self._left[joint] = LeftLimits(f"{joint}.{range_.signal}", time, value, low, high)
            outside[:, [w.joint == joint for w in self._watched]] = False
        self._prepare()

    def memory(self) -> dict[str, Any]:
        """What was found so far, as plain data by joint."""
        return {joint: asdict(left) for joint, left in self._left.items()}

    def remember(self, memory: Mapping[str, Any]) -> None:
        """Go on from what `memory` gave."""
        self._left = {joint: _remembered(joint, left) for joint, left in memory.items()}
        self._prepare()

    def _prepare(self) -> None:
        """Leave out the joints that were outside already: only the first time counts."""
        self._watched = [w for w in self._watched if w.joint not in self._left]
        self._columns = np.array([w.column for w in self._watched], dtype=int)
        self._minima = np.array([w.minimum for w in self._watched])
        self._maxima = np.array([w.maximum for w in self._watched])


def _watched(
    joint: str, range_: Range, columns: Mapping[str, int], parameters: Mapping[str, float]
) -> _Watched | None:
    column = columns.get(f"{joint}.{range_.signal}")
    high = parameters.get(f"{joint}.{range_.high}")
    if column is None or high is None:
        return None
    low = -high if range_.low is None else parameters.get(f"{joint}.{range_.low}", -np.inf)
    return _Watched(joint, range_, column, low, high)


def _remembered(joint: str, left: Mapping[str, Any]) -> LeftLimits:
    """What a memory holds, which may come from a file that somebody made; KeyError and ValueError if so."""
    signal = f"{joint}.{_RANGE_OF[left['signal'].removeprefix(f'{joint}.')].signal}"
    return LeftLimits(signal, *(float(left[n]) for n in ("time_s", "value", "minimum", "maximum")))


def _told_apart(value: float, limit: float) -> str:
    """A value with as many digits as it takes to see that it is not its limit, but no fewer than 4."""
    texts: Sequence[tuple[str, str]] = [(f"{value:.{n}g}", f"{limit:.{n}g}") for n in range(4, 18)]
    return next((text for text, other in texts if text != other), repr(value))
