"""Instances of FMI 3.0 FMUs with event mode, clocks or early return: their events are handled in C."""

import ctypes
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from fmpy.model_description import ModelVariable

from ...base.arrays import Vector
from ...base.errors import RunError
from ...fmu.elements import CLOCK, is_clocked, is_version_3, read_input_clocks
from ...fmu.file import FmuFile
from ...fmu.instance import ERROR, OK
from ...fmu.interface import CO_SIMULATION
from ...stepper.layout import (
    DO_STEP,
    EVENT_CALLS,
    GET_CLOCK,
    MOST_UPDATES,
    SET_CLOCK,
    UPDATE,
    Events,
    Problem,
)
from ...stepper.library import require_stepper
from .event_tables import EventTables, FmiAccess
from .fmu_instance import CallNames, EndRequestedError, EntryPoints, InstanceError
from .in_process_instance import GETTING, RECORDING, SETTING, InProcessInstance
from .typed_values import TypedValues, TypeGroup

_TIMED = DO_STEP, UPDATE, SET_CLOCK, GET_CLOCK
"""Calls that a message names together with their time."""

_REFUSED = {Problem.EARLY_RETURN: "an early return", Problem.EVENT: "a request for event mode"}


def take_problem_error(instance: InProcessInstance, tables: EventTables) -> RunError:
    """Clear the problem of an instance in its last event or step, and return the error for it."""
    record = tables.record
    problem, name = Problem(record.problem), instance.name
    record.problem = Problem.NONE
    if problem == Problem.CALL:
        call = EVENT_CALLS[record.call]
        return instance.error(_add_time(call, record.time) if call in _TIMED else call, record.status)
    if problem == Problem.END:
        call = _add_time(EVENT_CALLS[record.call], record.value)
        return EndRequestedError(name, call, "terminateSimulation", instance.messages())
    if problem == Problem.TICK_WITHIN_STEP:
        return RunError(
            f"a clock of {name} ticks at t = {record.value:.9g} s, within a step, and the FMU cannot vary "
            "its step size. Use a step size that divides the interval of the clock."
        )
    if problem == Problem.TICK_ALONE:
        return RunError(
            f"the clock {tables.name_clock(record.clock)} of {name} ticks at t = {record.time:.9g} s "
            f"without {tables.describe_needed(record.clock)}, on which it depends."
        )
    if problem == Problem.TOO_MANY_TICKS:
        return RunError(
            f"the clock {tables.name_clock(record.clock)} of {name} has to tick {record.count} times in "
            f"the step to t = {record.value:.9g} s; fewer than {MOST_UPDATES} are supported. Use a "
            "smaller step size."
        )
    call, answer = describe_answer(problem, record, tables)
    return InstanceError(name, call, answer, instance.messages())


def describe_answer(problem: Problem, record: Events, tables: EventTables) -> tuple[str, str]:
    """Return the call that gave a wrong answer, with its time, and the answer in words."""
    step, update = _add_time(DO_STEP, record.time), _add_time(UPDATE, record.time)
    if problem in _REFUSED:
        return step, f"{_REFUSED[problem]}, which is not allowed here"
    if problem == Problem.WRONG_TIME:
        return step, f"lastSuccessfulTime = {record.value:.9g}"
    if problem == Problem.ENDLESS_RETURNS:
        return step, f"a request for more, {record.count} times in a row"
    if problem == Problem.ENDLESS_UPDATES:
        return update, f"a request for more, {record.count} times in a row"
    if problem == Problem.NO_EVENT_TIME:
        return update, "nextEventTime = NaN"
    clock = tables.name_clock(record.clock)
    if problem == Problem.ENDLESS_TICKS:
        return _add_time(GET_CLOCK, record.time), f"a tick of {clock} after each of {record.count} updates"
    quantity = "interval" if problem == Problem.WRONG_INTERVAL else "shift"
    return "getIntervalDecimal", f"the {quantity} {record.value:g} s of its clock {clock}"


def _add_time(call: str, time: float) -> str:
    return f"{call} at t = {time:.9g} s"


class SavedState(ctypes.c_void_p):
    """A saved state of the FMU, with a copy of the state of the instance's events."""

    event_state: Vector


def handles_events(file: FmuFile) -> bool:
    """Return whether an FMU runs as an `EventModeInstance`."""
    # Model Exchange has its own events, and FMI 2.0 has none in co-simulation
    if file.kind != CO_SIMULATION or not is_version_3(file.description):
        return False
    return file.has_capability("hasEventMode") or _can_return_early(file)


def _can_return_early(file: FmuFile) -> bool:
    """Return whether a step may end early: the rest of it is a step of another size."""
    return file.has_capability("mightReturnEarlyFromDoStep") and file.has_capability(
        "canHandleVariableCommunicationStepSize"
    )


class EventModeInstance(InProcessInstance):
    """One instance of an FMU that uses event mode if the FMU has it, and lets its steps end early.

    `events.h` of the stepper handles the events. This class has the tables of the instance, its
    initialization, and the values that a user sets and reads.

    Attributes:
        tables: Its tables for the stepper.
    """

    tables: EventTables

    @cached_property
    def _uses_event_mode(self) -> bool:
        return self.file.has_capability("hasEventMode")

    @property
    def instantiation(self) -> Mapping[str, bool]:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Return the arguments of `fmi3InstantiateCoSimulation` by name."""
        return {"eventModeUsed": self._uses_event_mode, "earlyReturnAllowed": _can_return_early(self.file)}

    def _prepare_events(self) -> None:
        file, has_event_mode = self.file, self._uses_event_mode
        clocks = read_input_clocks(file.folder, file.path) if has_event_mode else []
        access = FmiAccess(self._functions, self._library.addresses, self._codes, self.arrays)
        self.tables = EventTables(file.variables, self.read, clocks, has_event_mode, access)
        self.tables.record.may_return_early = _can_return_early(file)
        self.tables.record.varies_step = self.varies_step
        self._values_by_hand: dict[str, tuple[ModelVariable, Any]] = {}
        self._error_by_hand: RunError | None = None
        self._getter = _Getter(self.tables, self.written, self._functions)

    @property
    def violations(self) -> list[str]:
        """Violations of the standard in this run that were accepted."""
        time = self.tables.record.first_return
        if math.isnan(time):
            return []
        return [
            f"{self.name} returned early from doStep at t = {time:.9g} s, although its model description "
            "does not have mightReturnEarlyFromDoStep; the rest of the step followed as another one"
        ]

    def bind(self, inputs: Vector, outputs: Vector) -> None:
        """Use this memory for inputs and outputs; the instance keeps its addresses."""
        super().bind(inputs, outputs)
        self.tables.bind(self._address, inputs)

    def reset(self) -> None:
        """Return to the state right after instantiation."""
        super().reset()
        self.tables.record.first_return = math.nan

    def enter_initialization(self, start_time: float, stop_time: float | None = None) -> None:
        """Enter initialization mode; times in s, None without a fixed stop time."""
        self.tables.restart(start_time)
        self._values_by_hand.clear()
        self.tables.set_by_hand([])
        super().enter_initialization(start_time, stop_time)

    def exit_initialization(self) -> None:
        """Leave initialization mode, and handle the events at the start."""
        stepper, tables = require_stepper(), self.tables
        self._call_stepper("getIntervalDecimal", stepper.start_events, tables.record.time)
        super().exit_initialization()
        tables.passed[:] = self.inputs[tables.discrete]
        if self._uses_event_mode:
            self._call_stepper("updateDiscreteStates", stepper.leave_events)

    def set_value(self, variable: ModelVariable, value: Any) -> None:
        """Set one variable to a value of its type, after initialization in event mode or at ticks."""
        if not (self._stepping and self._uses_event_mode):
            super().set_value(variable, value)
        elif is_clocked(variable):
            self._values_by_hand[str(variable.name)] = variable, value
            setters = [(v, self._make_setter_by_hand(v, x)) for v, x in self._values_by_hand.values()]
            self.tables.set_by_hand(setters)
        else:
            # FMI 3.0 lets discrete inputs change in event mode only
            self._call_stepper("enterEventMode", require_stepper().enter_events)
            super().set_value(variable, value)
            self._call_stepper("updateDiscreteStates", require_stepper().leave_events)

    def _make_setter_by_hand(self, variable: ModelVariable, value: Any) -> Callable[[], int]:
        """Return a function that sets a clocked variable, for the stepper; it keeps an exception."""

        def set_variable() -> int:
            try:
                super(EventModeInstance, self).set_value(variable, value)
            except RunError as error:
                self._error_by_hand = error
                return ERROR
            return OK

        return set_variable

    def value(self, variable: ModelVariable) -> Any:
        """Return the present value of a variable; that of the last tick if it is clocked.

        The value of a clock is the number of its ticks.
        """
        (position,) = self.tables.find_positions([variable])
        if variable.type == CLOCK:
            return int(self.tables.memory[position])
        if position >= 0 and self._stepping:
            return self.tables.memory[position]
        return super().value(variable)

    def set_inputs(self) -> None:
        """Pass `inputs` to the FMU; after initialization discrete ones wait for the next step."""
        if self._stepping:
            self._set_typed_inputs(self.tables.continuous)
        else:
            super().set_inputs()

    def get_outputs(self) -> None:
        """Read the FMU's outputs into `outputs`; clocked ones are those of the last tick."""
        if self._stepping:
            self._check_status(GETTING, self._getter.get(self._component, self.outputs))
        else:
            super().get_outputs()
            self._getter.copy_ticks(self.outputs)

    def observe(self, names: Sequence[str], values: Vector) -> None:
        """Choose the numeric variables that `get_observed` reads, and where to."""
        super().observe(names, values)
        variables = [self.file.variables[name] for name in names]
        self._observer = _Getter(self.tables, variables, self._functions)

    def get_observed(self) -> None:
        """Read the observed variables; clocked ones are those of the last tick."""
        values = self._observed[1]
        if self._stepping:
            self._check_status(RECORDING, self._observer.get(self._component, values))
        else:
            super().get_observed()
            self._observer.copy_ticks(values)

    def do_step(self, time: float, step: float) -> None:
        """Advance from `time` by `step`, both in s, and handle the events in between and at the end."""
        self._call_stepper(DO_STEP, require_stepper().step_events, time, step, self._no_way_back)

    def save(self, state: Any = None) -> Any:
        """Return a copy of the FMU's state, in the memory of the earlier copy `state`."""
        self._no_way_back = 0
        saved = self._copy_state(SavedState() if state is None else state)
        saved.event_state = self.tables.memory.copy()
        return saved

    def restore(self, state: Any) -> None:
        """Restore a saved state."""
        super().restore(state)
        self.tables.memory[:] = state.event_state

    def serialize(self) -> bytes:
        """Return the state as bytes."""
        return self.tables.memory.tobytes() + super().serialize()

    def deserialize(self, content: bytes) -> None:
        """Restore a state from the bytes of `serialize`."""
        event_state = self.tables.memory
        super().deserialize(content[event_state.nbytes :])
        event_state[:] = np.frombuffer(content[: event_state.nbytes])

    def entry_points(self) -> EntryPoints:
        """Return the addresses of the FMU's functions, and of the tables of its events."""
        points = super().entry_points()
        assert points is not None
        return replace(
            points,
            names=CallNames(SETTING, GETTING, "getFMUState", "setFMUState"),
            setters=self._list_calls(self.tables.continuous.groups),
            getters=self._list_calls(self._getter.groups),
            events=self.tables.address,
        )

    @property
    def _observed_types(self) -> Sequence[TypeGroup]:
        return self._observer.groups

    def error(self, call: str, status: int) -> RunError:
        """Return the error for a call that returned this status, or for a problem in a step."""
        if call.startswith(DO_STEP) and self.tables.record.problem:
            return self._make_problem_error()
        return super().error(call, status)

    @property
    def _setters(self) -> Sequence[TypedValues]:
        return self.tables.setters

    def _call_stepper(self, call: str, function: Callable[..., int], *arguments: Any) -> None:
        """Call a function of the stepper; an exception of Python in it counts as one of this FMI call."""
        try:
            problem = function(ctypes.addressof(self._present), self.tables.address, *arguments)
        except SystemError as error:
            raise self.python_error(call, error) from error
        self.returned()
        if problem:
            raise self._make_problem_error()

    def _make_problem_error(self) -> RunError:
        """Return the error for the problem in the last call of the stepper, and clear the problem."""
        error, self._error_by_hand = self._error_by_hand, None
        return error or take_problem_error(self, self.tables)


class _Getter:
    """Reads variables: clocks and clocked ones from the memory of the events, others from the FMU.

    Args:
        tables: The tables of the events.
        variables: The variables of a vector.
        functions: The FMI functions by their short names.

    Attributes:
        groups: The same calls for the stepper.
    """

    def __init__(
        self, tables: EventTables, variables: Sequence[ModelVariable], functions: Mapping[str, Any]
    ) -> None:
        positions = tables.find_positions(variables)
        in_fmu, self._event_elements = np.flatnonzero(positions < 0), np.flatnonzero(positions >= 0)
        self._state, self._positions = tables.memory, positions
        self._typed = TypedValues("get", [variables[i] for i in in_fmu.tolist()], functions, elements=in_fmu)
        self._clocks = np.array([i for i, v in enumerate(variables) if v.type == CLOCK], dtype=np.intp)
        self.groups = [*self._typed.groups]
        if len(self._event_elements):
            self.groups.append(tables.make_copy_group(positions[self._event_elements], self._event_elements))

    def get(self, component: Any, vector: Vector) -> int:
        """Read all variables and return the worst status."""
        status = self._typed.get(component, vector)
        vector[self._event_elements] = self._state[self._positions[self._event_elements]]
        return status

    def copy_ticks(self, vector: Vector) -> None:
        """Copy the numbers of ticks of the clocks into the vector: they have no value in the FMU."""
        vector[self._clocks] = self._state[self._positions[self._clocks]]
