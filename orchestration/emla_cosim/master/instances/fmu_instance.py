"""What an algorithm sees of a component, whatever is behind it."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Vector
from ...base.errors import RunError


class InstanceError(RunError):
    """A call that the instance refused or failed: which one, and what the instance said."""

    did = "answered {call} with {status}"

    def __init__(self, instance: str, call: str, status: str, log: list[str]) -> None:
        did = self.did.format(call=call, status=status)
        said = f" It said: {' '.join(log)}" if log else ""
        super().__init__(f"{instance} {did}.{said}", component=instance, call=call, status=status, log=log)


class DiscardedStepError(InstanceError):
    """A step that the instance could not do; from an earlier state a shorter one may succeed."""


class EndRequestedError(InstanceError):
    """An instance that wants the simulation to end here."""

    did = "asked to end the simulation during {call}"


@dataclass(frozen=True)
class EntryPoints:
    """Addresses that compiled code needs to call an instance through the FMI.

    `component` is the instance, the functions are those of its library, and value references
    are 32-bit numbers, one per element of `inputs` and `outputs`.
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

    `inputs` holds the values of its connected inputs until `set_inputs` passes them on;
    `get_outputs` writes to `outputs`, a part of the network's signals. Both are bound to memory
    of the network by `bind`. Every method may raise InstanceError.

    `continuous_inputs` and `continuous_outputs` say which elements change smoothly, and
    `nominals` gives the usual size of each output. The flags say what the instance is able to do:
    steps of any length, going back to a saved state, writing a state as bytes, taking
    derivatives of its inputs, and giving those of its outputs.
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
    """Whether its steps can be begun and ended, so that others can step meanwhile."""
    runs_beside_others = True
    """Whether its calls may be made while another thread calls other instances of its kind."""

    def reset(self) -> None:
        """Become as it was when it was new; needs nothing to be set or stepped before."""
        raise NotImplementedError

    @abstractmethod
    def enter_initialization(self, start_time: float, stop_time: float | None) -> None:
        """Enter initialization mode; times in s, no stop time where none is known yet."""

    @abstractmethod
    def exit_initialization(self) -> None:
        """Leave initialization mode: the instance is ready to step."""

    @abstractmethod
    def set_inputs(self) -> None:
        """Pass `inputs` on to the instance."""

    @abstractmethod
    def get_outputs(self) -> None:
        """Read the instance's outputs into `outputs`."""

    @abstractmethod
    def do_step(self, time: float, step: float) -> None:
        """Advance from `time` by `step`, both in s; StepDiscardedError where it could not."""

    def begin_step(self, time: float, step: float) -> None:
        """Begin to advance, if the instance `steps_apart`; nothing else is called before `end_step`."""
        raise NotImplementedError

    def end_step(self) -> None:
        """Wait until the step that was begun is done; raises what `do_step` does."""
        raise NotImplementedError

    @abstractmethod
    def close(self) -> None:
        """Free the instance; never raises."""

    def bind(self, inputs: Vector, outputs: Vector) -> None:
        """Use this memory from now on; values of the inputs are kept."""
        inputs[:] = self.inputs
        self.inputs, self.outputs = inputs, outputs

    def set_input_derivatives(self, derivatives: Vector) -> None:
        """Say how fast the inputs change during the next step, per s; needs `interpolates`."""
        raise NotImplementedError

    def directional_derivative(self, direction: Vector) -> Vector | None:
        """How fast the outputs change at once when the inputs move in a direction; needs `differentiates`.

        None where the instance cannot say it here.
        """
        raise NotImplementedError

    def save(self, state: Any = None) -> Any:
        """A copy of the instance's state, in the memory of an earlier one if given; needs `rolls_back`."""
        raise NotImplementedError

    def restore(self, state: Any) -> None:
        """Go back to a saved state."""
        raise NotImplementedError

    def forget(self, state: Any) -> None:  # noqa: B027 - needed only where states are saved
        """Free a saved state; never raises."""

    def serialize(self) -> bytes:
        """The instance's state as bytes; needs `serializes`."""
        raise NotImplementedError

    def deserialize(self, content: bytes) -> None:
        """Go to a state that was written by `serialize`, perhaps by another process."""
        raise NotImplementedError

    def entry_points(self) -> EntryPoints | None:
        """Addresses for compiled code; None where the instance has none."""
        return None

    def error(self, call: str, status: int) -> InstanceError:
        """The error of an FMI call that compiled code made."""
        return InstanceError(self.name, call, f"status {status}", [])
