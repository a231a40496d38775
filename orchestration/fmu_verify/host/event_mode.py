"""Step an instance of an FMI 3.0 FMU with event mode, clocks and early returns."""

import ctypes
import math
from collections.abc import Mapping, Sequence
from ctypes import POINTER, c_bool, c_double, c_int, c_size_t, c_uint32
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from fmpy.model_description import ModelVariable

from emla_cosim.base.arrays import Vector
from emla_cosim.base.errors import CosimError
from emla_cosim.fmu.elements import belongs, is_clocked
from emla_cosim.fmu.instance import ERROR, OK
from emla_cosim.master.instances.event_mode_instance import describe_answer
from emla_cosim.master.instances.event_tables import EventTables, FmiAccess
from emla_cosim.stepper.layout import (
    DO_STEP,
    END_REQUEST,
    FUNCTIONS,
    GET_CLOCK,
    SET_CLOCK,
    UPDATE,
    Problem,
)
from emla_cosim.stepper.library import require_stepper

from ..check import NotRunError, quote
from .integration import RunEndedError

if TYPE_CHECKING:
    from .hosted_instance import HostedInstance

NO_EARLY_RETURN = quote("event_mode.no_early_return")
_INTERVAL = quote("event_mode.interval")
_CLAUSES = {
    Problem.WRONG_TIME: quote("event_mode.reached"),
    Problem.NO_EVENT_TIME: quote("event_mode.next_event_time"),
    Problem.WRONG_INTERVAL: _INTERVAL,
    Problem.WRONG_SHIFT: _INTERVAL,
}

_ENDLESS = (Problem.ENDLESS_UPDATES, Problem.ENDLESS_TICKS)

_CLOCKS = POINTER(c_uint32), c_size_t
_ARGUMENTS: dict[str, tuple[Any, ...]] = {
    DO_STEP: (c_double, c_double, c_bool, *3 * (POINTER(c_bool),), POINTER(c_double)),
    UPDATE: (*5 * (POINTER(c_bool),), POINTER(c_double)),
    SET_CLOCK: (*_CLOCKS, POINTER(c_bool)),
    GET_CLOCK: (*_CLOCKS, POINTER(c_bool)),
    "getIntervalDecimal": (*_CLOCKS, POINTER(c_double), POINTER(c_int)),
    "getShiftDecimal": (*_CLOCKS, POINTER(c_double)),
}
"""The types of the arguments after the instance, of functions that have any."""


class EventState(NamedTuple):
    """What is known of an instance beside its state: events, values that wait, clocked variables."""

    stepper_memory: Vector
    pending: dict[str, Any]
    sent: dict[str, Any]
    clocked_inputs: dict[str, Any]
    clocked_values: dict[str, Any]


class HostedEvents:
    """Steps an instance. Discrete inputs wait for event mode, clocked variables for their clocks.

    The stepper in C handles the events, as in runs. It calls the FMU through functions in Python, which note
    and count the calls, and judge what the FMU says.

    Attributes:
        is_stepping: Whether the instance is in step mode.
        steps: Number of steps.
        events: How often a step asked for event mode.
        returns: Number of early returns.
        first_early_return: Time in s of the first early return.
    """

    def __init__(self, instance: "HostedInstance", has_mode: bool, allows_early_return: bool) -> None:
        """Prepare to step. This calls no function of the FMU.

        Args:
            instance: The instance.
            has_mode: Whether it uses event mode.
            allows_early_return: Whether its steps may return early.

        Raises:
            NotRunError: The stepper cannot be built on this machine.
        """
        try:
            self._stepper = require_stepper()
        except CosimError as error:
            raise NotRunError(f"Its events cannot be handled: {error}") from error
        subject = instance.subject
        self._instance, self._has_mode, self._may_return_early = instance, has_mode, allows_early_return
        self._input_clocks = subject.input_clocks if has_mode else []
        self._clocked = [v for v in subject.variables.values() if has_mode and is_clocked(v)]
        prototypes = {n: ctypes.CFUNCTYPE(c_int, ctypes.c_void_p, *_ARGUMENTS.get(n, ())) for n in FUNCTIONS}
        self._functions = {name: make(partial(self._call, name)) for name, make in prototypes.items()}
        addresses = {n: ctypes.cast(f, ctypes.c_void_p).value or 0 for n, f in self._functions.items()}
        access = FmiAccess(self._functions, addresses, dict.fromkeys(FUNCTIONS, 0), {})
        self._clocks = {str(v.name): v for v in subject.clocks} if has_mode else {}
        self._tables = EventTables(self._clocks, [], self._input_clocks, has_mode, access)
        self._tables.record.may_return_early = True  # `_judge_step` refuses it
        self._tables.record.varies_step = subject.has_capability("canHandleVariableCommunicationStepSize")
        self.steps = self.events = self.returns = 0
        self.first_early_return: float | None = None
        self.reset()

    def reset(self) -> None:
        """Forget the run."""
        self.is_stepping = False
        self._tables.restart(math.nan)
        self._error: Exception | None = None
        self._ticking: set[int] = set()
        self._pending: dict[str, Any] = {}
        self._sent: dict[str, Any] = {}
        self._clocked_inputs: dict[str, Any] = {}
        self._clocked_values: dict[str, Any] = {}

    def start_clocks(self, start: float) -> None:
        """Find the first ticks, and read clocked variables, in initialization mode; `start` is in s."""
        self._run_stepper(self._stepper.start_events, start)
        self._read_clocked_values(self._clocked)

    def begin(self) -> None:
        """Handle the events of the initialization, and enter step mode."""
        if self._has_mode:
            self._run_stepper(self._stepper.leave_events)
        self.is_stepping = True

    def step(self, time: float, length: float) -> None:
        """Step from `time` by `length`, both in s.

        Raises:
            CallError: A call failed.
            NotRunError: A clock ticks within a step of an FMU that cannot vary its steps.
            RunEndedError: The FMU asked to end the run.
        """
        self.steps += 1
        if self._pending and math.isnan(self._tables.memory[END_REQUEST]):
            self._run_stepper(self._stepper.enter_events)
            self._instance.set_now(self._pending)
            self._sent.update(self._pending)
            self._pending.clear()
            self._run_stepper(self._stepper.leave_events)
        self._run_stepper(self._stepper.step_events, time, length, 0)

    @property
    def ticks(self) -> dict[str, int]:
        """The number of ticks of each input clock, by name."""
        positions = self._tables.find_positions([self._clocks[clock.name] for clock in self._input_clocks])
        counts = self._tables.memory[positions].astype(int).tolist()
        return dict(zip((clock.name for clock in self._input_clocks), counts, strict=True))

    def list_idle_clocks(self) -> list[str]:
        """Return the names of the input clocks that did not tick."""
        return [name for name, count in self.ticks.items() if not count]

    def store_waiting(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return the values to set in step mode; the others wait for event mode or for their clocks."""
        now = {}
        for name, value in values.items():
            variable = self._instance.subject.variables[name]
            if is_clocked(variable) and self._has_mode:
                self._clocked_inputs[name] = value
            elif self._has_mode and _is_discrete_input(variable):
                self._pending.pop(name, None)
                if name not in self._sent or self._sent[name] != value:
                    self._pending[name] = value
            else:
                now[name] = value
        return now

    def get(self, variables: Sequence[ModelVariable]) -> list[Any]:
        """Return values in step mode; those of clocked variables are of their last tick."""
        current_values = iter(
            self._instance.read([v for v in variables if v.name not in self._clocked_values])
        )
        return [
            self._clocked_values[v.name] if v.name in self._clocked_values else next(current_values)
            for v in variables
        ]

    def save(self) -> EventState:
        """Return a copy of what is known of the instance."""
        bookkeeping = (self._pending, self._sent, self._clocked_inputs, self._clocked_values)
        return EventState(self._tables.memory.copy(), *(dict(values) for values in bookkeeping))

    def restore(self, state: EventState) -> None:
        """Continue with what was known earlier."""
        self._tables.memory[:] = state.stepper_memory
        copies = (dict(v) for v in (state.pending, state.sent, state.clocked_inputs, state.clocked_values))
        self._pending, self._sent, self._clocked_inputs, self._clocked_values = copies

    def _run_stepper(self, function: Any, *arguments: Any) -> None:
        """Call a function of the stepper, and raise the error for what went wrong."""
        problem = Problem(function(None, self._tables.address, *arguments))
        error, self._error = self._error, None
        if error is not None:
            raise error
        record = self._tables.record
        if problem == Problem.END:
            raise RunEndedError
        if problem == Problem.TICK_WITHIN_STEP:
            raise NotRunError(
                f"A Clock ticks at t = {record.value:.9g} s, within a step, and the FMU cannot vary its step "
                "size: its default experiment needs a step size that divides the interval of the Clock."
            )
        if problem == Problem.TICK_ALONE:
            raise NotRunError(
                f"The Clock {self._tables.name_clock(record.clock)} ticks at t = {record.time:.9g} s without "
                f"{self._tables.describe_needed(record.clock)}, on which it depends."
            )
        if problem != Problem.NONE:
            call, answer = describe_answer(problem, record, self._tables)
            message = f"{_make_c_name(call)} answered {answer}."
            raise self._instance.violation(message, _CLAUSES.get(problem), problem in _ENDLESS)

    def _call(self, name: str, _: Any, *arguments: Any) -> int:
        """Call a function of the FMU for the stepper; an exception waits until the stepper returns."""
        try:
            if name == UPDATE:
                self._read_clocked_values([v for v in self._clocked if belongs(v, self._ticking)])
                self._ticking.clear()
            fmu = self._instance.fmu
            call = f"fmi3DoStep at t = {arguments[0]:.9g} s" if name == DO_STEP else None
            with self._instance.calling(call):
                getattr(fmu, _make_c_name(name))(fmu.component, *arguments)
            if name == DO_STEP:
                self._judge_step(*arguments)
            elif name in (SET_CLOCK, GET_CLOCK):
                references, count, active = arguments
                ticking = [references[k] for k in range(count) if active[k]]
                self._ticking.update(ticking)
                if name == SET_CLOCK:  # they start to tick: set the inputs that belong to them
                    variables, values = self._instance.subject.variables, self._clocked_inputs
                    changed = {n: v for n, v in values.items() if belongs(variables[n], ticking)}
                    self._instance.set_now(changed)
        except Exception as error:
            self._error = error
            return ERROR
        return OK

    def _judge_step(
        self, time: float, length: float, _: bool, event: Any, ends: Any, returns_early: Any, reached: Any
    ) -> None:
        """Count events and early returns. Raise CallError for an early return that is not allowed.

        Without event mode, the event is cleared, so that the stepper continues.
        """
        if ends[0]:
            return
        self.events += bool(event[0])
        event[0] = event[0] and self._has_mode
        if returns_early[0]:
            self.returns += 1
            if self.first_early_return is None:
                self.first_early_return = reached[0]
            if not self._may_return_early:
                message = (
                    f"fmi3DoStep from t = {time:.9g} s to {time + length:.9g} s returned early at "
                    f"t = {reached[0]:.9g} s, which was not allowed."
                )
                raise self._instance.violation(message, NO_EARLY_RETURN)

    def _read_clocked_values(self, variables: Sequence[ModelVariable]) -> None:
        """Read variables, whose values `get` returns until their next tick."""
        self._clocked_values.update(
            zip((v.name for v in variables), self._instance.read(variables), strict=True)
        )


def _make_c_name(call: str) -> str:
    return f"fmi3{call[0].upper()}{call[1:]}"


def _is_discrete_input(variable: ModelVariable) -> bool:
    return variable.causality == "input" and (variable.variability == "discrete" or variable.type != "Real")
