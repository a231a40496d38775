"""The interface of FMU instances for algorithms."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Vector
from ...base.errors import RunError


class InstanceError(RunError):
    """A call of an instance failed.

    Args:
        instance: Name of the instance.
        call: The FMI function or action.
        status: What the call returned.
        log: Messages of the instance.
    """

    did = "answered {call} with {status}"

    def __init__(self, instance: str, call: str, status: str, log: list[str]) -> None:
        did = self.did.format(call=call, status=status)
        said = f" It said: {' '.join(log)}" if log else ""
        super().__init__(f"{instance} {did}.{said}", component=instance, call=call, status=status, log=log)


class DiscardedStepError(InstanceError):
    """The instance discarded a step; a shorter step from an earlier state may succeed."""


class EndRequestedError(InstanceError):
    """The instance requested the end of the simulation."""

    did = "asked to end the simulation during {call}"


@dataclass(frozen=True)
class EntryPoints:
    """Addresses that compiled code needs to call an instance through FMI functions.

    `component` is the instance (`fmi2Component`); the functions are in its library. There is one value
    reference per element of `inputs` and `outputs`.
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


class FmuInstance(ABC):
    """A co-simulation instance that exchanges two preallocated vectors.

    `inputs` holds the values of its connected inputs until `set_inputs` passes them on.
    `get_outputs` writes to `outputs`, a part of the network's signals. `bind` connects both to memory
    of the network. Every method may raise InstanceError.

    Attributes:
        name: Name of the component.
        inputs: Values of the connected inputs.
        outputs: Values of the outputs.
        continuous_inputs: Whether each input is continuous.
        continuous_outputs: Whether each output is continuous.
        nominals: Nominal value of each output.
        varies_step: Whether steps may have any length.
        rolls_back: Whether it can save and restore its state.
        serializes: Whether it can write its state as bytes.
        interpolates: Whether it accepts derivatives of its inputs.
        differentiates: Whether it provides directional derivatives.
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
    runs_beside_others = True
    """Whether other threads may call other instances at the same time."""

    def reset(self) -> None:
        """Return to the state right after instantiation."""
        raise NotImplementedError

    @abstractmethod
    def enter_initialization(self, start_time: float, stop_time: float | None) -> None:
        """Enter initialization mode; times in s, None without a fixed stop time."""

    @abstractmethod
    def exit_initialization(self) -> None:
        """Leave initialization mode: the instance is ready to step."""

    @abstractmethod
    def set_inputs(self) -> None:
        """Pass `inputs` to the FMU."""

    @abstractmethod
    def get_outputs(self) -> None:
        """Read the FMU's outputs into `outputs`."""

    @abstractmethod
    def do_step(self, time: float, step: float) -> None:
        """Advance from `time` by `step`, both in s; DiscardedStepError if the FMU discards the step."""

    def begin_step(self, time: float, step: float) -> None:
        """Begin a step; needs `steps_apart`. Call nothing else before `end_step`."""
        raise NotImplementedError

    def end_step(self) -> None:
        """Wait for the end of the step; raises the errors of `do_step`."""
        raise NotImplementedError

    @abstractmethod
    def close(self) -> None:
        """Free the instance; never raises."""

    def bind(self, inputs: Vector, outputs: Vector) -> None:
        """Use this memory for inputs and outputs, and copy the present inputs to it."""
        inputs[:] = self.inputs
        self.inputs, self.outputs = inputs, outputs

    def set_input_derivatives(self, derivatives: Vector) -> None:
        """Set the slopes of the inputs during the next step, per s; needs `interpolates`."""
        raise NotImplementedError

    def directional_derivative(self, direction: Vector) -> Vector | None:
        """Return the derivative of the outputs along a direction of the inputs; needs `differentiates`.

        Returns None if the FMU cannot compute it at this point.
        """
        raise NotImplementedError

    def save(self, state: Any = None) -> Any:
        """Return a copy of the FMU's state, in the memory of the earlier copy `state`; needs `rolls_back`."""
        raise NotImplementedError

    def restore(self, state: Any) -> None:
        """Restore a saved state."""
        raise NotImplementedError

    def forget(self, state: Any) -> None:  # noqa: B027 - only instances that save states need it
        """Free a saved state; never raises."""

    def serialize(self) -> bytes:
        """Return the FMU's state as bytes; needs `serializes`."""
        raise NotImplementedError

    def deserialize(self, content: bytes) -> None:
        """Restore a state from the bytes of `serialize`, also from another process."""
        raise NotImplementedError

    def entry_points(self) -> EntryPoints | None:
        """Return addresses for compiled code; None if the instance cannot be called from there."""
        return None

    def error(self, call: str, status: int) -> InstanceError:
        """Return the error for an FMI call from compiled code that returned this status."""
        return InstanceError(self.name, call, f"status {status}", [])
