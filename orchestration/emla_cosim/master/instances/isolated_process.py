"""The process of one isolated FMU. It answers requests until its parent ends."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...base import crash_page
from ...base.channel import Channel
from ...base.errors import CosimError, RunError
from ...fmu.log import FmuLog
from .in_process_instance import InProcessInstance
from .instance_kinds import make_instance, make_stepped
from .measured_calls import Effort, MeasuredCalls
from .start_values import RejectedValue


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
        """Set inputs and slopes, then do the call and return its result."""
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
        """Read all outputs."""
        self._stepped.get_outputs()
        return self._stepped.outputs.tobytes()

    def observe(self, names: list[str]) -> None:
        """Choose the variables that `observed` reads."""
        self._observed = np.zeros(len(names))
        self._instance.observe(names, self._observed)

    def observed(self) -> bytes:
        """Read the observed variables."""
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
