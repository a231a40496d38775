"""Instances of FMI 3.0 FMUs with event mode, clocks or early return: events are handled within a step."""

import contextlib
import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from fmpy.model_description import ModelVariable

from ...base.arrays import Vector
from ...base.errors import RunError
from ...fmu.clocks import CLOCK, read_input_clocks
from ...fmu.elements import is_version_3
from ...fmu.file import FmuFile
from ...fmu.instance import FINE
from ...fmu.interface import CO_SIMULATION
from ...fmu.log import FmuLog
from .clock_schedule import SIZE, ClockSchedule
from .clock_ticks import ClockTicks
from .clocked_variables import ClockedVariables, belongs, is_clocked
from .discrete_states import update_discrete_states
from .event_stepping import MOST_UPDATES, NEXT, DiscreteUpdate, EventStepping
from .fmu_instance import EndRequestedError, EntryPoints, InstanceError, ObservedGroup
from .in_process_instance import InProcessInstance
from .typed_values import TypedValues, ValueRangeError

_PASSED = 2
"""Position of the discrete inputs that the FMU has in the memory, after what `EventStepping` keeps.
The times of the clocks, their variables and their numbers of ticks follow."""


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


class EventModeInstance(InProcessInstance, EventStepping):
    """One instance of an FMU that uses event mode if the FMU has it, and lets its steps end early.

    A step ends at the time that was asked for: after an event before it, the rest follows as another
    step of the FMU. Discrete inputs change in event mode, at the start of a step. Clocks tick at their
    times, at the end of a step with the inputs of that step; clocked inputs change then. Triggered input
    clocks tick at the end of a step, as often as the clocks that drive them have ticked until then.
    """

    _clocked: ClockedVariables | None = None
    _ticks: ClockTicks

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
        self._has_variable_steps = file.has_capability("canHandleVariableCommunicationStepSize")
        self.instantiation = {
            "eventModeUsed": self._uses_event_mode,
            "earlyReturnAllowed": _returns_early(file),
        }
        super().__init__(name, file, inputs, outputs, log, number)
        clocks = read_input_clocks(file.folder, file.path) if self._uses_event_mode else []
        belongs_to_clock = np.array([is_clocked(v) or v.type == CLOCK for v in self.read], dtype=bool)
        is_discrete = ~self.continuous_inputs & self._uses_event_mode & ~belongs_to_clock
        self._continuous = np.flatnonzero(~is_discrete & ~belongs_to_clock)
        self._discrete = np.flatnonzero(is_discrete)
        self._set_continuous, self._set_discrete = (
            TypedValues("set", [self.read[i] for i in places], self._functions, self._arrays)
            for places in (self._continuous, self._discrete)
        )
        clocked = ClockedVariables(file.variables, self._functions)
        self._ticks = ClockTicks(file.variables, self.read)
        sizes = len(self._discrete), SIZE * len(clocks), len(clocked.variables), len(self._ticks.clocks)
        ends = np.cumsum([_PASSED, *sizes])
        self._memory = np.full(ends[-1], math.nan)
        self._passed = self._memory[_PASSED : ends[1]]
        self._schedule = ClockSchedule(clocks, self._memory[ends[1] : ends[2]])
        clocked.use_memory(self._memory[ends[2] : ends[3]])
        self._ticks.use_memory(self._memory[ends[3] :])
        self._kept = self._memory[ends[2] :]
        self._clocked, self._clocked_places = clocked, clocked.places
        self._clocked_outputs = self._find_places(self.written)
        self._get_unclocked = self._getter(self.written, self._clocked_outputs)
        self._set_clocked: dict[tuple[int, ...], tuple[Any, TypedValues]] = {}
        self._set_by_hand: dict[str, tuple[ModelVariable, Any]] = {}
        self.observe([], np.empty(0))
        self._time = math.nan

    def enter_initialization(self, start_time: float, stop_time: float | None = None) -> None:
        """Enter initialization mode; times in s, None without a fixed stop time."""
        self._time = start_time
        self._memory[:] = math.nan
        self._memory[NEXT] = math.inf
        self._ticks.counts[:] = 0.0
        self._set_by_hand.clear()
        super().enter_initialization(start_time, stop_time)

    def exit_initialization(self) -> None:
        """Leave initialization mode, and handle the events at the start."""
        with self._checked_intervals():
            self._schedule.start(self.fmu, self._time)
        self._read_clocked(None)
        super().exit_initialization()
        self._passed[:] = self.inputs[self._discrete]
        if self._uses_event_mode:
            self._update_discrete_states(0.0)
            self._leave_event_mode()

    def set_value(self, variable: ModelVariable, value: Any) -> None:
        """Set one variable to a value of its type, in event mode after initialization."""
        if not (self._stepping and self._uses_event_mode):
            super().set_value(variable, value)
            return
        if is_clocked(variable):
            self._set_by_hand[str(variable.name)] = variable, value
            return
        self._enter_event_mode()
        super().set_value(variable, value)
        self._update_discrete_states(0.0)
        self._leave_event_mode()

    def value(self, variable: ModelVariable) -> Any:
        """Return the present value of a variable; that of the last tick if it is clocked.

        The value of a clock is the number of its ticks.
        """
        if variable.type == CLOCK:
            return int(self._kept[self._find_places([variable])[0]])
        if self._clocked is not None and self._stepping:
            (place,) = self._find_places([variable])
            if place >= 0:
                return self._kept[place]
        return super().value(variable)

    def get_outputs(self) -> None:
        """Read the FMU's outputs into `outputs`; clocked ones are those of the last tick."""
        if self._stepping:
            self._get(self._get_unclocked, self._clocked_outputs, self.outputs)
        else:
            super().get_outputs()
            self._get_counts(self.written, self.outputs)

    def observe(self, names: Sequence[str], values: Vector) -> None:
        """Choose the numeric variables that `get_observed` reads, and where to."""
        super().observe(names, values)
        if self._clocked is not None:
            variables = [self.file.variables[name] for name in names]
            self._observed_variables, self._observed_places = variables, self._find_places(variables)
            self._get_others = self._getter(variables, self._observed_places)

    def get_observed(self) -> None:
        """Read the observed variables; clocked ones are those of the last tick."""
        if self._stepping:
            self._get(self._get_others, self._observed_places, self._observed[1])
        else:
            super().get_observed()
            self._get_counts(self._observed_variables, self._observed[1])

    def set_inputs(self) -> None:
        """Pass `inputs` to the FMU; after initialization discrete ones wait for the next step."""
        if not self._stepping:
            super().set_inputs()
        else:
            self._set(self._set_continuous, self._continuous)

    def do_step(self, time: float, step: float) -> None:
        """Advance from `time` by `step`, both in s, and handle the events in between and at the end."""
        self._present.time = time
        self._check_pending(time + step)
        has_new_inputs = not np.array_equal(self._passed, self.inputs[self._discrete])
        self._step_with_events(time, step, has_new_inputs)

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

    def _advance(self, step: float) -> tuple[float, bool]:
        """Do one step of the FMU; return the time that it has reached, and whether it needs event mode."""
        time, call = self._time, f"doStep at t = {self._time:.9g} s"
        with self.calling(call):
            needs_event, ends, is_early, reached = self.fmu.doStep(time, step, bool(self._no_way_back))
        if ends:
            raise self._end("doStep", time)
        refused = ""
        if is_early and not self.instantiation["earlyReturnAllowed"]:
            if not (self._uses_event_mode and self._has_variable_steps):
                refused = "it returned early"
            elif not self.violations:
                self.violations.append(
                    f"{self.name} returned early from {call}, although its model description does not have "
                    "mightReturnEarlyFromDoStep; the rest of the step followed as another one"
                )
        refused = "it asked for event mode" if needs_event and not self._uses_event_mode else refused
        if refused:
            raise InstanceError(self.name, call, f"{refused}, which is not allowed here", self.messages())
        if is_early and not time - math.ulp(time) <= reached <= time + step + math.ulp(time + step):
            raise InstanceError(self.name, call, f"lastSuccessfulTime = {reached:.9g}", self.messages())
        return (reached if is_early else time + step), needs_event

    def _pass_discrete_inputs(self) -> None:
        if len(self._discrete):
            self._set(self._set_discrete, self._discrete)
            self._passed[:] = self.inputs[self._discrete]

    def _enter_event_mode(self) -> None:
        with self.calling():
            self.fmu.enterEventMode()

    def _leave_event_mode(self) -> None:
        with self.calling():
            self.fmu.enterStepMode()

    def _update(self) -> DiscreteUpdate:
        return update_discrete_states(self, self._time)

    def _find_ticks(self, ticked: Sequence[int]) -> None:
        with self._checked_intervals():
            self._schedule.advance(self.fmu, ticked, self._time)

    def _list_triggered(self) -> dict[int, float]:
        return self._ticks.pending(self.inputs)

    def _tick(self, clocks: Sequence[int], found: Sequence[int]) -> None:
        """Tick input clocks, find the output clocks that tick with them, and read the variables of all.

        An input clock that depends on others ticks after these, at the same instant.

        Args:
            clocks: Value references of the input clocks.
            found: Those of output clocks that are known to tick.

        Raises:
            RunError: A clock would tick without one that it depends on.
        """
        left, ticking = list(clocks), list(found)
        while True:
            now = [c for c in left if self._ticks.can_tick(c, ticking)]
            if now:
                self._set_clocks(now)
            more = [*now, *self._find_output_ticks()]
            left = [c for c in left if c not in now]
            grown = [*dict.fromkeys([*ticking, *more])]
            if not left or len(grown) == len(ticking):
                ticking = grown
                break
            ticking = grown
        if left:
            raise RunError(
                f"the clock {self._ticks.name(left[0])} of {self.name} ticks at t = {self._time:.9g} s "
                f"without {self._ticks.describe_needed(left[0])}, on which it depends."
            )
        if ticking:
            self._read_clocked(ticking)
            self._ticks.count(ticking)

    def _find_output_ticks(self) -> list[int]:
        with self.calling(f"getClock at t = {self._time:.9g} s"):
            return self._ticks.find_output_ticks(self.fmu)

    def _check_pending(self, end: float) -> None:
        """Raise RunError if a triggered clock has to tick too often in a step until `end` in s."""
        for clock, times in self._list_triggered().items():
            if times >= MOST_UPDATES:
                raise RunError(
                    f"the clock {self._ticks.name(clock)} of {self.name} has to tick {times:.0f} times in "
                    f"the step to t = {end:.9g} s; less than {MOST_UPDATES} are supported. Use a smaller "
                    "step size."
                )

    def _set_clocks(self, clocks: Sequence[int]) -> None:
        """Activate input clocks, and set their inputs."""
        key = tuple(clocks)
        if key not in self._set_clocked:
            places = np.array([i for i, v in enumerate(self.read) if belongs(v, clocks)], dtype=np.intp)
            variables = [self.read[i] for i in places]
            self._set_clocked[key] = places, TypedValues("set", variables, self._functions, self._arrays)
        with self.calling(f"setClock at t = {self._time:.9g} s"):
            self.fmu.setClock(clocks, [True] * len(clocks))
        places, setter = self._set_clocked[key]
        self._set(setter, places)
        for variable, value in self._set_by_hand.values():
            if belongs(variable, clocks):
                super().set_value(variable, value)

    def _read_clocked(self, clocks: Sequence[int] | None) -> None:
        if self._clocked is not None:
            status = self._clocked.read(self._component, clocks)
            if status not in FINE:
                raise self.error("getting clocked variables", status)

    @contextlib.contextmanager
    def _checked_intervals(self) -> Iterator[None]:
        """Convert errors of calls and of intervals to InstanceError."""
        try:
            with self.calling():
                yield
        except ValueError as error:
            raise InstanceError(self.name, "getIntervalDecimal", str(error), self.messages()) from error

    def _find_places(self, variables: Sequence[ModelVariable]) -> Any:
        """Return the positions of clocked variables and clocks in `_kept`; -1 for others."""
        counts, values = self._ticks.places(variables), self._clocked_places(variables)
        first = len(self._kept) - len(self._ticks.clocks)
        return np.where(counts >= 0, first + counts, values)

    def _get_counts(self, variables: Sequence[ModelVariable], target: Vector) -> None:
        """Read the clocks among variables before the start."""
        places = self._ticks.places(variables)
        target[places >= 0] = self._ticks.counts[places[places >= 0]]

    def _getter(self, variables: Sequence[ModelVariable], places: Any) -> TypedValues:
        """Return what reads those of the variables that are not clocked."""
        others = [v for v, place in zip(variables, places, strict=True) if place < 0]
        return TypedValues("get", others, self._functions)

    def _get(self, getter: TypedValues, places: Any, target: Vector) -> None:
        """Read variables; `places` are their positions among the clocked ones, or -1."""
        is_other = places < 0
        found = target[is_other]
        status = getter.get(self._component, found)
        if status not in FINE:
            raise self.error("getting values", status)
        target[is_other] = found
        if self._clocked is not None:
            target[~is_other] = self._kept[places[~is_other]]

    def _set(self, typed: TypedValues, places: Any) -> None:
        """Set inputs at these places."""
        try:
            status = typed.set(self._component, self.inputs[places])
        except ValueRangeError as error:
            raise self._range_error(error) from error
        if status not in FINE:
            raise self.error("setting inputs", status)

    def _missed(self, tick: float) -> RunError:
        return RunError(
            f"a clock of {self.name} ticks at t = {tick:.9g} s, within a step, and the FMU cannot vary "
            "its step size. Use a step size that divides the interval of the clock."
        )

    def _end(self, call: str, time: float) -> InstanceError:
        at = f"{call} at t = {time:.9g} s"
        return EndRequestedError(self.name, at, "terminateSimulation", self.messages())

    def _ticks_forever(self, clock: int) -> InstanceError:
        at = f"getClock at t = {self._time:.9g} s"
        said = f"a tick of {self._ticks.name(clock)} after each of {MOST_UPDATES} updates"
        return InstanceError(self.name, at, said, self.messages())

    def _stuck(self, what: str, times: int) -> InstanceError:
        at = f"{what.split()[0]} at t = {self._time:.9g} s"
        return InstanceError(self.name, at, f"a request for more, {times} times in a row", self.messages())
