"""One instance of an FMU: every call is noted before it is made, and checked after it."""

import contextlib
import time as clock
from collections.abc import Iterable, Iterator, Mapping
from ctypes import byref, c_int
from typing import Any

from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Model, FMU2Slave, fmi2DoStepStatus, fmi2Terminated

from ..apart import note
from ..subject import Subject
from .integration import Integration
from .log import LOG, Line, whole

STATUS = ("fmi2OK", "fmi2Warning", "fmi2Discard", "fmi2Error", "fmi2Fatal", "fmi2Pending")
OK, WARNING, DISCARD, ERROR, FATAL, PENDING = range(6)
_WITHOUT_STATUS = ("fmi2GetTypesPlatform", "fmi2GetVersion", "fmi2Instantiate", "fmi2FreeInstance")


class CallError(Exception):
    """A call that was refused, as a sentence: `fmi2DoStep at t = 1 s answered fmi2Error: ...`."""

    def __init__(self, call: str, status: int, lines: Iterable[Line] = ()) -> None:
        said = " ".join(line.text for line in list(lines)[-2:])
        name = STATUS[status] if 0 <= status < len(STATUS) else f"{status}, which is no status"
        super().__init__(f"{call} answered {name}{f': {whole(said)}' if said else '.'}")
        self.call, self.status = call, status

    def __reduce__(self) -> Any:
        """Its sentence goes with it to another process, not the lines that it was made of."""
        return _told_again, (str(self), self.call, self.status)


def _told_again(sentence: str, call: str, status: int) -> CallError:
    error = CallError(call, status)
    error.args = (sentence,)
    return error


class _Noted:
    """Says what is called before it is, and takes no answer for fine that is no status.

    `circumstance` is said with every call: ` with u = nan`.
    """

    circumstance = ""

    def _call(self, fname: str, *args: Any) -> Any:
        note(_words(fname, args) + self.circumstance)
        answer = super()._call(fname, *args)  # type: ignore[misc]
        if fname not in _WITHOUT_STATUS and answer not in (OK, WARNING):
            raise FMICallException(fname, answer)
        return answer


class FMU2NotedSlave(_Noted, FMU2Slave):
    """fmpy's slave; the beginning of its name tells fmpy which functions to load."""


class FMU2NotedModel(_Noted, FMU2Model):
    """fmpy's model for Model Exchange."""


class Instance:
    """An instance, from its instantiation until `close`; it has to be the only user of its name.

    `fmu` is fmpy's object for calls that have no method here: `with instance.calling(): ...` turns
    what it raises into CallError. `kind` is `CoSimulation` or `ModelExchange`, the first that the FMU
    has by default. `terminated` tells that the FMU asked to end the run.
    """

    def __init__(
        self,
        subject: Subject,
        name: str = "examined",
        kind: str | None = None,
        logging: bool = False,
        guid: str | None = None,
    ) -> None:
        """Load the library and instantiate; raises CallError where that fails."""
        self.subject, self.name = subject, name
        self.kind = kind or subject.kinds[0]
        library = subject.library(self.kind)
        note("loading its library")
        kind_of_fmu = FMU2NotedSlave if self.kind == "CoSimulation" else FMU2NotedModel
        try:
            self.fmu: Any = kind_of_fmu(
                guid=subject.description.guid if guid is None else guid,
                modelIdentifier=subject.means(self.kind).modelIdentifier,
                unzipDirectory=str(subject.folder),
                instanceName=name,
                libraryPath=str(library),
            )
        except Exception as error:  # fmpy raises bare ones
            raise _told_again(
                f"Its library cannot be loaded: {whole(str(error))}", "dlopen", ERROR
            ) from error
        # one for all instances of this object: fmpy's solver keeps some of its memory when it goes
        self._integration = Integration(self.fmu, subject) if self.kind == "ModelExchange" else None
        self.instantiate(logging)

    def instantiate(self, logging: bool = False) -> None:
        """Instantiate anew, after `free`, with the library that is loaded."""
        self.terminated = False
        try:
            self.fmu.instantiate(callbacks=LOG.callbacks, loggingOn=logging)
        except Exception as error:  # fmpy raises a bare one for NULL
            raise _null(LOG.of(self.name)) from error

    @contextlib.contextmanager
    def calling(self) -> Iterator[None]:
        """Turn what fmpy raises for a status worse than a warning into CallError."""
        try:
            yield
        except FMICallException as error:
            raise CallError(str(error.function), int(error.status), LOG.of(self.name, WARNING)) from error

    def status(self, name: str, *arguments: Any) -> int:
        """Call a function of the FMI by its name, component first; its status, whatever it is."""
        try:
            answer = getattr(self.fmu, name)(self.fmu.component, *arguments)
        except FMICallException as error:
            return int(error.status)
        return int(answer or 0)

    def initialize(
        self, values: Mapping[str, Any] | None = None, start: float = 0.0, stop: float | None = None
    ) -> None:
        """Set values by name, set up the experiment, and go through initialization mode."""
        self.enter_initialization(values, start, stop)
        self.exit_initialization()

    def enter_initialization(
        self, values: Mapping[str, Any] | None = None, start: float = 0.0, stop: float | None = None
    ) -> None:
        """Set values by name, set up the experiment, and enter initialization mode."""
        with self.calling():
            self.set(values or {})
            self.fmu.setupExperiment(startTime=start, stopTime=stop)
            self.fmu.enterInitializationMode()

    def exit_initialization(self) -> None:
        """Leave initialization mode; a model is in event mode then, its first events done."""
        with self.calling():
            self.fmu.exitInitializationMode()
            if self._integration is not None:
                self._integration.begin()
                self.terminated = self._integration.terminated

    def set(self, values: Mapping[str, Any]) -> None:
        """Set variables by name, those of one type in one call, in the order given."""
        with self.calling():
            for kind, names in _by_type(self.subject, values).items():
                call = getattr(self.fmu, f"set{kind}")
                call([self.reference(n) for n in names], [values[n] for n in names])

    def get(self, names: Iterable[str]) -> list[Any]:
        """Values of variables by name, those of one type in one call."""
        found: dict[str, Any] = {}
        wanted = list(names)
        with self.calling():
            for kind, some in _by_type(self.subject, wanted).items():
                call = getattr(self.fmu, f"get{kind}")
                found.update(zip(some, call([self.reference(n) for n in some]), strict=True))
        return [found[n] for n in wanted]

    def step(self, time: float, length: float) -> None:
        """Step from `time` by `length`, both in s; CallError also for a step that is discarded.

        A model is integrated, and is in event mode afterwards as it was before.
        """
        with self.calling():
            if self._integration is not None:
                self._integrate(self._integration, time, length)
                return
            try:
                self.fmu.doStep(time, length, noSetFMUStatePriorToCurrentPoint=0)
            except FMICallException as error:
                if error.status == PENDING and self.subject.can("canRunAsynchronuously"):
                    self._wait()
                elif error.status == DISCARD and self._asks_to_end():
                    self.terminated = True
                else:
                    raise CallError(
                        f"fmi2DoStep at t = {time:.9g} s", error.status, LOG.of(self.name, WARNING)
                    ) from error

    def _integrate(self, integration: Integration, time: float, length: float) -> None:
        try:
            integration.step(time, length)
        except RuntimeError as error:  # of the solver
            sentence = f"The model cannot be integrated from t = {time:.9g} s on: {whole(str(error))}"
            raise _told_again(sentence, "the solver", ERROR) from error
        self.terminated = integration.terminated

    def _wait(self) -> None:
        """Until a pending step is done."""
        answer = c_int(PENDING)
        while answer.value == PENDING:
            clock.sleep(0.001)
            self.fmu.fmi2GetStatus(self.fmu.component, fmi2DoStepStatus, byref(answer))
        if answer.value not in (OK, WARNING):
            raise FMICallException("fmi2DoStep", answer.value)

    def _asks_to_end(self) -> bool:
        answer = c_int(0)
        asked = self.status("fmi2GetBooleanStatus", fmi2Terminated, byref(answer))
        return asked == OK and bool(answer.value)

    def reset(self) -> None:
        """Become as it was when it was new."""
        with self.calling():
            self.fmu.reset()
        self.terminated = False

    def close(self) -> None:
        """Terminate and free it; the library stays loaded."""
        with self.calling():
            self.fmu.terminate()
        self.free()

    def free(self) -> None:
        """Free it without terminating it."""
        self.fmu.fmi2FreeInstance(self.fmu.component)

    def reference(self, name: str) -> int:
        """Value reference of a variable."""
        return self.subject.variables[name].valueReference


def _null(lines: Iterable[Line]) -> CallError:
    """That there is no instance, and what was said of it."""
    said = " ".join(line.text for line in list(lines)[-2:])
    error = CallError("fmi2Instantiate", ERROR)
    error.args = (f"fmi2Instantiate answered NULL{f': {whole(said)}' if said else '.'}",)
    return error


def _by_type(subject: Subject, names: Iterable[str]) -> dict[str, list[str]]:
    """Names by the type in the calls that get and set them."""
    found: dict[str, list[str]] = {}
    for name in names:
        kind = subject.variables[name].type
        found.setdefault("Integer" if kind == "Enumeration" else kind, []).append(name)
    return found


def _words(name: str, arguments: tuple[Any, ...]) -> str:
    return f"{name} at t = {arguments[1]:.9g} s" if name == "fmi2DoStep" else name
