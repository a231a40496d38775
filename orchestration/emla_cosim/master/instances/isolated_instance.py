"""An FMU in a process of its own, which can end without ending the run's."""

import contextlib
import os
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from fmpy.model_description import ModelVariable

from ...base.arrays import Vector
from ...base.errors import CommandError, RunError
from ...fmu.file import FmuFile
from ...fmu.variables import TypedValue
from ...sandbox.black_box import BlackBoxFile
from ...sandbox.server import Server, ServerEndedError
from .call_codes import decode_call
from .described_instance import DescribedInstance
from .fmu_instance import InstanceError
from .request import Request

_TIMEOUT = 10.0
"""Seconds that an FMU has to terminate and to be freed."""


class ProcessEndedError(InstanceError):
    """An instance whose process is no more."""

    did = "ended its process in {call} ({status})"


class IsolatedInstance(DescribedInstance):
    """One instance of an FMU in a process of its own; see `FmuInstance` and `DescribedInstance`.

    Inputs travel with the next call, and outputs come back with a step, so that a step costs one
    exchange of messages.
    """

    steps_apart = True

    def __init__(self, name: str, file: FmuFile, inputs: Sequence[str], outputs: Sequence[str]) -> None:
        """Start the process, which goes on to instantiate the FMU; CommandError where it cannot start."""
        super().__init__(name, file, inputs, outputs)
        self._inputs_to_set: bytes | None = None
        self._slopes_to_set: bytes | None = None
        self._outputs_of_step: bytes | None = None
        self._end: InstanceError | None = None
        self._under_way = False
        try:
            with contextlib.ExitStack() as held:
                self._calls = held.enter_context(contextlib.closing(BlackBoxFile()))
                self._server = Server(f"{__package__}.worker", str(self._calls.path))
                held.pop_all()
        except OSError as error:
            raise CommandError(f"{name} cannot have a process of its own: {error.strerror}.") from error
        self._owner = os.getpid()
        self._send(Request("start", (name, file, list(inputs), list(outputs))))

    def ready(self) -> None:
        """Wait until the FMU is instantiated; CommandError where its library cannot be loaded."""
        self._receive()

    def set_start_values(self, values: Iterable[TypedValue]) -> None:
        """Set variables before initialization; InstanceError where the FMU refuses."""
        self._ask("set_values", [(str(variable.name), value) for variable, value in values])

    def set_value(self, variable: ModelVariable, value: Any) -> None:
        """Set one variable to a value of its type; InstanceError where the FMU refuses."""
        self.set_start_values([(variable, value)])

    def value(self, variable: ModelVariable) -> Any:
        """The present value of a variable that is no String: a number, or true or false."""
        return self._ask("value", str(variable.name))

    def reset(self) -> None:
        """Become as it was when it was new."""
        self._inputs_to_set = self._slopes_to_set = None
        self._ask("reset")
        self.inputs[:] = self._input_starts

    def enter_initialization(self, start_time: float, stop_time: float | None) -> None:
        """Enter initialization mode; times in s, no stop time where none is known yet."""
        self._ask("enter_initialization", start_time, stop_time)

    def exit_initialization(self) -> None:
        """Leave initialization mode."""
        self._ask("exit_initialization")

    def set_inputs(self) -> None:
        """Pass `inputs` on with the next call."""
        self._inputs_to_set, self._outputs_of_step = self.inputs.tobytes(), None

    def set_input_derivatives(self, derivatives: Vector) -> None:
        """Say with the next call how fast the inputs change during the next step, per s."""
        self._slopes_to_set = derivatives.tobytes()

    def get_outputs(self) -> None:
        """Read the FMU's outputs into `outputs`."""
        found = self._outputs_of_step or self._ask("outputs")
        self.outputs[:] = np.frombuffer(found)

    def do_step(self, time: float, step: float) -> None:
        """Advance from `time` by `step`, both in s."""
        self.begin_step(time, step)
        self.end_step()

    def begin_step(self, time: float, step: float) -> None:
        """Begin to advance from `time` by `step`, both in s."""
        self._request("do_step", (time, step))
        self._under_way = True

    def end_step(self) -> None:
        """Wait until the step is done."""
        self._under_way = False
        self._outputs_of_step = self._receive()

    def directional_derivative(self, direction: Vector) -> Vector | None:
        """How fast the outputs change at once when the inputs move in a direction."""
        return self._ask("directional_derivative", direction)

    def save(self, state: Any = None) -> Any:
        """A copy of the FMU's state, in the memory of an earlier one if given."""
        return self._ask("save", state)

    def restore(self, state: Any) -> None:
        """Go back to a saved state."""
        self._ask("restore", state)

    def forget(self, state: Any) -> None:
        """Free a saved state."""
        with contextlib.suppress(InstanceError):
            self._ask("forget", state)

    def serialize(self) -> bytes:
        """The FMU's state as bytes."""
        return self._ask("serialize")

    def deserialize(self, content: bytes) -> None:
        """Go to a state that was written by `serialize`."""
        self._ask("deserialize", content)

    def close(self) -> None:
        """Terminate the FMU where the standard allows it, free the instance, and end its process."""
        if os.getpid() != self._owner:  # this process divided from the one that has the FMU
            return
        with contextlib.suppress(Exception):
            self._ask("close", patience=_TIMEOUT)
        self._server.close(_TIMEOUT)
        self._calls.close()

    def _ask(self, call: str, *arguments: Any, patience: float | None = None) -> Any:
        """Let the FMU's process do a call, after it set what is still to be set."""
        self._request(call, arguments)
        return self._receive(patience)

    def _request(self, call: str, arguments: tuple[Any, ...]) -> None:
        if self._under_way:  # what goes on was given up, and its answer is of no use
            with contextlib.suppress(InstanceError):
                self.end_step()
        request = Request(call, arguments, self._inputs_to_set, self._slopes_to_set)
        self._inputs_to_set = self._slopes_to_set = self._outputs_of_step = None
        self._send(request)

    def _send(self, request: Request) -> None:
        if os.getpid() != self._owner:
            raise RunError(f"the FMU of {self.name} belongs to another process; prepare it in this one.")
        if self._end is not None:
            raise self._end
        try:
            self._server.send(request)
        except ServerEndedError as error:
            raise self._ended_error(str(error)) from error

    def _receive(self, patience: float | None = None) -> Any:
        try:
            answer = self._server.receive(patience)
        except ServerEndedError as error:
            raise self._ended_error(str(error)) from error
        except BaseException:
            self._ended_error("left")
            raise
        if isinstance(answer, Exception):
            raise answer
        return answer

    def _ended_error(self, how: str) -> InstanceError:
        """The error of a process that is no more; it is the answer to everything from now on."""
        call = decode_call(self._calls.present())[1]
        self._end = ProcessEndedError(self.name, call, how, [])
        return self._end
