"""Instances of FMI 3.0 FMUs with event mode or early return: their events are handled within a step."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from fmpy.model_description import ModelVariable

from ...base.arrays import Vector
from ...fmu.elements import is_version_3
from ...fmu.file import FmuFile
from ...fmu.interface import CO_SIMULATION
from ...fmu.log import FmuLog
from .fmu_instance import EndRequestedError, EntryPoints, InstanceError, ObservedGroup
from .in_process_instance import InProcessInstance
from .typed_values import TypedValues, ValueRangeError

SAME_TIME = 1e-9
"""Times that differ by less than this part of a step are the same."""

MOST_UPDATES = 1000
"""The largest number of updates of discrete states at one time, and of returns from `fmi3DoStep`."""

_NEXT, _END, _PASSED = 0, 1, 2
"""Positions in the memory of an instance: next time event in s, time at which the FMU asked for the end
(NaN if it did not), and the discrete inputs that the FMU has."""


class SavedState(NamedTuple):
    """A saved state of the FMU, and what the instance knew of its events."""

    state: Any
    memory: Vector


def handles_events(file: FmuFile) -> bool:
    """Return whether an FMU runs as an `EventModeInstance`."""
    if file.kind != CO_SIMULATION or not is_version_3(file.description):
        return False
    return file.has_capability("hasEventMode") or _returns_early(file)


def _returns_early(file: FmuFile) -> bool:
    """Return whether a step may end early: the rest of it is a step of another size."""
    return file.has_capability("mightReturnEarlyFromDoStep") and file.has_capability(
        "canHandleVariableCommunicationStepSize"
    )


class EventModeInstance(InProcessInstance):
    """One instance of an FMU that uses event mode if the FMU has it, and lets its steps end early.

    A step ends at the time that was asked for: after an event before it, the rest follows as another
    step of the FMU. Discrete inputs change in event mode, at the start of a step.
    """

    def __init__(
        self,
        name: str,
        file: FmuFile,
        inputs: Sequence[str],
        outputs: Sequence[str],
        log: FmuLog,
        number: int = 0,
    ) -> None:
        """Instantiate the FMU; see `InProcessInstance`."""
        self._uses_event_mode = file.has_capability("hasEventMode")
        self.instantiation = {
            "eventModeUsed": self._uses_event_mode,
            "earlyReturnAllowed": _returns_early(file),
        }
        super().__init__(name, file, inputs, outputs, log, number)
        is_discrete = ~self.continuous_inputs & self._uses_event_mode
        self._continuous, self._discrete = np.flatnonzero(~is_discrete), np.flatnonzero(is_discrete)
        self._set_continuous, self._set_discrete = (
            TypedValues("set", [self.read[i] for i in places], self._functions, self._arrays)
            for places in (self._continuous, self._discrete)
        )
        self._memory = np.full(_PASSED + len(self._discrete), math.nan)
        self._time = math.nan

    def enter_initialization(self, start_time: float, stop_time: float | None = None) -> None:
        """Enter initialization mode; times in s, None without a fixed stop time."""
        self._time = start_time
        self._memory[:] = math.nan
        self._memory[_NEXT] = math.inf
        super().enter_initialization(start_time, stop_time)

    def exit_initialization(self) -> None:
        """Leave initialization mode, and handle the events at the start."""
        super().exit_initialization()
        self._memory[_PASSED:] = self.inputs[self._discrete]
        if self._uses_event_mode:
            self._update_discrete_states()
            self._leave_event_mode()

    def set_value(self, variable: ModelVariable, value: Any) -> None:
        """Set one variable to a value of its type, in event mode after initialization."""
        if not (self._stepping and self._uses_event_mode):
            super().set_value(variable, value)
            return
        self._enter_event_mode()
        super().set_value(variable, value)
        self._update_discrete_states()
        self._leave_event_mode()

    def set_inputs(self) -> None:
        """Pass `inputs` to the FMU; after initialization discrete ones wait for the next step."""
        if not self._stepping:
            super().set_inputs()
        else:
            self._set(self._set_continuous, self._continuous)

    def do_step(self, time: float, step: float) -> None:
        """Advance from `time` by `step`, both in s, and handle the events in between and at the end."""
        self._present.time = self._time = time
        memory, end = self._memory, time + step
        if not math.isnan(memory[_END]):
            raise self._end("updateDiscreteStates", memory[_END])
        near = max(SAME_TIME * step, 4.0 * math.ulp(end))
        if not np.array_equal(memory[_PASSED:], self.inputs[self._discrete]):
            self._handle_event()
        standing = 0
        while True:
            reached, has_event = self._advance(self._next_stop(end, near) - self._time)
            standing = standing + 1 if reached <= self._time + near else 0
            if standing > MOST_UPDATES:
                raise self._stuck("doStep returned early", standing)
            self._time = end if reached >= end - near else reached
            if has_event or self._time >= memory[_NEXT] - near:
                self._handle_event()
            if self._time == end:
                return
            if not math.isnan(memory[_END]):
                raise self._end("updateDiscreteStates", memory[_END])

    def save(self, state: Any = None) -> Any:
        """Return a copy of the FMU's state, in the memory of the earlier copy `state`."""
        own = super().save(None if state is None else state.state)
        return SavedState(own, self._memory.copy())

    def restore(self, state: Any) -> None:
        """Restore a saved state."""
        super().restore(state.state)
        self._memory[:] = state.memory

    def forget(self, state: Any) -> None:
        """Free a saved state."""
        super().forget(state.state)

    def serialize(self) -> bytes:
        """Return the state as bytes."""
        return self._memory.tobytes() + super().serialize()

    def deserialize(self, content: bytes) -> None:
        """Restore a state from the bytes of `serialize`."""
        super().deserialize(content[self._memory.nbytes :])
        self._memory[:] = np.frombuffer(content[: self._memory.nbytes])

    def entry_points(self) -> EntryPoints | None:
        """Return None: compiled code handles no events."""
        return None

    def observed_groups(self) -> list[ObservedGroup]:
        """Return none, as for `entry_points`."""
        return []

    def _next_stop(self, end: float, near: float) -> float:
        """Return the time to which the next step of the FMU goes."""
        following = float(self._memory[_NEXT])
        return following if self.varies_step and self._time + near < following < end - near else end

    def _advance(self, step: float) -> tuple[float, bool]:
        """Do one step of the FMU; return the time that it has reached, and whether it needs event mode."""
        time, call = self._time, f"doStep at t = {self._time:.9g} s"
        with self.calling(call):
            needs_event, ends, is_early, reached = self.fmu.doStep(time, step, bool(self._no_way_back))
        if ends:
            raise self._end("doStep", time)
        refused = "it returned early" if is_early and not self.instantiation["earlyReturnAllowed"] else ""
        refused = "it asked for event mode" if needs_event and not self._uses_event_mode else refused
        if refused:
            raise InstanceError(self.name, call, f"{refused}, which is not allowed here", self._said())
        if is_early and not time - math.ulp(time) <= reached <= time + step + math.ulp(time + step):
            raise InstanceError(self.name, call, f"lastSuccessfulTime = {reached:.9g}", self._said())
        return (reached if is_early else time + step), needs_event

    def _handle_event(self) -> None:
        """Pass the discrete inputs, and compute the discrete states."""
        self._enter_event_mode()
        if len(self._discrete):
            self._set(self._set_discrete, self._discrete)
            self._memory[_PASSED:] = self.inputs[self._discrete]
        self._update_discrete_states()
        self._leave_event_mode()

    def _enter_event_mode(self) -> None:
        with self.calling():
            self.fmu.enterEventMode()

    def _leave_event_mode(self) -> None:
        with self.calling():
            self.fmu.enterStepMode()

    def _update_discrete_states(self) -> None:
        """Update the discrete states until the FMU needs no more of it."""
        for _ in range(MOST_UPDATES):
            with self.calling(f"updateDiscreteStates at t = {self._time:.9g} s"):
                needs_more, ends, _, _, has_next, following = self.fmu.updateDiscreteStates()
            self._memory[_NEXT] = following if has_next else math.inf
            if math.isnan(self._memory[_NEXT]):  # it would compare as never
                raise InstanceError(self.name, "updateDiscreteStates", "nextEventTime = NaN", self._said())
            if ends:
                self._memory[_END] = self._time
            if not needs_more:
                return
        raise self._stuck("updateDiscreteStates needed another update", MOST_UPDATES)

    def _set(self, typed: TypedValues, places: Any) -> None:
        """Set inputs at these places."""
        try:
            status = typed.set(self._component, self.inputs[places])
        except ValueRangeError as error:
            raise self._out_of_range(error) from error
        if status not in (0, 1):
            raise self.error("setting inputs", status)

    def _end(self, call: str, time: float) -> InstanceError:
        at = f"{call} at t = {time:.9g} s"
        return EndRequestedError(self.name, at, "terminateSimulation", self._said())

    def _stuck(self, what: str, times: int) -> InstanceError:
        at = f"{what.split()[0]} at t = {self._time:.9g} s"
        return InstanceError(self.name, at, f"a request for more, {times} times in a row", self._said())

    def _said(self) -> list[str]:
        return self._log.last(self.name)
