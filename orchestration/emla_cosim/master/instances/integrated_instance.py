"""FMUs that run as Model Exchange, integrated by CVode between communication points."""

import contextlib
import math
import struct
from collections.abc import Callable, Collection, Iterator, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from fmpy.model_description import ModelDescription, ModelVariable

from ...base.arrays import Vector
from ...base.errors import RunError
from ...fmu.cvode import IntegratorSettings, SolverError
from ...fmu.elements import is_plain, position_in_array
from ...fmu.integrator import CLOSE, ContinuousModel, DiscardedCall, Integrator
from .fmu_instance import EndRequestedError, FmuInstance, InstanceError
from .in_process_instance import InProcessInstance
from .typed_values import TypedValues


class DiscardedCallError(InstanceError, DiscardedCall):
    """The FMU discarded a call; other states may succeed."""


class ModelExchangeInstance(InProcessInstance, ContinuousModel):
    """One instance of an FMU that runs as Model Exchange, without its integrator.

    Attributes:
        surround: returns what surrounds a change of a variable from outside. The integrator sets it.
    """

    surround: Callable[[], contextlib.AbstractContextManager[None]] = contextlib.nullcontext

    @property
    def _description(self) -> ModelDescription:
        return self.file.description

    @cached_property
    def needs_completed_step(self) -> bool:
        """Whether the FMU needs a call when a step of the integrator is complete."""
        return self.file.has_capability("needsCompletedIntegratorStep")

    def use_integrator(self, settings: IntegratorSettings) -> None:
        """Integrate with these settings from the next initialization on."""
        self.settings = settings

    def reset(self) -> None:
        """Return to the state right after instantiation."""
        super().reset()
        self.surround = contextlib.nullcontext

    def enter_initialization(self, start_time: float, stop_time: float | None = None) -> None:
        """Enter initialization mode; times in s, None without a fixed stop time."""
        self.start(start_time)
        super().enter_initialization(start_time, stop_time)

    def exit_initialization(self) -> None:
        """Leave initialization mode; the FMU is in event mode then."""
        super().exit_initialization()
        if self.is_3:
            self._check_count("getNumberOfContinuousStates", self.state_count)
            self._check_count("getNumberOfEventIndicators", self.indicator_count)

    def _check_count(self, call: str, declared: int) -> None:
        """Raise InstanceError if `call` returns another number of values than is declared."""
        with self.calling():
            count = getattr(self.fmu, call)()
        if count != declared:
            raise self._answer_error(call, f"{count}, and its model description has {declared}")

    def set_value(self, variable: ModelVariable, value: Any) -> None:
        """Set one variable to a value of its type; InstanceError if the FMU rejects it."""
        with self.surround():
            super().set_value(variable, value)

    def make_reader(self, variables: Sequence[ModelVariable], values: Vector) -> Callable[[], None]:
        """Return a function that reads Real variables into `values`, in their order."""
        if is_plain(variables):
            return self._make_plain_call("getReal", variables, values)
        typed = TypedValues("get", variables, self._functions)

        def read() -> None:
            self._check_status("getReal", typed.get(self._component, values))

        return read

    def make_writer(self, variables: Sequence[ModelVariable], values: Vector) -> Callable[[], None]:
        """Return a function that sets Real variables to `values`, in their order.

        The other elements of their arrays keep the values of the FMU.
        """
        if is_plain(variables):
            return self._make_plain_call("setReal", variables, values)
        typed = TypedValues("set", variables, self._functions)
        getters = [self._functions[f"get{group.call.removeprefix('set')}"] for group in typed.groups]

        def write() -> None:
            for group, get in zip(typed.groups, getters, strict=True):
                self._check_status("getReal", get(self._component, *group.arguments))
            self._check_status("setReal", typed.set(self._component, values))

        return write

    def _make_plain_call(
        self, name: str, variables: Sequence[ModelVariable], values: Vector
    ) -> Callable[[], None]:
        """Return a function that gets or sets variables whose values are the memory of one FMI call."""
        references = [v.valueReference for v in variables if not position_in_array(v)]
        arguments = self._make_arguments(np.array(references, dtype=np.uint32), values)[1:]
        return lambda: self._call(name, *arguments)

    def error(self, call: str, status: int) -> RunError:
        """Return the error for a call that returned this status."""
        is_placed = math.isnan(self._time) or " at t = " in call
        return super().error(call if is_placed else self._at(call), status)

    def _describe_time(self, call: str) -> str:
        return "" if math.isnan(self._time) else f" at t = {self._time:.9g} s"

    def _choose_discard_error(self, call: str) -> type[InstanceError]:
        return DiscardedCallError

    def _update(self, call: str) -> tuple[bool, bool, bool, bool, bool, float]:
        with self.calling(call):
            return self.fmu.newDiscreteStates()

    def _answer_error(self, call: str, answer: str) -> InstanceError:
        return InstanceError(self.name, call, answer, self.messages())

    def _end_error(self, call: str) -> EndRequestedError:
        return EndRequestedError(self.name, call, "terminateSimulation", self.messages())


_LENGTH = struct.Struct("<Q")


class IntegrationError(InstanceError):
    """The integrator cannot continue."""

    action_format = "cannot be integrated {call}: {status}"


class IntegratedInstance(Integrator[ModelExchangeInstance], FmuInstance):
    """FMUs that run as Model Exchange, with one integrator; see `FmuInstance`.

    This class steps one FMU; `IntegratedGroup` steps several. Between two calls the FMUs are in
    continuous-time mode. The integrator continues from step to step, and starts anew where an FMU had an
    event or got other inputs, and where its state was saved or restored. So a repeated step has the same
    result as the first one.
    """

    restarts_when_saved = True

    def __init__(self, name: str, members: Sequence[ModelExchangeInstance]) -> None:
        """Integrate instances that are not initialized yet; the first one has the inputs and outputs."""
        first = members[0]
        self.name, self.members = name, list(members)
        self.inputs, self.outputs, self.nominals = first.inputs, first.outputs, first.nominals
        self.continuous_inputs, self.continuous_outputs = first.continuous_inputs, first.continuous_outputs
        self.differentiates = first.differentiates
        self.interpolates = all(m.interpolates for m in members)
        self.rolls_back = all(m.rolls_back for m in members)
        self.serializes = all(m.serializes for m in members)
        moving = [v for v, moves in zip(first.read, first.continuous_inputs, strict=True) if moves]
        self._moving_values = np.zeros(len(moving))
        self._write_moving = first.make_writer(moving, self._moving_values)
        self._restarts_always = False
        self._begin(math.nan)

    @property
    def components(self) -> Collection[str]:
        """Names of its components."""
        return [m.name for m in self.members]

    def _begin(self, time: float) -> None:
        """Forget everything about earlier runs; `time` in s."""
        super()._begin(time)
        self._is_integrating = False
        self._passed_inputs = np.full(len(self.inputs), math.nan)
        self._slopes: Vector | None = None

    def bind(self, inputs: Vector, outputs: Vector) -> None:
        """Use this memory for inputs and outputs."""
        self.members[0].bind(inputs, outputs)
        self.inputs, self.outputs = inputs, outputs

    def reset(self) -> None:
        """Return to the state right after instantiation."""
        self._restarts_always = False
        for member in self.members:
            member.reset()

    def enter_initialization(self, start_time: float, stop_time: float | None = None) -> None:
        """Enter initialization mode; times in s, None without a fixed stop time."""
        self._begin(start_time)
        for member in self.members:
            member.enter_initialization(start_time, stop_time)

    def exit_initialization(self) -> None:
        """Leave initialization mode, and handle its events."""
        for member in self.members:
            member.exit_initialization()
            member.surround = self._event
        self._passed_inputs[:] = self.inputs
        self._finish_event()
        self._is_integrating = True

    def set_inputs(self) -> None:
        """Pass `inputs` to the FMUs, with an event where they may cause one."""
        if not self._is_integrating:
            self._set_all_inputs()
            return
        self._slopes = None
        changed = self.inputs != self._passed_inputs
        if not changed.any():
            return
        if self._indicators or (changed & ~self.continuous_inputs).any():
            with self._event():
                self._set_all_inputs()
        else:
            self._set_continuous_inputs()
        self._passed_inputs[:] = self.inputs
        self._is_discontinuous = self._is_interrupted = True

    def set_input_derivatives(self, derivatives: Vector) -> None:
        """Set the slopes of the inputs during the next step, per s."""
        self._slopes = derivatives[self.continuous_inputs].copy() if derivatives.any() else None

    def get_outputs(self) -> None:
        """Read the outputs into `outputs`."""
        self.members[0].get_outputs()

    def directional_derivative(self, direction: Vector) -> Vector | None:
        """Return the derivative of the outputs along a direction of the inputs; None if there is none."""
        return self.members[0].directional_derivative(direction)

    def do_step(self, time: float, step: float) -> None:
        """Integrate from `time` by `step`, both in s."""
        if self._restarts_always or self._slopes is not None:
            self._is_discontinuous = self._is_interrupted = True
        if not abs(self._time - time) <= CLOSE * abs(time):
            self._time, self._is_discontinuous = time, True
        self._step_start, self._inputs_at_start = self._time, self._passed_inputs[self.continuous_inputs]
        try:
            self._advance(time + step)
        except SolverError as error:
            raise self._make_integration_error(f"{error}.") from error
        if self._slopes is not None:
            self._passed_inputs[self.continuous_inputs] = self._evaluate_moving_inputs(self._time)
            self._slopes, self._is_discontinuous, self._is_interrupted = None, True, True

    def save(self, state: Any = None) -> Any:
        """Return a copy of the state, in the memory of the earlier copy `state`."""
        self._is_discontinuous = self._is_interrupted = True  # a repeated step starts as this one
        earlier = [None] * len(self.members) if state is None else state[0]
        states = [m.save(s) for m, s in zip(self.members, earlier, strict=True)]
        return states, self._pack_numbers()

    def restore(self, state: Any) -> None:
        """Restore a saved state."""
        states, numbers = state
        self._unpack_numbers(numbers)
        for member, member_state in zip(self.members, states, strict=True):
            member.restore(member_state)

    def forget(self, state: Any) -> None:
        """Free a saved state."""
        for member, member_state in zip(self.members, state[0], strict=True):
            member.forget(member_state)

    def prepare_checkpoints(self) -> None:
        """Start the integrator anew in each step, because a checkpoint does not have its memory."""
        self._restarts_always = True

    def serialize(self) -> bytes:
        """Return the state as bytes."""
        states = [m.serialize() for m in self.members]
        return self._pack_numbers().tobytes() + b"".join(_LENGTH.pack(len(x)) + x for x in states)

    def deserialize(self, content: bytes) -> None:
        """Restore a state from the bytes of `serialize`."""
        # the integrator has restarted in each step of the run that wrote this; see `prepare_checkpoints`
        end = self._pack_numbers().nbytes
        self._unpack_numbers(np.frombuffer(content[:end]))
        self._restarts_always = True
        for member in self.members:
            start = end + _LENGTH.size
            end = start + _LENGTH.unpack(content[end:start])[0]
            member.deserialize(content[start:end])

    def close(self) -> None:
        """Free the solver; the FMUs have their own `close`."""
        self._free_solver()

    def derivatives(self, states: Vector) -> Vector:
        """Set the states, and return their derivatives at the present time, per s."""
        derivatives = np.empty(self._count)
        self._is_discontinuous = self._is_interrupted = True
        # these are not the states of the solver, so that it must start anew
        self._set_states(self._time, states.ctypes.data)
        for member, offset in zip(self.members, self._state_offsets, strict=True):
            member.derive(derivatives.ctypes.data + offset)
        return derivatives

    def shift_input(self, member: int, variable: ModelVariable, by: float) -> None:
        """Add a constant to a continuous input; a connection to it adds the constant from now on.

        Args:
            member: Position of the FMU in `members`.
            variable: The input.
            by: The constant, in the unit of the input.
        """
        instance = self.members[member]
        instance.make_writer([variable], np.array([float(instance.value(variable)) + by]))()

    def handle_event(self) -> None:
        """Do an event, in which the FMUs update discrete states and relations for the present states."""
        with self._event():
            pass

    def _set_all_inputs(self) -> None:
        """Pass all inputs to the FMUs, which are in initialization mode or event mode."""
        self.members[0].set_inputs()

    def _set_continuous_inputs(self) -> None:
        """Pass the inputs, of which only continuous ones have changed, to the FMUs."""
        self.members[0].set_inputs()

    def _set_moving_inputs(self, values: Vector) -> None:
        """Set the continuous inputs to these values."""
        self._moving_values[:] = values
        self._write_moving()

    def _connect(self) -> None:
        """Pass continuous values between the FMUs until they agree."""

    def _list_arrays(self) -> list[Vector]:
        """Return arrays that are part of the state."""
        return [self._passed_inputs]

    def _pack_numbers(self) -> Vector:
        """Return what belongs to the state besides the FMUs' own."""
        return np.concatenate([[self._time], [m.next_event for m in self.members], *self._list_arrays()])

    def _unpack_numbers(self, numbers: Vector) -> None:
        """Restore what `_pack_numbers` returned, and let the integrator start anew."""
        count = 1 + len(self.members)
        self._time, events, rest = float(numbers[0]), numbers[1:count], numbers[count:]
        for member, time in zip(self.members, events, strict=True):
            member.next_event, member.has_new_nominals = float(time), True
        for array in self._list_arrays():
            array[:], rest = rest[: len(array)], rest[len(array) :]
        self._next_event, self._slopes = float(events.min()), None
        self._is_discontinuous = self._is_interrupted = True

    @contextlib.contextmanager
    def _event(self) -> Iterator[None]:
        """Surround a change that may cause an event."""
        self._enter_event_mode()
        yield
        self._finish_event()
        self._is_interrupted = True

    def _set_following_inputs(self, time: float) -> None:
        """Set the inputs that follow their slopes, and connect the FMUs."""
        if self._slopes is not None:
            self._set_moving_inputs(self._evaluate_moving_inputs(time))
        self._connect()

    def _evaluate_moving_inputs(self, time: float) -> Vector:
        """Return the continuous inputs, which follow their slopes, at a time in s."""
        assert self._slopes is not None
        return self._inputs_at_start + (time - self._step_start) * self._slopes

    def _make_integration_error(self, reason: str) -> IntegrationError:
        at = f"at t = {self._time:.9g} s"
        messages = [line for m in self.members for line in m.messages()]
        return IntegrationError(self.name, at, reason.rstrip("."), messages)
