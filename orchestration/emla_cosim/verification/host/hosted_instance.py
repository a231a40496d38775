"""One instance of an FMU. Every call is noted before and checked after."""

import time as clock
from collections.abc import Iterable, Mapping, Sequence
from ctypes import byref, c_int, c_size_t
from typing import Any

from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import fmi2DoStepStatus

from ...fmu.instance import DISCARD, ERROR, FINE, PENDING, STATUS, WARNING, FmiInstance, load
from ...fmu.log import LogLine
from ..subject import Subject
from ..subprocess_run import note
from .integration import Integration
from .log import LOG, format_message

_LARGEST_STATE = 2**28
"""Largest plausible size of a state in bytes."""


class CallError(Exception):
    """A call that failed. Message: `fmi2DoStep at t = 1 s answered fmi2Error: ...`."""

    def __init__(self, call: str, status: int, lines: Iterable[LogLine] = ()) -> None:
        said = " ".join(line.text for line in list(lines)[-2:])
        self.call, self.status = call, status
        name = STATUS[status] if self.has_status else f"{status}, which is not a valid status"
        super().__init__(f"{call} answered {name}{f': {format_message(said)}' if said else '.'}")

    @property
    def has_status(self) -> bool:
        """Whether the answer is one of the statuses of the standard."""
        return 0 <= self.status < len(STATUS)

    def __reduce__(self) -> Any:
        """Pickle the message instead of the log lines."""
        return _rebuild_error, (str(self), self.call, self.status)


def _rebuild_error(sentence: str, call: str, status: int) -> CallError:
    error = CallError(call, status)
    error.args = (sentence,)
    return error


class HostedInstance(FmiInstance):
    """An instance, from its instantiation until `close`. Its name must be unique in the process.

    `kind` is `CoSimulation` or `ModelExchange`; default: the first kind of the FMU. `terminated` is true
    after the FMU asked to end the run. `circumstance` is added to the note of every call: ` with u = nan`.
    """

    circumstance = ""

    def __init__(
        self,
        subject: Subject,
        name: str = "examined",
        kind: str | None = None,
        logging: bool = False,
        guid: str | None = None,
    ) -> None:
        """Load the library and instantiate. Raise CallError on failure."""
        self.subject, self.name = subject, name
        self.kind = kind or subject.kinds[0]
        library = subject.library(self.kind)
        note("loading its library")
        try:
            assert library is not None, "There is no library for this machine."
            self.fmu = load(
                self.kind,
                library,
                subject.folder,
                subject.find_kind_element(self.kind).modelIdentifier,
                subject.description.guid if guid is None else guid,
            )
        except Exception as error:  # fmpy raises bare ones
            raise _rebuild_error(
                f"Its library cannot be loaded: {format_message(str(error))}", "dlopen", ERROR
            ) from error
        self.fmu.instance, self.fmu.instanceName = self, name
        self._integration = Integration(self.fmu, subject) if self.kind == "ModelExchange" else None
        self.instantiate(logging)

    def instantiate(self, logging: bool = False) -> None:
        """Instantiate again after `free`, with the loaded library."""
        self.terminated = False
        try:
            self.fmu.instantiate(callbacks=LOG.callbacks, loggingOn=logging)
        except Exception as error:  # fmpy raises a bare one for NULL
            raise _null(LOG.of(self.name)) from error

    def announce(self, function: str, arguments: Sequence[Any] = ()) -> None:
        """Note the next call."""
        at = f" at t = {arguments[1]:.9g} s" if function == "fmi2DoStep" else ""
        note(f"{function}{at}{self.circumstance}")

    def error(self, call: str, status: int) -> CallError:
        """Return the error for a call with this status."""
        return CallError(call, status, LOG.of(self.name, WARNING))

    def serialize(self, state: Any) -> bytes | int:
        """Return the bytes of a state, or the size that the FMU reports if it is not plausible."""
        size = c_size_t()
        self.fmu.fmi2SerializedFMUstateSize(self.fmu.component, state, byref(size))
        return self.fmu.serializeFMUstate(state) if 0 < size.value <= _LARGEST_STATE else size.value

    def initialize(
        self, values: Mapping[str, Any] | None = None, start: float = 0.0, stop: float | None = None
    ) -> None:
        """Set up the experiment, set values by name, and go through initialization mode."""
        tolerance = self.subject.interface.tolerance
        self.begin_initialization(start, stop, tolerance, lambda: self.set(values or {}))
        self.exit_initialization()

    def exit_initialization(self) -> None:
        """Leave initialization mode. For Model Exchange, handle the first events and stay in event mode."""
        super().exit_initialization()
        if self._integration is not None:
            with self.calling():
                self._integration.begin()
            self.terminated = self._integration.terminated

    def set(self, values: Mapping[str, Any]) -> None:
        """Set variables by name, in this order, with one call for each type."""
        with self.calling():
            self.set_typed([(self.subject.variables[name], value) for name, value in values.items()])

    def get(self, names: Iterable[str]) -> list[Any]:
        """Return the values of variables by name, with one call for each type, and for each String.

        If all Strings of a call are in one buffer, only the check of Strings fails.
        """
        variables = [self.subject.variables[name] for name in names]
        with self.calling():
            others = iter(self.get_typed([v for v in variables if v.type != "String"]))
            return [self.get_typed([v])[0] if v.type == "String" else next(others) for v in variables]

    def get_together(self, names: Iterable[str]) -> list[Any]:
        """Return the values of variables by name, with one call for each type."""
        with self.calling():
            return self.get_typed([self.subject.variables[name] for name in names])

    def step(self, time: float, length: float) -> None:
        """Step from `time` by `length`, both in s. Raise CallError also for a discarded step.

        For Model Exchange, integrate, from event mode to event mode.
        """
        with self.calling():
            if self._integration is not None:
                self._integrate(self._integration, time, length)
                return
            try:
                self.fmu.doStep(time, length, noSetFMUStatePriorToCurrentPoint=0)
            except FMICallException as error:
                if error.status == PENDING and self.subject.has_capability("canRunAsynchronuously"):
                    self._wait()
                elif error.status == DISCARD and self.asks_to_end():
                    self.terminated = True
                else:
                    raise self.error(f"fmi2DoStep at t = {time:.9g} s", error.status) from error

    def _integrate(self, integration: Integration, time: float, length: float) -> None:
        try:
            integration.step(time, length)
        except RuntimeError as error:  # of the solver
            sentence = (
                f"The model cannot be integrated from t = {time:.9g} s on: {format_message(str(error))}"
            )
            raise _rebuild_error(sentence, "the solver", ERROR) from error
        self.terminated = integration.terminated

    def _wait(self) -> None:
        """Wait until a pending step is completed."""
        answer = c_int(PENDING)
        while answer.value == PENDING:
            clock.sleep(0.001)
            self.fmu.fmi2GetStatus(self.fmu.component, fmi2DoStepStatus, byref(answer))
        if answer.value not in FINE:
            raise FMICallException("fmi2DoStep", answer.value)

    def reset(self) -> None:
        """Reset the instance to its initial state."""
        super().reset()
        self.terminated = False

    def close(self) -> None:
        """Terminate and free the instance. The library stays loaded."""
        with self.calling():
            self.fmu.terminate()
        self.free()
        if self._integration is not None:
            self._integration.close()

    def reference(self, name: str) -> int:
        """Return the value reference of a variable."""
        return self.subject.variables[name].valueReference


def _null(lines: Iterable[LogLine]) -> CallError:
    """Return the error for a failed instantiation, with the last log messages."""
    said = " ".join(line.text for line in list(lines)[-2:])
    error = CallError("fmi2Instantiate", ERROR)
    error.args = (f"fmi2Instantiate answered NULL{f': {format_message(said)}' if said else '.'}",)
    return error
