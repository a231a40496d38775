"""The interface of FMU instances for algorithms."""

from abc import ABC, abstractmethod
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Vector
from ...base.errors import RunError
from ...fmu.fmi_3_calls import StepEnd
from ...fmu.python_exceptions import REMEDY

if TYPE_CHECKING:
    from .python_calls import PythonCalls
    from .typed_values import TypeGroup


_END_REQUEST = "asked to end the simulation"


class InstanceError(RunError):
    """A call of an instance failed.

    Args:
        instance: Name of the instance.
        call: The FMI function or action.
        status: What the call returned.
        log: Messages of the instance.
    """

    action_format = "answered {call} with {status}"

    def __init__(self, instance: str, call: str, status: str, log: list[str]) -> None:
        action = self.action_format.format(call=call, status=status)
        # without duplicates: a repeated step repeats messages
        log_text = f" FMU log: {' '.join(dict.fromkeys(log))}" if log else ""
        super().__init__(
            f"{instance} {action}.{log_text}", component=instance, call=call, status=status, log=log
        )


class DiscardedStepError(InstanceError):
    """The instance discarded a step; a shorter step from an earlier state may succeed."""


class EndRequestedError(InstanceError):
    """The instance requested the end of the simulation."""

    action_format = f"{_END_REQUEST} during {{call}}"


def is_requested_end(text: str | None) -> bool:
    """Return whether a text contains the message of an EndRequestedError."""
    return f" {_END_REQUEST} during " in (text or "")


class PythonExceptionError(InstanceError):
    """An FMU left an exception of Python set in this process; see `python_exceptions`.

    Args:
        instance: Name of the instance; several names if the culprit is unknown.
        call: The FMI function, or the interval of time.
        exception: The exception in one line.
        log: Messages of the instance.
        remedy: A message on what to do besides reporting it to the exporter.
    """

    action_format = "left a Python exception in {call}: {status}"

    def __init__(self, instance: str, call: str, exception: str, log: list[str], remedy: str = "") -> None:
        super().__init__(instance, call, exception, log)
        self.args = (" ".join(filter(None, (str(self), remedy, REMEDY))),)


class GroupCall(NamedTuple):
    """An FMI function for values of one type, by address, and its arguments.

    Without a function, 0, the values are only copied from their memory.
    """

    function: int
    group: "TypeGroup"


class CallNames(NamedTuple):
    """Names of the calls of an instance, as in `call_codes.CALLS`."""

    set: str = "setReal"
    get: str = "getReal"
    save: str = "getFMUstate"
    restore: str = "setFMUstate"


_NAMES = CallNames()


@dataclass(frozen=True)
class EntryPoints:
    """Addresses that the stepper needs to call an instance through FMI functions.

    `component` is the instance (`fmi2Component`); the functions are in its library. There is one value
    reference per element of `inputs` and `outputs`.

    With `step_end` they are functions of FMI 3.0, and an array has one value reference.

    Attributes:
        step_end: memory for what a step of FMI 3.0 returns besides its status.
        setters: calls that set `inputs`; None if one call for doubles does.
        getters: calls that get `outputs`, likewise.
        get_status: `fmi2GetBooleanStatus`; 0 without it.
        end_step: waits for the end of a step that `do_step` only begins; 0 without it.
        events: tables of event mode, clocks and early returns, for the stepper in C; 0 without these.
        calls: what makes the calls in Python; None if the functions are those of an FMU.
    """

    component: int
    set_real: int
    get_real: int
    do_step: int
    set_real_input_derivatives: int
    get_state: int
    set_state: int
    input_references: NDArray[np.uint32]
    output_references: NDArray[np.uint32]
    derivative_orders: NDArray[np.int32]
    names: CallNames = _NAMES
    step_end: StepEnd | None = None
    setters: Sequence[GroupCall] | None = None
    getters: Sequence[GroupCall] | None = None
    get_status: int = 0
    end_step: int = 0
    events: int = 0
    calls: "PythonCalls | None" = None


class FmuInstance(ABC):
    """FMU as algorithms see it: it exchanges two vectors with the network.

    `inputs` has the values of its connected inputs until `set_inputs` passes them on; `get_outputs` writes to
    `outputs`, a part of the signals of the network. Every method may raise InstanceError, a RunError.

    Attributes:
        name: name of the component.
        inputs: connected inputs, shape (inputs,), in their units.
        outputs: outputs, shape (outputs,), in their units.
        continuous_inputs: which inputs change smoothly, shape (inputs,).
        continuous_outputs: which outputs change smoothly, shape (outputs,).
        nominals: nominal values of the outputs, shape (outputs,), in their units.
        varies_step: whether it accepts steps of any length.
        rolls_back: whether it can restore a saved state.
        serializes: whether it can write its state as bytes.
        interpolates: whether it accepts derivatives of its inputs.
        differentiates: whether it can compute directional derivatives.
    """

    name: str
    inputs: Vector
    outputs: Vector
    continuous_inputs: NDArray[np.bool_]
    continuous_outputs: NDArray[np.bool_]
    nominals: Vector
    varies_step = True
    rolls_back = False
    serializes = False
    interpolates = False
    differentiates = False
    steps_apart = False
    """Whether it supports `begin_step` and `end_step`, so that others can step meanwhile."""
    restarts_when_saved = False
    """Whether `save` changes the last digits of the next step, because an integrator restarts."""
    is_under_way = False
    """Whether a step has begun and not ended. Any call but `end_step` ends it, too, and drops its result."""

    @property
    def clocked_inputs(self) -> NDArray[np.bool_]:
        """Which inputs change at the ticks of a clock only, shape (inputs,)."""
        return np.zeros(len(self.inputs), dtype=bool)

    @property
    def span_references(self) -> Sequence[NDArray[np.uint32]]:
        """Value references of what its outputs did in the last step: see `emla_cosim.fmu.file`.

        Only tables have them, and not those with discrete outputs only.
        """
        return ()

    @property
    def components(self) -> Collection[str]:
        """Return the names of the components that it steps."""
        return [self.name]

    @property
    def runs_beside_others(self) -> bool:
        """Whether other threads may call other instances at the same time."""
        return True

    def reset(self) -> None:
        """Return to the state of a new instance."""
        raise NotImplementedError

    @abstractmethod
    def enter_initialization(self, start_time: float, stop_time: float | None) -> None:
        """Enter initialization mode.

        Args:
            start_time: in s.
            stop_time: in s; None for a run without a fixed end.
        """

    @abstractmethod
    def exit_initialization(self) -> None:
        """Leave initialization mode; the instance can step then."""

    @abstractmethod
    def set_inputs(self) -> None:
        """Pass `inputs` on to the FMU."""

    @abstractmethod
    def get_outputs(self) -> None:
        """Read the outputs of the FMU into `outputs`."""

    @abstractmethod
    def do_step(self, time: float, step: float) -> None:
        """Advance by one step.

        Args:
            time: start of the step, in s.
            step: step size in s.

        Raises:
            DiscardedStepError: the FMU discarded the step; from an earlier state, a shorter one may succeed.
        """

    def begin_step(self, time: float, step: float) -> None:
        """Begin a step if `steps_apart`; see `is_under_way`."""
        raise NotImplementedError

    def end_step(self) -> None:
        """Wait until the step is done; raises the errors of `do_step`."""
        raise NotImplementedError

    @abstractmethod
    def close(self) -> None:
        """Free the instance; never raises."""

    def bind(self, inputs: Vector, outputs: Vector) -> None:
        """Use other memory for inputs and outputs; the inputs keep their values."""
        inputs[:] = self.inputs
        self.inputs, self.outputs = inputs, outputs

    def set_input_derivatives(self, derivatives: Vector) -> None:
        """Set the derivatives of the inputs during the next step, per s; needs `interpolates`."""
        raise NotImplementedError

    def directional_derivative(self, direction: Vector) -> Vector | None:
        """Return the immediate change of the outputs for a change of the inputs; needs `differentiates`.

        Args:
            direction: change of the inputs, shape (inputs,).

        Returns:
            Change of the outputs, shape (outputs,); None if the FMU cannot compute it now.
        """
        raise NotImplementedError

    def save(self, state: Any = None) -> Any:
        """Return a copy of the state; needs `rolls_back`.

        Args:
            state: earlier copy whose memory is reused.
        """
        raise NotImplementedError

    def restore(self, state: Any) -> None:
        """Restore a saved state."""
        raise NotImplementedError

    def forget(self, state: Any) -> None:  # noqa: B027 - only instances that save states need it
        """Free a saved state; never raises."""

    def prepare_checkpoints(self) -> None:  # noqa: B027 - most lose nothing in a checkpoint
        """Step from now on so that the results are the same after `serialize` and `deserialize`."""

    def serialize(self) -> bytes:
        """Return the state as bytes; needs `serializes`."""
        raise NotImplementedError

    def deserialize(self, content: bytes) -> None:
        """Restore a state from `serialize`, also from another process."""
        raise NotImplementedError

    def observe(self, names: Sequence[str], values: Vector) -> None:
        """Choose the numeric variables that `get_observed` reads, and where to."""
        if names:
            raise NotImplementedError

    def get_observed(self) -> None:  # noqa: B027 - only instances with a model description have any
        """Read the observed variables."""

    def observed_groups(self) -> Sequence[GroupCall]:
        """Return what the stepper needs to read the observed variables."""
        return []

    def entry_points(self) -> EntryPoints | None:
        """Return addresses for the stepper; None if there are none."""
        return None

    def error(self, call: str, status: int) -> RunError:
        """Return the error for an FMI call that the stepper made, with the status that it returned."""
        return InstanceError(self.name, call, f"status {status}", [])
