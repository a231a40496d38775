"""Step an instance of an FMI 3.0 FMU with event mode, clocks and early returns."""

import math
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Any, NamedTuple, Protocol

import numpy as np
from fmpy.model_description import ModelVariable

from emla_cosim.base.arrays import Vector
from emla_cosim.fmu.clocks import belongs, is_clocked
from emla_cosim.fmu.instance import ERROR
from emla_cosim.master.instances.discrete_states import DiscreteUpdate

from ..subject import Subject
from ..verdict import Clause, NotRunError, fmi3
from .clock_schedule import SIZE, ClockSchedule

EARLY = fmi3(
    "4.2.1",
    "earlyReturn = fmi3True is only allowed if earlyReturnAllowed = fmi3True in fmi3InstantiateCoSimulation.",
)
_REACHED = fmi3("4.2.1", "The time reached is specified in lastSuccessfulTime.")
_INTERVAL = fmi3(
    "2.2.8.2", "The next Clock tick at time instant t_i is defined as: t_i := t_(i-1) + T_interval,i"
)
_NEXT_EVENT = fmi3(
    "2.3.5",
    "When nextEventTimeDefined = fmi3True, the next time event is known and nextEventTime has a valid value.",
)

_SAME_TIME = 1e-9
"""Times that differ by less than this part of a step are the same."""

_MOST_UPDATES = 1000
"""The largest number of updates of discrete states at one time, and of returns from `fmi3DoStep`."""

_NEXT, _END, _SCHEDULE = 0, 1, 2
"""Positions in the memory: the next time event in s; the time in s when the FMU asked for the end, or NaN."""


class SteppedInstance(Protocol):
    """What the steps need of an instance."""

    subject: Subject
    fmu: Any

    def calling(self) -> AbstractContextManager[None]:
        """Convert errors of fmpy to the error of the call."""
        ...

    def error(self, call: str, status: int) -> Exception:
        """Return the error for a call with this status."""
        ...

    def violation(self, sentence: str, clause: Clause) -> Exception:
        """Return the error for what a function said against a clause of the standard."""
        ...

    def set_now(self, values: Mapping[str, Any]) -> None:
        """Set variables by name."""
        ...

    def read(self, variables: Sequence[ModelVariable]) -> list[Any]:
        """Return the values that the FMU has now."""
        ...


class RunEndedError(Exception):
    """The FMU asked to end the run."""


class EventState(NamedTuple):
    """What is known of an instance beside its state: times, values that wait, values of clocked variables."""

    memory: Vector
    time: float
    pending: dict[str, Any]
    passed: dict[str, Any]
    clocked: dict[str, Any]
    values: dict[str, Any]


class HostedEvents:
    """Steps an instance. Discrete inputs wait for event mode, clocked variables for their clocks.

    A step ends at the time that was asked for: after an event before it, the rest follows as another step of
    the FMU. This is independent of the steps of a run, which are done in C.

    Attributes:
        is_stepping: Whether the instance is in step mode.
        steps: Number of steps.
        events: How often a step asked for event mode.
        returns: Number of early returns.
        early: Time in s of the first early return.
        ticks: Number of ticks of each input clock, by value reference.
    """

    def __init__(self, instance: SteppedInstance, has_mode: bool, early: bool) -> None:
        """Prepare to step. This calls no function of the FMU.

        Args:
            instance: The instance.
            has_mode: Whether it uses event mode.
            early: Whether its steps may return early.
        """
        subject = instance.subject
        self.fmu: Any = instance.fmu
        self._varies_step = subject.has_capability("canHandleVariableCommunicationStepSize")
        self._instance, self._has_mode, self._may_return = instance, has_mode, early
        clocks = subject.input_clocks if has_mode else []
        self._memory = np.empty(_SCHEDULE + SIZE * len(clocks))
        self._schedule = ClockSchedule(clocks, self._memory[_SCHEDULE:])
        self._clocked = [v for v in subject.variables.values() if has_mode and is_clocked(v)]
        self._output_clocks = subject.output_clocks if has_mode else []
        self.steps = self.events = self.returns = 0
        self.early: float | None = None
        self.ticks = {clock.reference: 0 for clock in clocks}
        self.reset()

    def reset(self) -> None:
        """Forget the run."""
        self.is_stepping = False
        self._memory[:] = math.nan
        self._memory[_NEXT] = math.inf
        self._time = math.nan
        self._pending: dict[str, Any] = {}
        self._passed: dict[str, Any] = {}
        self._inputs: dict[str, Any] = {}
        self._values: dict[str, Any] = {}

    def start_clocks(self, start: float) -> None:
        """Find the first ticks, and read clocked variables, in initialization mode; `start` is in s."""
        self._time = start
        with self._instance.calling():
            self._check(self._schedule.start, self.fmu, start)
        self._keep(self._clocked)

    def begin(self) -> None:
        """Handle the events of the initialization, and enter step mode."""
        if self._has_mode:
            self._update_discrete_states(0.0)
            self._leave_event_mode()
        self.is_stepping = True

    def step(self, time: float, length: float) -> None:
        """Step from `time` by `length`, both in s.

        Raises:
            CallError: A call failed.
            NotRunError: A clock ticks within a step of an FMU that cannot vary its steps.
            RunEndedError: The FMU asked to end the run.
        """
        self.steps += 1
        self._time, end = time, time + length
        near = max(_SAME_TIME * length, 4.0 * math.ulp(end))
        self._check_end()
        if self._pending:
            self._handle_event(near)
        standing = 0
        while True:
            reached, has_event = self._advance(self._next_stop(end, near) - self._time)
            standing = standing + 1 if reached <= self._time + near else 0
            if standing > _MOST_UPDATES:
                raise self._stuck("fmi3DoStep", standing)
            self._time = end if reached >= end - near else reached
            if has_event or self._time >= self._next_event() - near:
                self._handle_event(near)
            if self._time == end:
                return
            self._check_end()

    def list_idle_clocks(self) -> list[str]:
        """Return the names of the input clocks that did not tick."""
        return [clock.name for clock in self._schedule.clocks if not self.ticks[clock.reference]]

    def take(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the values to set in step mode; the others wait for event mode or for their clocks."""
        now = {}
        for name, value in values.items():
            variable = self._instance.subject.variables[name]
            if is_clocked(variable) and self._has_mode:
                self._inputs[name] = value
            elif self._has_mode and _is_discrete_input(variable):
                self._pending.pop(name, None)
                if name not in self._passed or self._passed[name] != value:
                    self._pending[name] = value
            else:
                now[name] = value
        return now

    def get(self, variables: Sequence[ModelVariable]) -> list[Any]:
        """Return values in step mode; those of clocked variables are of their last tick."""
        others = iter(self._instance.read([v for v in variables if v.name not in self._values]))
        return [self._values[v.name] if v.name in self._values else next(others) for v in variables]

    def save(self) -> EventState:
        """Return a copy of what is known of the instance."""
        known = (self._pending, self._passed, self._inputs, self._values)
        return EventState(self._memory.copy(), self._time, *(dict(values) for values in known))

    def restore(self, state: EventState) -> None:
        """Continue with what was known earlier."""
        self._memory[:], self._time = state.memory, state.time
        copies = (dict(v) for v in (state.pending, state.passed, state.clocked, state.values))
        self._pending, self._passed, self._inputs, self._values = copies

    def _advance(self, step: float) -> tuple[float, bool]:
        time = self._time
        with self._instance.calling():
            event, ends, early, reached = self.fmu.doStep(time, step, noSetFMUStatePriorToCurrentPoint=False)
        if ends:
            raise RunEndedError
        self.events += bool(event)
        if not early:
            return time + step, bool(event) and self._has_mode
        self.returns, self.early = self.returns + 1, reached if self.early is None else self.early
        at, close = f"fmi3DoStep from t = {time:.9g} s to {time + step:.9g} s", 1e-9 * step
        if not self._may_return:
            said = f"{at} returned early at t = {reached:.9g} s, which was not allowed."
            raise self._instance.violation(said, EARLY)
        if not time - close <= reached <= time + step + close:
            raise self._instance.violation(f"{at} returned early at t = {reached:.9g} s.", _REACHED)
        return reached, bool(event) and self._has_mode

    def _check_end(self) -> None:
        """Raise RunEndedError if the FMU has asked for the end."""
        if not math.isnan(self._memory[_END]):
            raise RunEndedError

    def _next_stop(self, end: float, near: float) -> float:
        """Return the time to which the next step of the FMU goes."""
        tick, following = self._schedule.next(), self._next_event()
        if tick < end - near and not self._varies_step:
            raise NotRunError(
                f"A Clock ticks at t = {tick:.9g} s, within a step, and the FMU cannot vary its step size: "
                "its default experiment needs a step size that divides the interval of the Clock."
            )
        return following if self._varies_step and self._time + near < following < end - near else end

    def _next_event(self) -> float:
        """Return the time of the next time event or tick, in s."""
        return min(float(self._memory[_NEXT]), self._schedule.next())

    def _handle_event(self, near: float) -> None:
        """Pass the discrete inputs, tick clocks up to `near` s after now, and compute the discrete states."""
        if self._has_mode:
            with self._instance.calling():
                self.fmu.enterEventMode()
        self._pass_discrete_inputs()
        self._update_discrete_states(near)
        self._leave_event_mode()

    def _update_discrete_states(self, near: float) -> None:
        """Tick clocks, and update the discrete states until the FMU needs no more of it."""
        found = list[int]()
        for _ in range(_MOST_UPDATES):
            due = [*self._schedule.due(self._time + near)]
            self._tick([self._schedule.clocks[i].reference for i in due], found)
            update = self._update()
            self._memory[_NEXT] = update.next_event
            if update.ends:
                self._memory[_END] = self._time
            with self._instance.calling():
                self._check(self._schedule.advance, self.fmu, due, self._time)
            if update.needs_more or len(self._schedule.due(self._time + near)):
                found = []
            elif not (found := self._find_output_ticks()):  # an FMU may set them as late as in the update
                return
        raise self._stuck("fmi3GetClock" if found else "fmi3UpdateDiscreteStates", _MOST_UPDATES)

    def _leave_event_mode(self) -> None:
        with self._instance.calling():
            self.fmu.enterStepMode()

    def _pass_discrete_inputs(self) -> None:
        self._instance.set_now(self._pending)
        self._passed.update(self._pending)
        self._pending.clear()

    def _tick(self, clocks: Sequence[int], found: Sequence[int]) -> None:
        if clocks:
            with self._instance.calling():
                self.fmu.setClock(clocks, [True] * len(clocks))
        variables = self._instance.subject.variables
        self._instance.set_now({n: v for n, v in self._inputs.items() if belongs(variables[n], clocks)})
        ticking = {*clocks, *found, *self._find_output_ticks()}
        self._keep([v for v in self._clocked if belongs(v, [*ticking])])
        for clock in clocks:
            self.ticks[clock] += 1

    def _find_output_ticks(self) -> list[int]:
        if not self._output_clocks:
            return []
        with self._instance.calling():
            active = self.fmu.getClock(self._output_clocks)
        return [clock for clock, ticks in zip(self._output_clocks, active, strict=True) if ticks]

    def _keep(self, variables: Sequence[ModelVariable]) -> None:
        self._values.update(zip((v.name for v in variables), self._instance.read(variables), strict=True))

    def _update(self) -> DiscreteUpdate:
        with self._instance.calling():
            more, ends, nominals, _, has_next, following = self.fmu.updateDiscreteStates()
        if has_next and math.isnan(following):
            said = f"fmi3UpdateDiscreteStates at t = {self._time:.9g} s says that the next event is at NaN."
            raise self._instance.violation(said, _NEXT_EVENT)
        return DiscreteUpdate(bool(more), bool(ends), bool(nominals), following if has_next else math.inf)

    def _check(self, find: Any, *arguments: Any) -> None:
        """Find ticks; raise CallError for an interval that is not valid."""
        try:
            find(*arguments)
        except ValueError as error:
            said = f"At t = {self._time:.9g} s, {error}."
            raise self._instance.violation(said, _INTERVAL) from error

    def _stuck(self, function: str, times: int) -> Exception:
        name = f"{function} at t = {self._time:.9g} s, called {times} times in a row,"
        return self._instance.error(name, ERROR)


def _is_discrete_input(variable: ModelVariable) -> bool:
    return variable.causality == "input" and (variable.variability == "discrete" or variable.type != "Real")
