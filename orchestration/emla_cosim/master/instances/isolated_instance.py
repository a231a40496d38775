"""Instances of FMUs in processes of their own: both sides of the pipe."""

import contextlib
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from fmpy.model_description import ModelVariable

from ...base import crash_page
from ...base.arrays import Vector
from ...base.channel import Channel
from ...base.crash_page import CrashPageFile
from ...base.errors import CommandError, CosimError, RunError
from ...base.process import Child, ChildEndedError
from ...fmu.cvode import IntegratorSettings
from ...fmu.file import FmuFile
from ...fmu.interface import MODEL_EXCHANGE
from ...fmu.log import FmuLog
from ...fmu.variables import TypedValue
from .described_instance import DescribedInstance, RejectedValue
from .fmu_instance import InstanceError
from .in_process_instance import InProcessInstance
from .instance_kinds import make_instance, make_stepped
from .measured_calls import Effort, MeasuredCalls, code_of, decode_call


class Request(NamedTuple):
    """A call by name; inputs and their slopes are set before it."""

    call: str
    arguments: tuple[Any, ...]
    inputs: bytes | None = None
    slopes: bytes | None = None


class IsolatedProcess:
    """Answer the requests of an `IsolatedInstance`: each method is one kind of request."""

    def __init__(self, instance: InProcessInstance) -> None:
        self._instance, self._stepped = instance, make_stepped(instance)
        self._states: dict[int, Any] = {}
        self._observed = np.empty(0)
        self._measured: MeasuredCalls | None = None

    def do(self, request: Request) -> Any:
        """Set inputs and slopes, then call the method of this name and return its result."""
        if request.inputs is not None:
            self._stepped.inputs[:] = np.frombuffer(request.inputs)
            self._stepped.set_inputs()
        if request.slopes is not None:
            self._stepped.set_input_derivatives(np.frombuffer(request.slopes))
        owners = (self, self._stepped, self._instance)
        owner = next(owner for owner in owners if hasattr(owner, request.call))
        return getattr(owner, request.call)(*request.arguments)

    def set_start_values(self, values: list[tuple[str, Any]]) -> None:
        """Set start values by name."""
        variables = self._instance.file.variables
        self._instance.set_start_values((variables[name], value) for name, value in values)

    def close(self) -> None:
        """Free the FMU and its integrator."""
        self._instance.close()
        if self._stepped is not self._instance:
            self._stepped.close()

    def enter_initialization(
        self, start_time: float, stop_time: float | None, tolerance: float | None
    ) -> None:
        """Enter initialization mode; times in s, None without a fixed stop time or tolerance."""
        self._instance.tolerance = tolerance
        self._stepped.enter_initialization(start_time, stop_time)

    def exit_initialization(self) -> list[RejectedValue]:
        """Leave initialization mode, and return the start values that the FMU changed."""
        self._stepped.exit_initialization()
        return self._instance.rejected_start_values

    def set_value(self, name: str, value: Any) -> None:
        """Set a variable by name."""
        self._instance.set_value(self._instance.file.variables[name], value)

    def value(self, name: str) -> Any:
        """Return the value of a variable."""
        return self._instance.value(self._instance.file.variables[name])

    def outputs(self) -> bytes:
        """Read all outputs, and return them as bytes."""
        self._stepped.get_outputs()
        return self._stepped.outputs.tobytes()

    def observe(self, names: list[str]) -> None:
        """Choose the variables that `observed` reads."""
        self._observed = np.zeros(len(names))
        self._instance.observe(names, self._observed)

    def observed(self) -> bytes:
        """Read the observed variables, and return them as bytes."""
        self._instance.get_observed()
        return self._observed.tobytes()

    def do_step(self, at: float, step: float) -> tuple[bytes, bytes, list[str]]:
        """Do a step; return outputs and observed variables after it, and all violations of this run."""
        self._stepped.do_step(at, step)
        return self.outputs(), self.observed(), self.violations()

    def violations(self) -> list[str]:
        """Return the violations of the standard in this run that were accepted."""
        return self._instance.violations

    def measure(self, on: bool) -> None:
        """Measure the FMU's calls from now on, or stop."""
        if self._measured is not None:
            self._measured.close()
        self._measured = MeasuredCalls(self._stepped) if on else None

    def read_effort(self) -> Effort:
        """Return the measured calls."""
        effort = Effort()
        if self._measured is not None:
            self._measured.add_to(effort)
        return effort

    def save(self, number_to_reuse: int | None) -> int:
        """Save the state and return its number; `number_to_reuse` is a number to overwrite."""
        number = number_to_reuse if number_to_reuse is not None else max(self._states, default=0) + 1
        self._states[number] = self._stepped.save(self._states.get(number))
        return number

    def restore(self, number: int) -> None:
        """Restore a saved state."""
        self._stepped.restore(self._states[number])

    def forget(self, number: int) -> None:
        """Free a saved state."""
        self._stepped.forget(self._states.pop(number))


def serve(channel: Channel, page: Path) -> None:
    """Answer the requests of an `IsolatedInstance`, and share the crash page with its process."""
    crash_page.share_file(page)
    worker: IsolatedProcess | None = None
    for request in channel.requests():
        try:
            if worker is not None:
                answer = worker.do(request)
            else:
                answer: Any = None
                name, file, inputs, outputs = request.arguments
                worker = IsolatedProcess(make_instance(name, file, inputs, outputs, FmuLog()))
        except CosimError as error:
            answer = error
        # the parent waits for an answer, whatever happens
        except Exception as error:
            answer = RunError(f"the process of an isolated FMU failed: {error!r}.")
        channel.send(answer)


_TIMEOUT = 10.0
"""Seconds that an FMU has to terminate and to free its memory."""

_FMI_CALLS = {
    "enter_initialization": "enterInitializationMode",
    "exit_initialization": "exitInitializationMode",
    "outputs": "getReal",
}
"""FMI functions of the requests that can take long, besides steps."""


class ProcessEndedError(InstanceError):
    """The process of an isolated instance ended."""

    action_format = "ended its process in {call} ({status})"


class IsolatedInstance(DescribedInstance):
    """One instance of an FMU in a process of its own; see `FmuInstance` and `DescribedInstance`.

    Inputs are sent with the next call, and outputs return with a step, so that a step needs one
    exchange of messages.
    """

    steps_apart = True

    def __init__(
        self, name: str, file: FmuFile, inputs: Sequence[str], outputs: Sequence[str], number: int = 0
    ) -> None:
        """Start the process, and instantiate the FMU there; CommandError if the process cannot start.

        `number` is the number of the instance in `crash_page`.
        """
        super().__init__(name, file, inputs, outputs)
        self._inputs_to_set: bytes | None = None
        self._slopes_to_set: bytes | None = None
        self._outputs_of_step: bytes | None = None
        self._observed_of_step: bytes | None = None
        self._observed: Vector = np.empty(0)
        self._end_error: InstanceError | None = None
        self._violations = list[str]()
        self._present, self._number = crash_page.current_activity(), number
        try:
            with contextlib.ExitStack() as resources:
                self._calls = resources.enter_context(contextlib.closing(CrashPageFile()))
                self._process = Child(f"{__name__}:serve", self._calls.path)
                resources.pop_all()
        except OSError as error:
            raise CommandError(f"the process of {name} cannot start: {error.strerror}.") from error
        self._owner = os.getpid()
        self._send(Request("start", (name, file, list(inputs), list(outputs))))

    @property
    def violations(self) -> list[str]:
        """Violations of the standard in this run that were accepted."""
        return self._violations

    def wait_until_ready(self) -> None:
        """Wait until the FMU is instantiated; CommandError if its library cannot be loaded."""
        self._receive()

    def set_start_values(self, values: Iterable[TypedValue]) -> None:
        """Set variables in each initialization from now on, after `fmi2SetupExperiment`."""
        self._ask("set_start_values", [(str(variable.name), value) for variable, value in values])

    def set_value(self, variable: ModelVariable, value: Any) -> None:
        """Set one variable to a value of its type; InstanceError if the FMU rejects it."""
        self._ask("set_value", str(variable.name), value)

    def value(self, variable: ModelVariable) -> Any:
        """Return the present value of a variable."""
        return self._ask("value", str(variable.name))

    def use_integrator(self, settings: IntegratorSettings) -> None:
        """Integrate a Model Exchange FMU with these settings from the next initialization on."""
        if self.file.kind == MODEL_EXCHANGE:
            self._ask("use_integrator", settings)

    def prepare_checkpoints(self) -> None:
        """Step from now on so that the results are the same after `serialize` and `deserialize`."""
        self._ask("prepare_checkpoints")

    def reset(self) -> None:
        """Return to the state right after instantiation."""
        self._inputs_to_set = self._slopes_to_set = None
        self._ask("reset")
        self._violations = []
        self.inputs[:] = self.input_starts

    def enter_initialization(self, start_time: float, stop_time: float | None) -> None:
        """Enter initialization mode; times in s, None without a fixed stop time."""
        self._ask("enter_initialization", start_time, stop_time, self.tolerance)

    def exit_initialization(self) -> None:
        """Leave initialization mode, and find the start values that the FMU changed."""
        self.rejected_start_values = self._ask("exit_initialization")

    def set_inputs(self) -> None:
        """Send `inputs` with the next call."""
        self._inputs_to_set = self.inputs.tobytes()
        self._outputs_of_step = self._observed_of_step = None

    def set_input_derivatives(self, derivatives: Vector) -> None:
        """Send the slopes of the inputs, per s, with the next call."""
        self._slopes_to_set = derivatives.tobytes()

    def get_outputs(self) -> None:
        """Read the FMU's outputs into `outputs`."""
        # a step has returned them already
        content = self._outputs_of_step or self._ask("outputs")
        self.outputs[:] = np.frombuffer(content)

    def observe(self, names: Sequence[str], values: Vector) -> None:
        """Choose the numeric variables that `get_observed` reads, and where to."""
        self._observed = values
        self._ask("observe", list(names))

    def get_observed(self) -> None:
        """Read the observed variables."""
        content = self._observed_of_step or self._ask("observed")
        self._observed[:] = np.frombuffer(content)

    def do_step(self, time: float, step: float) -> None:
        """Advance from `time` by `step`, both in s."""
        self.begin_step(time, step)
        self.end_step()

    def begin_step(self, time: float, step: float) -> None:
        """Begin to advance from `time` by `step`, both in s."""
        self._present.time = time
        self._request("do_step", (time, step))
        self.is_under_way = True

    def end_step(self) -> None:
        """Wait until the step is done."""
        self.is_under_way = False
        try:
            self._outputs_of_step, self._observed_of_step, self._violations = self._receive(call="doStep")
        except RunError:
            with contextlib.suppress(InstanceError):  # violations often explain the failure
                self._violations = self._ask("violations")
            raise

    def directional_derivative(self, direction: Vector) -> Vector | None:
        """Return the derivative of the outputs along a direction of the inputs; None if the FMU has none."""
        return self._ask("directional_derivative", direction)

    def save(self, state: Any = None) -> Any:
        """Save the FMU's state in its process and return its number; `state` is a number to overwrite."""
        return self._ask("save", state)

    def restore(self, state: Any) -> None:
        """Restore a saved state."""
        self._ask("restore", state)

    def forget(self, state: Any) -> None:
        """Free a saved state."""
        with contextlib.suppress(InstanceError):
            self._ask("forget", state)

    def serialize(self) -> bytes:
        """Return the FMU's state as bytes."""
        return self._ask("serialize")

    def deserialize(self, content: bytes) -> None:
        """Restore a state from the bytes of `serialize`."""
        self._ask("deserialize", content)

    def measure(self, on: bool = True) -> None:
        """Measure the FMU's calls in its process from now on, or stop. An ended process does nothing."""
        with contextlib.suppress(InstanceError):
            self._ask("measure", on)

    def read_effort(self) -> Effort | None:
        """Return the measured calls in its process; None if the process has ended."""
        try:
            return self._ask("read_effort")
        except InstanceError:
            return None

    def close(self) -> None:
        """Terminate the FMU if the standard allows it, free the instance, and end its process."""
        if os.getpid() != self._owner:  # this process is a fork of the one that owns the FMU
            return
        with contextlib.suppress(Exception):
            self._ask("close", timeout=_TIMEOUT)
        self._process.close(_TIMEOUT)
        self._calls.close()

    def _ask(self, call: str, *arguments: Any, timeout: float | None = None) -> Any:
        """Send a call with the pending inputs, and return its result."""
        self._request(call, arguments)
        return self._receive(timeout, _FMI_CALLS.get(call, ""))

    def _request(self, call: str, arguments: tuple[Any, ...]) -> None:
        """Send a call with the pending inputs and slopes; `_receive` waits for the answer."""
        if self.is_under_way:  # an interrupted step: wait for its end and discard the result
            with contextlib.suppress(InstanceError):
                self.end_step()
        request = Request(call, arguments, self._inputs_to_set, self._slopes_to_set)
        self._inputs_to_set = self._slopes_to_set = None
        self._outputs_of_step = self._observed_of_step = None
        self._send(request)

    def _send(self, request: Request) -> None:
        """Send a request; RunError in a fork of this process, InstanceError if the FMU's process ended."""
        if os.getpid() != self._owner:
            raise RunError(f"the FMU of {self.name} belongs to another process. Prepare it in this process.")
        if self._end_error is not None:
            raise self._end_error
        try:
            self._process.send(request)
        except ChildEndedError as error:
            raise self._make_ended_error(str(error)) from error

    def _receive(self, timeout: float | None = None, call: str = "") -> Any:
        """Wait for the answer to a request, with the FMI call in the black box meanwhile."""
        if call:
            self._present.code = code_of(self._number, call)
        try:
            answer = self._process.receive(timeout)
        except ChildEndedError as error:
            raise self._make_ended_error(str(error)) from error
        except KeyboardInterrupt as error:  # a second Ctrl-C ends a call that never returns
            self._process.kill()
            raise self._make_ended_error("interrupted") from error
        except BaseException:  # a late answer must not count as that of the next request
            self._process.kill()
            self._make_ended_error("its answer was not awaited")
            raise
        finally:
            self._present.code = 0
        if isinstance(answer, Exception):
            raise answer
        return answer

    def _make_ended_error(self, reason: str) -> InstanceError:
        """Return the error for an ended process. All later calls raise it, too."""
        call = decode_call(self._calls.activity())[1]
        self._end_error = ProcessEndedError(self.name, call, reason, [])
        return self._end_error
