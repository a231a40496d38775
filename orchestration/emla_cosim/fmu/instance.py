"""One instance of an FMI 2.0 FMU in this process, called through fmpy."""

import contextlib
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from ctypes import byref, c_int
from pathlib import Path
from typing import Any

from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Model, FMU2Slave, fmi2Terminated
from fmpy.model_description import ModelVariable

from ..base.files import restore_working_folder
from .variables import TypedValue

STATUS = ("fmi2OK", "fmi2Warning", "fmi2Discard", "fmi2Error", "fmi2Fatal", "fmi2Pending")
OK, WARNING, DISCARD, ERROR, FATAL, PENDING = range(6)
FINE = (OK, WARNING)

_WITHOUT_STATUS = ("fmi2GetTypesPlatform", "fmi2GetVersion", "fmi2Instantiate", "fmi2FreeInstance")


class FmiInstance(ABC):
    """An instance of an FMU; a class derived from it says what it does with calls and refusals.

    `fmu` is fmpy's object, for calls that have no method here: `with instance.calling(): ...` turns
    what it raises into the error of the instance.
    """

    name: str
    fmu: Any

    @abstractmethod
    def announce(self, function: str, arguments: Sequence[Any] = ()) -> None:
        """Take note of what is called next."""

    def returned(self) -> None:  # noqa: B027 - needed only where the last call is not to be remembered
        """Take note that the call has returned."""

    @abstractmethod
    def error(self, call: str, status: int) -> Exception:
        """Return the error of a call that returned this status."""

    @contextlib.contextmanager
    def calling(self, call: str | None = None) -> Iterator[None]:
        """Turn what fmpy raises for a status worse than a warning into the error of this call."""
        try:
            yield
        except FMICallException as error:
            raise self.error(call or str(error.function), int(error.status)) from error

    def status(self, name: str, *arguments: Any) -> int:
        """Call a function of the FMI by its name, component first; return its status, whatever it is."""
        try:
            answer = getattr(self.fmu, name)(self.fmu.component, *arguments)
        except FMICallException as error:
            return int(error.status)
        return int(answer or 0)

    def enter_initialization(self, start_time: float, stop_time: float | None = None) -> None:
        """Set up the experiment, and enter initialization mode; times in s."""
        with self.calling():
            self.fmu.setupExperiment(startTime=start_time, stopTime=stop_time)
            self.fmu.enterInitializationMode()

    def exit_initialization(self) -> None:
        """Leave initialization mode."""
        with self.calling():
            self.fmu.exitInitializationMode()

    def set_typed(self, values: Sequence[TypedValue]) -> None:
        """Set variables, those of one type in one call, in the order given; raises what fmpy does."""
        for kind, positions in by_type([variable for variable, _ in values]):
            references = [values[i][0].valueReference for i in positions]
            getattr(self.fmu, f"set{kind}")(references, [values[i][1] for i in positions])

    def get_typed(self, variables: Sequence[ModelVariable]) -> list[Any]:
        """Return values of variables, those of one type got in one call; raises what fmpy does."""
        found: list[Any] = [None] * len(variables)
        for kind, positions in by_type(variables):
            got = getattr(self.fmu, f"get{kind}")([variables[i].valueReference for i in positions])
            for i, value in zip(positions, got, strict=True):
                found[i] = value
        return found

    def asks_to_end(self) -> bool:
        """Whether the FMU discarded a step because it wants the run to end."""
        answer = c_int(0)
        asked = self.status("fmi2GetBooleanStatus", fmi2Terminated, byref(answer))
        return asked == OK and bool(answer.value)

    def reset(self) -> None:
        """Become as it was when it was new."""
        with self.calling():
            self.fmu.reset()

    def free(self) -> None:
        """Free it without terminating it; the library stays loaded."""
        self.fmu.fmi2FreeInstance(self.fmu.component)


class _Announced:
    """Announces each call, and takes no answer for fine that is no status."""

    instance: FmiInstance

    def _call(self, fname: str, *args: Any) -> Any:
        self.instance.announce(fname, args)
        try:
            answer = super()._call(fname, *args)  # type: ignore[misc]
        finally:
            self.instance.returned()
        if fname not in _WITHOUT_STATUS and answer not in FINE:
            raise FMICallException(fname, answer)
        return answer


class FMU2AnnouncedSlave(_Announced, FMU2Slave):
    """fmpy's slave; the beginning of its name tells fmpy which functions to load."""


class FMU2AnnouncedModel(_Announced, FMU2Model):
    """fmpy's model for Model Exchange."""


def load(kind: str, library: Path, folder: Path, identifier: str, guid: str | None) -> Any:
    """Load the library of an FMU, and return fmpy's object for an instance, of which nothing is called yet.

    `kind` is `CoSimulation` or `ModelExchange`. Whoever makes an instance with the object sets its
    `instance` and `instanceName`. Raises what fmpy raises where the library cannot be loaded.
    """
    made = FMU2AnnouncedSlave if kind == "CoSimulation" else FMU2AnnouncedModel
    with restore_working_folder():  # fmpy goes to the library's folder
        return made(
            guid=guid, unzipDirectory=str(folder), modelIdentifier=identifier, libraryPath=str(library)
        )


def kind_of(variable: ModelVariable) -> str:
    """Return the type of a variable as the names of the FMI functions have it."""
    return "Integer" if variable.type == "Enumeration" else str(variable.type)


def by_type(variables: Sequence[ModelVariable]) -> Iterator[tuple[str, list[int]]]:
    """Yield types, as the names of the FMI functions have them, with the positions of their variables."""
    kinds = [kind_of(v) for v in variables]
    for kind in dict.fromkeys(kinds):
        yield kind, [i for i, k in enumerate(kinds) if k == kind]
