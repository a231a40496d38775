"""The times at which the input clocks of an FMU tick."""

import ctypes
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emla_cosim.base.arrays import Vector
from emla_cosim.fmu.clocks import COUNTDOWN, PERIODIC, InputClock

_UNKNOWN = 0
"""The qualifier of an interval that is not known yet."""

_NEXT, _FIRST, _COUNT, _INTERVAL = range(4)
"""What is known of each clock: next and first tick in s, number of ticks, interval in s."""

SIZE = 4
"""The numbers for each clock."""


class ClockSchedule:
    """The next ticks of the clocks of an FMU.

    Ticks of a periodic clock are counted, not added up.

    Args:
        clocks: The clocks.
        memory: Memory for what is known of them, shape (clocks * SIZE,).
    """

    def __init__(self, clocks: Sequence[InputClock], memory: Vector) -> None:
        self.clocks = clocks
        self._known = memory.reshape(len(clocks), SIZE)

    def start(self, fmu: Any, start_time: float) -> None:
        """Find the first ticks, in initialization mode; times in s.

        Raises:
            ValueError: An interval is not valid; the message says which.
        """
        for i, clock in enumerate(self.clocks):
            if clock.kind in PERIODIC:
                interval, shift = clock.interval, clock.shift
                if interval is None:
                    interval, shift = self._ask(fmu, i)[0], self._ask_shift(fmu, i)
                self._check(clock, interval, interval > 0.0)
                self._check(clock, shift, shift >= 0.0, "shift")
                self._known[i] = start_time + shift, start_time + shift, 0.0, interval
            else:
                self._known[i] = math.inf
                self._ask_next(fmu, i, start_time)

    def next(self) -> float:
        """Return the time of the next tick in s; infinite without one."""
        return float(self._known[:, _NEXT].min(initial=math.inf))

    def due(self, time: float) -> NDArray[np.intp]:
        """Return the positions of the clocks that tick at or before a time in s."""
        return np.flatnonzero(self._known[:, _NEXT] <= time)

    def advance(self, fmu: Any, ticked: Sequence[int], time: float) -> None:
        """Find the ticks after those at a time in s, in event mode after an update of discrete states.

        Raises:
            ValueError: An interval is not valid; the message says which.
        """
        for i, clock in enumerate(self.clocks):
            if i in ticked:
                self._known[i, _NEXT] = math.inf
                if clock.kind in PERIODIC:
                    self._known[i, _COUNT] += 1.0
                    _, first, count, interval = self._known[i]
                    self._known[i, _NEXT] = first + count * interval
            if clock.kind == COUNTDOWN or (i in ticked and clock.kind not in PERIODIC):
                self._ask_next(fmu, i, time)

    def _ask_next(self, fmu: Any, i: int, time: float) -> None:
        """Ask for the next tick of an aperiodic clock; one that is known stays unless it has changed."""
        interval, qualifier = self._ask(fmu, i)
        if qualifier != _UNKNOWN and (qualifier > 1 or self._known[i, _NEXT] == math.inf):
            self._check(self.clocks[i], interval, interval >= 0.0)
            self._known[i, _NEXT] = time + interval

    def _ask(self, fmu: Any, i: int) -> tuple[float, int]:
        interval, qualifier = (ctypes.c_double * 1)(), (ctypes.c_int * 1)()
        fmu.getIntervalDecimal(self._reference(i), interval, qualifier)
        return interval[0], qualifier[0]

    def _ask_shift(self, fmu: Any, i: int) -> float:
        shift = (ctypes.c_double * 1)()
        fmu.getShiftDecimal(self._reference(i), shift)
        return shift[0]

    def _reference(self, i: int) -> Any:
        return (ctypes.c_uint32 * 1)(self.clocks[i].reference)

    def _check(self, clock: InputClock, value: float, fits: bool, what: str = "interval") -> None:
        if not (fits and math.isfinite(value)):
            raise ValueError(f"its clock {clock.name} has the {what} {value:g} s")
