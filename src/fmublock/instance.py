"""Run a block as a co-simulation slave on Python floats.

PythonFMU FMUs contain this class; tests use it in process. The C shim (`shim/fmi2_block.c`)
does the same operations in the same order, so that both give the same bits.
"""

import difflib
import math
from collections.abc import Sequence
from enum import IntEnum
from typing import Any

from .block import Block, Values
from .results import Results
from .variables import Input, Output, StartTime

# the C shim gets these numbers and the phases from its generated model.h
STEP_TOLERANCE = 1e-3
"""Largest difference between a tool's time and the instance's own, as a fraction of the step."""

SAME_TIME, SAME_STEP = 1e-6, 1e-9
"""Differences in time and step that count as rounding, as a fraction of the step."""

TIME_ROUNDING = 2.0**-50
"""Differences in time that count as rounding, as a fraction of the time: four units in its last place."""

SAME_COUNT = 1e-9
"""Fraction of an internal step by which a step may exceed a whole number of them without another one."""

MAXIMUM_SUBSTEPS = 1e9
"""Most internal steps of a step; with more it would seem to hang, so it is refused."""


class Phase(IntEnum):
    """Phases of the FMI state machine, as bits, so that C code can name several.

    `EVENT` and `CONTINUOUS_TIME` belong to Model Exchange, which only native FMUs support, and
    `INTERMEDIATE_UPDATE` and `CO_SIMULATION_EVENT` to FMI 3.0.
    """

    INSTANTIATED = 1
    INITIALIZATION = 2
    STEP = 4
    EVENT = 8
    CONTINUOUS_TIME = 16
    TERMINATED = 32
    INTERMEDIATE_UPDATE = 64
    CO_SIMULATION_EVENT = 128


class BlockError(Exception):
    """A call that the block refuses. The instance is unchanged."""


class StepDiscardedError(BlockError):
    """A step without a finite result. The instance is as before the step."""


class Instance:
    """Running instance of a block, in Python.

    Use variables by FMI name, `instance["v"]` and `instance["F"] = 3.0`, or by value reference with `get` and
    `set`. The name of a vector or matrix means the list of its values. Values are floats; Booleans are 0 or
    1. Outputs change only during initialization and at the end of a step: they are g(x(t+h), u held over the
    step).

    Args:
        block: the block.
        name: name in messages. Default: the class of the block.

    Examples:
        >>> from fmublock import Block, Input, Instance, Output
        >>> class Twice(Block):
        ...     u = Input(unit="m")
        ...     y = Output(unit="m")
        ...
        ...     def outputs(self, v):
        ...         return {"y": 2.0 * v.u}
        >>> twice = Instance(Twice())
        >>> twice["u"] = 3.0
        >>> twice["y"]
        6.0
    """

    def __init__(self, block: Block, name: str = "") -> None:
        self.block = block
        self.name = name or type(block).__name__
        self.layout = block.layout()
        self.phase = Phase.INSTANTIATED
        self._v = Values()  # the equations' argument: inputs, parameters, states, time
        self._y = Values()  # the frozen outputs
        self._v.time = 0.0
        self._stop_time = math.inf
        # steps of one length since an origin: origin, step and count
        self._clock = (0.0, 0.0, 0.0)
        # where each scalar is stored, as (container, key): an attribute dict or an array's list
        self._slots: list[tuple[Any, Any]] = []
        for scalar in self.layout.scalars:
            variable = scalar.variable
            container: Any = self._y.__dict__ if isinstance(variable, Output) else self._v.__dict__
            key: Any = variable.attribute
            if scalar.index and key not in container:
                container[key] = variable.nested([0.0] * math.prod(variable.shape))
            for place in scalar.index:
                container, key = container[key], place
            self._slots.append((container, key))
        references = self.layout.references
        self._parameters = references(self.layout.parameters)
        self._states = references(self.layout.states)
        self._discrete_states = references(self.layout.discrete_states)
        self._output_references = references(self.layout.outputs)
        self._state_slots = [self._slots[r] for r in self._states]
        # all states and outputs, a contiguous range at the end
        evolving = [*self._states, *self._discrete_states, *self._output_references]
        self._evolving = range(evolving[0], evolving[-1] + 1) if evolving else range(0)
        # states that start from parameters, as pairs of value references
        starts = ((r, self.layout.start_reference(r)) for r in (*self._states, *self._discrete_states))
        self._starts = [(r, start) for r, start in starts if r != start]
        scalars = self.layout.scalars
        self._start_times = [r for r in self._discrete_states if isinstance(scalars[r].variable, StartTime)]
        # value references of variables with limits, and of the parameters that are these limits
        limits = ((r, self.layout.limit_references(r)) for r in self._evolving)
        self._limited = [(r, *found) for r, found in limits if found is not None]
        self._left: set[int] = set()
        self._derivative_results = Results(block, "derivatives")
        self._update_results = Results(block, "update")
        self._output_results = Results(block, "outputs")
        self._write(range(len(self._slots)), [scalar.start for scalar in self.layout.scalars])

    @property
    def time(self) -> float:
        """Time of the instance in s: the end of the last step."""
        return self._v.time

    def __getitem__(self, name: str) -> Any:
        """Return the value of a variable by FMI name; a list, or a list of rows, for an array."""
        references = self._references_of(name)
        values = self.get(references)
        array = self.layout.arrays.get(name)
        return values[0] if array is None else array.nested(values)

    def __setitem__(self, name: str, value: Any) -> None:
        """Set a variable by FMI name; a list, or a list of rows, for an array.

        Raises:
            BlockError: the variable does not exist, cannot be set now, or the value does not fit.
        """
        references = self._references_of(name)
        array = self.layout.arrays.get(name)
        try:
            values = [float(x) for x in ([value] if array is None else array.flat(value))]
        except (TypeError, ValueError) as error:
            raise BlockError(f"{self.name}: {value!r} is not a value for {name}: {error}.") from None
        self.set(references, values)

    def get(self, references: Sequence[int]) -> list[float]:
        """Return the values of variables.

        Args:
            references: value references.

        Raises:
            BlockError: an output cannot be computed during initialization.
        """
        if self.phase <= Phase.INITIALIZATION:
            self._take_start_values()
            self._evaluate_first_outputs()
        return [container[key] for container, key in (self._slots[r] for r in references)]

    def set(self, references: Sequence[int], values: Sequence[float]) -> None:
        """Set inputs at any time, parameters and start values of states before the first step.

        Args:
            references: value references.
            values: one value for each reference.

        Raises:
            BlockError: a variable cannot be set now. Nothing was set.
        """
        if self.phase == Phase.TERMINATED:
            raise BlockError(f"{self.name}: cannot set values in phase terminated.")
        for r in references:
            self._check_settable(r)
        self._write(references, [float(x) for x in values])

    def setup_experiment(self, start_time: float = 0.0, stop_time: float | None = None) -> None:
        """Set start and stop time.

        Args:
            start_time: in s.
            stop_time: in s; later steps are refused. Default: none.

        Raises:
            BlockError: the times are not finite or not in order, or initialization has begun.
        """
        self._require(Phase.INSTANTIATED, "set up the experiment")
        if not math.isfinite(start_time):
            raise BlockError(f"{self.name}: the start time {start_time} is not a finite number of seconds.")
        if stop_time is not None and not stop_time >= start_time:
            raise BlockError(
                f"{self.name}: the stop time {stop_time} s is not after the start time {start_time} s."
            )
        self._v.time = start_time
        self._stop_time = math.inf if stop_time is None else stop_time

    def enter_initialization(self) -> None:
        """Begin initialization."""
        self._require(Phase.INSTANTIATED, "enter initialization mode")
        self.phase = Phase.INITIALIZATION

    def exit_initialization(self) -> None:
        """End initialization.

        Raises:
            BlockError: a value is out of range, a condition of the block does not hold, or an output cannot
                be computed.
        """
        self._require(Phase.INITIALIZATION, "exit initialization mode")
        self._take_start_values()
        for r in (*self._parameters, *self._states):  # before the equations use the values
            self._check_range(r)
        self._check_conditions()
        self._evaluate_first_outputs()
        self.phase = Phase.STEP

    def do_step(self, time: float, step: float) -> None:
        """Advance by one step, with constant inputs.

        A step that begins and ends within rounding of the time of the instance does nothing. Tools that add
        up their steps make such a step before the end. Rounding is 1e-6 of this or the last step, whichever
        is longer, and a few units in the last place of the time.

        Args:
            time: start of the step, in s.
            step: step size in s.

        Raises:
            StepDiscardedError: a state or an output becomes infinite or NaN.
            BlockError: the step does not begin at the time of the instance, or is not allowed.
        """
        self._require(Phase.STEP, "do a step")
        self._check_step(time, step)
        if self._is_sliver(time, step):
            return
        before = self.time, self._clock, self.get(self._evolving)
        try:
            self._begin_step(time, step)
            problem = self._advance()
        except BaseException:
            self._restore(*before)
            raise
        if problem is not None:
            self._restore(*before)
            raise StepDiscardedError(
                f"{self.name}: step from t = {time:.9g} s with h = {step:.9g} s discarded: {problem}."
            )

    def left_limits(self) -> list[str]:
        """Return a message for each variable that has left its limits since the start, once each."""
        messages = []
        for r, *parameters in self._limited:
            value, low, high = self.get((r, *parameters))
            if parameters[0] == parameters[1]:
                low = -high
            if r not in self._left and not low <= value <= high:
                self._left.add(r)
                shown, _ = _distinct_texts(value, low if value < low else high)
                messages.append(
                    f"{self.name}: {self.layout.scalars[r].name} = {shown} left its limits, "
                    f"{low:.9g} to {high:.9g}, at t = {self.time:.9g} s."
                )
        return messages

    def terminate(self) -> None:
        """End the run. Values can still be read."""
        self._require(Phase.STEP, "terminate")
        self.phase = Phase.TERMINATED

    def get_state(self) -> dict[str, Any]:
        """Return everything that evolves or was set, as plain values."""
        values = [container[key] for container, key in self._slots]
        return {
            "phase": int(self.phase),
            "time": self.time,
            "stop_time": self._stop_time,
            "clock": list(self._clock),
            "values": values,
        }

    def set_state(self, state: dict[str, Any]) -> None:
        """Restore a state of an instance of the same block."""
        values = state["values"]
        if len(values) != len(self._slots):
            raise BlockError(f"{self.name}: the state has {len(values)} values, not {len(self._slots)}.")
        for (container, key), value in zip(self._slots, values, strict=True):
            container[key] = value
        self._v.time, self._stop_time = state["time"], state["stop_time"]
        origin, step, count = state["clock"]
        self._clock = (origin, step, count)
        self.phase = Phase(state["phase"])

    def _check_step(self, time: float, step: float) -> None:
        if not (math.isfinite(time + step) and step > 0.0):
            raise BlockError(f"{self.name}: the step size {step} s is not a positive, finite number.")
        if not abs(time - self.time) <= max(STEP_TOLERANCE * step, self._rounding(time, step)):
            asked, own = _distinct_texts(time, self.time)
            raise BlockError(
                f"{self.name}: the step starts at t = {asked} s, but the instance is at t = {own} s."
            )
        if time + step > self._stop_time + STEP_TOLERANCE * step + TIME_ROUNDING * abs(time):
            end, stop = _distinct_texts(time + step, self._stop_time)
            raise BlockError(f"{self.name}: the step to t = {end} s goes past the stop time {stop} s.")
        if self._states and not step / self._v.internal_step <= MAXIMUM_SUBSTEPS:
            raise BlockError(
                f"{self.name}: the step of {step} s needs more than {MAXIMUM_SUBSTEPS:g} internal steps."
            )

    def _rounding(self, time: float, step: float) -> float:
        """Return by how much a tool's time may differ from the instance's own through rounding, in s."""
        _, last, _ = self._clock
        return SAME_TIME * max(step, last) + TIME_ROUNDING * abs(time)

    def _is_sliver(self, time: float, step: float) -> bool:
        """Return whether a step exists only because the tool rounds its times in another way.

        A first step never does: there is no earlier rounding, and only a step checks that outputs are finite.
        """
        rounding = self._rounding(time, step)
        is_there = abs(time - self.time) <= rounding and abs(time + step - self.time) <= rounding
        _, last, _ = self._clock
        return last > 0.0 and is_there

    def _begin_step(self, time: float, step: float) -> None:
        """Begin a step on the instance's own clock.

        It counts steps of the same length instead of summing them up, so that the tool's rounding of
        times does not change a bit of the results.
        """
        origin, same, count = self._clock
        is_continued = abs(step - same) <= SAME_STEP * same and abs(time - self.time) <= SAME_TIME * step
        if not is_continued:
            origin, same, count = self._clock = (time, step, 0.0)
        self._v.time = origin + count * same

    def _advance(self) -> str | None:
        """Do the step and return a message if a value is not finite afterwards."""
        origin, step, count = self._clock
        self._clock = (origin, step, count + 1.0)
        try:
            self._integrate(self.time, step)
            self._v.time = origin + (count + 1.0) * step
            self._update_discrete_states()
            self._evaluate_outputs()
        except ArithmeticError as error:
            return f"an equation failed ({error})"
        for r in self._evolving:
            container, key = self._slots[r]
            if not math.isfinite(container[key]):
                return f"{self.layout.scalars[r].name} became {container[key]}"
        return None

    def _restore(self, time: float, clock: tuple[float, float, float], evolving: Sequence[float]) -> None:
        self._v.time, self._clock = time, clock
        self._write(self._evolving, evolving)

    def _write(self, references: Sequence[int], values: Sequence[float]) -> None:
        for r, value in zip(references, values, strict=True):
            container, key = self._slots[r]
            container[key] = value

    def _require(self, phase: Phase, action: str) -> None:
        if self.phase != phase:
            raise BlockError(f"{self.name}: cannot {action} in phase {self.phase.name.lower()}.")

    def _check_settable(self, reference: int) -> None:
        scalar = self.layout.scalars[reference]
        variable = scalar.variable
        if isinstance(variable, Input):
            return
        if isinstance(variable, Output) or variable.has_computed_start:
            raise BlockError(f"{self.name}: {scalar.name} is computed by the block and cannot be set.")
        if self.phase > Phase.INITIALIZATION:
            raise BlockError(f"{self.name}: {scalar.name} cannot be set after initialization.")

    def _check_range(self, reference: int) -> None:
        scalar = self.layout.scalars[reference]
        low, high = scalar.variable.range
        container, key = self._slots[reference]
        value = container[key]
        if not (low <= value <= high and math.isfinite(value)):
            raise BlockError(
                f"{self.name}: {scalar.name} = {value:.9g} is outside its range, {low:.9g} to {high:.9g}."
            )

    def _check_conditions(self) -> None:
        try:
            conditions = self.block.conditions(self._v)
        except ArithmeticError as error:
            raise BlockError(f"{self.name}: its conditions cannot be computed: {error}.") from error
        for message, holds in conditions.items():
            if not holds:
                raise BlockError(f"{self.name}: {message}.")

    def _references_of(self, name: str) -> Sequence[int]:
        array = self.layout.arrays.get(name)
        if array is not None:
            return self.layout.references((array,))
        try:
            return (self.layout.reference(name),)
        except KeyError:
            names = [*self.layout.arrays, *(scalar.name for scalar in self.layout.scalars)]
            near = difflib.get_close_matches(name, names, 1)
            hint = f"; did you mean '{near[0]}'?" if near else "."
            raise BlockError(f"{self.name}: there is no variable '{name}'{hint}") from None

    def _take_start_values(self) -> None:
        """Set states to the start values that come from parameters, or to the start time."""
        self._write(self._start_times, [self.time] * len(self._start_times))
        for reference, start in self._starts:
            container, key = self._slots[start]
            self._write((reference,), (container[key],))

    def _evaluate_first_outputs(self) -> None:
        try:
            self._evaluate_outputs()
        except ArithmeticError as error:
            raise BlockError(f"{self.name}: the first outputs cannot be computed: {error}.") from error

    def _integrate(self, time: float, step: float) -> None:
        """Integrate by classical Runge-Kutta, in substeps no longer than the block's internal step."""
        slots = self._state_slots
        if not slots:
            return
        v = self._v
        count = max(math.ceil(step / v.internal_step - SAME_COUNT), 1)
        dt = step / count
        for i in range(count):
            t = time + i * dt
            x = [container[key] for container, key in slots]
            k1 = self._derivatives(t)
            self._set_states(x, 0.5 * dt, k1)
            k2 = self._derivatives(t + 0.5 * dt)
            self._set_states(x, 0.5 * dt, k2)
            k3 = self._derivatives(t + 0.5 * dt)
            self._set_states(x, dt, k3)
            k4 = self._derivatives(t + dt)
            slope = [a + 2.0 * b + 2.0 * c + d for a, b, c, d in zip(k1, k2, k3, k4, strict=True)]
            self._set_states(x, dt / 6.0, slope)

    def _set_states(self, x: list[float], factor: float, slope: list[float]) -> None:
        for (container, key), x_i, slope_i in zip(self._state_slots, x, slope, strict=True):
            container[key] = x_i + factor * slope_i

    def _derivatives(self, time: float) -> list[float]:
        self._v.time = time
        return self._derivative_results.flat(self.block.derivatives(self._v))

    def _update_discrete_states(self) -> None:
        if self._discrete_states:
            update = self._update_results.flat(self.block.update(self._v))
            self._write(self._discrete_states, update)

    def _evaluate_outputs(self) -> None:
        outputs = self._output_results.flat(self.block.outputs(self._v))
        self._write(self._output_references, outputs)


def _distinct_texts(a: float, b: float) -> tuple[str, str]:
    """Format two numbers with enough digits to see that they differ, at least 9."""
    texts = ((f"{a:.{digits}g}", f"{b:.{digits}g}") for digits in range(9, 18))
    return next((pair for pair in texts if pair[0] != pair[1]), (repr(a), repr(b)))
