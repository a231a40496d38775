"""Step an instance of an FMI 3.0 FMU with event mode, clocks and early returns."""

import math
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from typing import Any, NamedTuple, Protocol

import numpy as np
from fmpy.model_description import ModelVariable

from ...base.arrays import Vector
from ...fmu.instance import ERROR
from ...master.instances.clock_schedule import SIZE, ClockSchedule
from ...master.instances.clocked_variables import belongs, is_clocked
from ...master.instances.event_stepping import NEXT, DiscreteUpdate, EventStepping
from ..subject import Subject
from ..verdict import Clause, NotRunError, fmi3

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


class HostedEvents(EventStepping):
    """Steps an instance. Discrete inputs wait for event mode, clocked variables for their clocks.

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
        self.varies_step = subject.has_capability("canHandleVariableCommunicationStepSize")
        self._instance, self._has_mode, self._may_return = instance, has_mode, early
        clocks = subject.input_clocks if has_mode else []
        self._memory = np.empty(2 + SIZE * len(clocks))
        self._schedule = ClockSchedule(clocks, self._memory[2:])
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
        self._memory[NEXT] = math.inf
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
        self._step_with_events(time, length, bool(self._pending))

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

    def _enter_event_mode(self) -> None:
        if self._has_mode:
            with self._instance.calling():
                self.fmu.enterEventMode()

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

    def _find_ticks(self, ticked: Sequence[int]) -> None:
        with self._instance.calling():
            self._check(self._schedule.advance, self.fmu, ticked, self._time)

    def _check(self, find: Any, *arguments: Any) -> None:
        """Find ticks; raise CallError for an interval that is not valid."""
        try:
            find(*arguments)
        except ValueError as error:
            said = f"At t = {self._time:.9g} s, {error}."
            raise self._instance.violation(said, _INTERVAL) from error

    def _missed(self, tick: float) -> Exception:
        return NotRunError(
            f"A Clock ticks at t = {tick:.9g} s, within a step, and the FMU cannot vary its step size: its "
            "default experiment needs a step size that divides the interval of the Clock."
        )

    def _end(self, call: str, time: float) -> Exception:
        return RunEndedError(call, time)

    def _stuck(self, what: str, times: int) -> Exception:
        call = what.split()[0]
        name = f"fmi3{call[0].upper()}{call[1:]} at t = {self._time:.9g} s, called {times} times in a row,"
        return self._instance.error(name, ERROR)


def _is_discrete_input(variable: ModelVariable) -> bool:
    return variable.causality == "input" and (variable.variability == "discrete" or variable.type != "Real")
