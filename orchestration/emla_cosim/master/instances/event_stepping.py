"""Step an FMI 3.0 FMU with event mode, clocks and early returns; subclasses call the FMU."""

import math
from abc import ABC, abstractmethod
from collections.abc import Collection, Sequence
from typing import Any, NamedTuple

from ...base.arrays import Vector
from .clock_schedule import ClockSchedule

SAME_TIME = 1e-9
"""Times that differ by less than this part of a step are the same."""

MOST_UPDATES = 1000
"""The largest number of updates of discrete states at one time, of returns from `fmi3DoStep`, and of ticks
of a triggered clock in a step."""

NEXT, END = 0, 1
"""Positions in the memory: the next time event in s; the time in s when the FMU asked for the end, or NaN."""


class DiscreteUpdate(NamedTuple):
    """What an FMU says about one update of its discrete states.

    Attributes:
        needs_more: whether it needs another update.
        ends: whether it wants the run to end.
        has_new_nominals: whether the nominal values of its states have changed.
        next_event: time of its next time event in s; infinite without one.
    """

    needs_more: bool
    ends: bool
    has_new_nominals: bool
    next_event: float


class EventStepping(ABC):
    """An FMU with event mode, clocks or early returns, which is stepped to any time.

    A step ends at the time that was asked for: after an event before it, the rest follows as another step of
    the FMU. Discrete inputs change in event mode, at the start of a step. Clocks tick at their times, at the
    end of a step; clocked inputs change then. Triggered input clocks tick at the end of a step.
    """

    fmu: Any
    varies_step: bool
    _memory: Vector
    _schedule: ClockSchedule
    _time: float

    def _step_with_events(self, time: float, step: float, has_new_inputs: bool) -> None:
        """Advance from `time` by `step`, both in s, and handle the events in between and at the end.

        Args:
            time: The present time.
            step: The step.
            has_new_inputs: Whether discrete inputs wait for event mode.
        """
        self._time = time
        memory, end = self._memory, time + step
        if not math.isnan(memory[END]):
            raise self._end("updateDiscreteStates", memory[END])
        near = max(SAME_TIME * step, 4.0 * math.ulp(end))
        if has_new_inputs:
            self._handle_event(near)
        standing = 0
        while True:
            reached, has_event = self._advance(self._next_stop(end, near) - self._time)
            standing = standing + 1 if reached <= self._time + near else 0
            if standing > MOST_UPDATES:
                raise self._stuck("doStep returned early", standing)
            self._time = end if reached >= end - near else reached
            triggers = self._time == end and bool(self._list_triggered())
            if has_event or triggers or self._time >= self._next_event() - near:
                self._handle_event(near, triggers)
            if self._time == end:
                return
            if not math.isnan(memory[END]):
                raise self._end("updateDiscreteStates", memory[END])

    def _next_stop(self, end: float, near: float) -> float:
        """Return the time to which the next step of the FMU goes."""
        tick, following = self._schedule.next(), self._next_event()
        if tick < end - near and not self.varies_step:
            raise self._missed(tick)
        return following if self.varies_step and self._time + near < following < end - near else end

    def _next_event(self) -> float:
        """Return the time of the next time event or tick, in s."""
        return min(float(self._memory[NEXT]), self._schedule.next())

    def _handle_event(self, near: float, triggers: bool = False) -> None:
        """Pass the discrete inputs, tick clocks up to `near` s after now, and compute the discrete states.

        With `triggers`, triggered clocks tick, too.
        """
        self._enter_event_mode()
        self._pass_discrete_inputs()
        self._update_discrete_states(near, triggers)
        self._leave_event_mode()

    def _update_discrete_states(self, near: float, triggers: bool = False) -> None:
        """Tick clocks, and update the discrete states until the FMU needs no more of it."""
        found = list[int]()
        for _ in range(MOST_UPDATES):
            due = [*self._schedule.due(self._time + near)]
            timed = [self._schedule.clocks[i].reference for i in due]
            self._tick([*timed, *(self._list_triggered() if triggers else ())], found)
            update = self._update()
            self._memory[NEXT] = update.next_event
            if update.ends:
                self._memory[END] = self._time
            self._find_ticks(due)
            waits = triggers and bool(self._list_triggered())
            if update.needs_more or waits or len(self._schedule.due(self._time + near)):
                found = []
            elif not (found := self._find_output_ticks()):  # an FMU may set them as late as in the update
                return
        if found:
            raise self._ticks_forever(found[0])
        raise self._stuck("updateDiscreteStates needed another update", MOST_UPDATES)

    def _list_triggered(self) -> Collection[int]:
        """Return the triggered input clocks that have to tick, by value reference."""
        return ()

    def _ticks_forever(self, clock: int) -> Exception:
        """Return the error for an output clock that still ticks after the last update."""
        return self._stuck(f"getClock reported a tick of clock {clock}", MOST_UPDATES)

    @abstractmethod
    def _advance(self, step: float) -> tuple[float, bool]:
        """Do one step of the FMU; return the time that it has reached, and whether it needs event mode."""

    @abstractmethod
    def _enter_event_mode(self) -> None:
        """Enter event mode."""

    @abstractmethod
    def _leave_event_mode(self) -> None:
        """Enter step mode."""

    @abstractmethod
    def _pass_discrete_inputs(self) -> None:
        """Set the discrete inputs, in event mode."""

    @abstractmethod
    def _tick(self, clocks: Sequence[int], found: Sequence[int]) -> None:
        """Tick input clocks, if there are any: set their inputs, and read the variables of all that tick.

        Args:
            clocks: Value references of the input clocks.
            found: Those of output clocks that are known to tick.
        """

    @abstractmethod
    def _find_output_ticks(self) -> list[int]:
        """Return the output and local clocks that tick, by value reference."""

    @abstractmethod
    def _update(self) -> DiscreteUpdate:
        """Update the discrete states once."""

    @abstractmethod
    def _find_ticks(self, ticked: Sequence[int]) -> None:
        """Find the next ticks after those of some clocks, by their position in the schedule."""

    @abstractmethod
    def _missed(self, tick: float) -> Exception:
        """Return the error for a tick within a step of an FMU that cannot vary its steps."""

    @abstractmethod
    def _end(self, call: str, time: float) -> Exception:
        """Return the error for an FMU that asked for the end, in a call at a time in s."""

    @abstractmethod
    def _stuck(self, what: str, times: int) -> Exception:
        """Return the error for an FMU that asks for more again and again, beginning with the call."""
