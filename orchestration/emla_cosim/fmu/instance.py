"""An instance of an FMU in this process, called through fmpy."""

import contextlib
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from ctypes import byref, c_double, c_int
from functools import cache, cached_property
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Model, FMU2Slave, fmi2LastSuccessfulTime, fmi2Terminated
from fmpy.model_description import ModelVariable

from ..base.files import restore_working_folder
from .elements import ElementLayout, ElementVariable
from .variables import TypedValue
from .version_3 import Model3, Slave3

STATUS = ("fmi2OK", "fmi2Warning", "fmi2Discard", "fmi2Error", "fmi2Fatal", "fmi2Pending")
OK, WARNING, DISCARD, ERROR, FATAL, PENDING = range(6)
FINE = (OK, WARNING)

_WITHOUT_STATUS = (
    *("fmi2GetTypesPlatform", "fmi2GetVersion", "fmi2Instantiate", "fmi2FreeInstance"),
    *("fmi3GetVersion", "fmi3InstantiateCoSimulation", "fmi3InstantiateModelExchange", "fmi3FreeInstance"),
)


class FmiInstance(ABC):
    """An instance of an FMU; subclasses define how to handle calls and errors.

    `fmu` is fmpy's object, for calls that have no method here: `with instance.calling(): ...` converts fmpy's
    exceptions to the error of the instance.
    """

    name: str
    fmu: Any
    start_time = math.nan
    """The start of the last initialization in s."""
    instantiation: Mapping[str, bool] = {}
    """What `fmi3InstantiateCoSimulation` gets for `eventModeUsed` and `earlyReturnAllowed`."""
    configuration: Sequence[TypedValue] = ()
    """Values of structural parameters that an FMI 3.0 FMU gets right after instantiation."""

    @cached_property
    def _layouts(self) -> dict[tuple[int, ...], list[tuple[str, list[int], ElementLayout, Any]]]:
        """How groups of variables are read: types, positions, and the variables themselves."""
        return {}

    @abstractmethod
    def announce(self, function: str, arguments: Sequence[Any] = ()) -> None:
        """Record the next call.

        Args:
            function: The name of the FMI function.
            arguments: Its arguments.
        """

    def returned(self) -> None:  # noqa: B027 - only some subclasses need it
        """Record that the call has returned."""

    @abstractmethod
    def error(self, call: str, status: int) -> Exception:
        """Return the exception for a call that returned this status."""

    @abstractmethod
    def python_error(self, function: str, error: Exception) -> Exception:
        """Return the exception for a call that left an exception of Python; see `python_exceptions`.

        Args:
            function: The name of the FMI function.
            error: What ctypes raised.
        """

    @contextlib.contextmanager
    def calling(self, call: str | None = None) -> Iterator[None]:
        """Convert fmpy's exception for a status worse than a warning to the error of this call."""
        try:
            yield
        except FMICallException as error:
            raise self.error(call or str(error.function), int(error.status)) from error

    def status(self, name: str, *arguments: Any) -> int:
        """Call an FMI function with the component and these arguments; return its status, errors included."""
        try:
            answer = getattr(self.fmu, name)(self.fmu.component, *arguments)
        except FMICallException as error:
            return int(error.status)
        return int(answer or 0)

    def begin_initialization(
        self,
        start_time: float,
        stop_time: float | None = None,
        tolerance: float | None = None,
        set_values: Callable[[], None] = lambda: None,
    ) -> None:
        """Set up the experiment, set start values and enter initialization mode.

        Start values come after `fmi2SetupExperiment`, because FMUs of 20-sim reset all variables there.

        Args:
            start_time: In s.
            stop_time: In s; None without a fixed end.
            tolerance: Relative tolerance of the FMU's solver; None leaves it to the FMU.
            set_values: Sets the start values.
        """
        self.start_time = start_time
        with self.calling():
            self.fmu.setupExperiment(tolerance=tolerance, startTime=start_time, stopTime=stop_time)
            set_values()
            self.fmu.enterInitializationMode()

    def exit_initialization(self) -> None:
        """Leave initialization mode."""
        with self.calling():
            self.fmu.exitInitializationMode()

    def set_typed(self, values: Sequence[TypedValue]) -> None:
        """Set variables in this order, with one call per type; raises fmpy's exceptions."""
        for kind, positions in by_type([variable for variable, _ in values]):
            references = [values[i][0].valueReference for i in positions]
            getattr(self.fmu, f"set{kind}")(references, [values[i][1] for i in positions])

    def get_typed(self, variables: Sequence[ModelVariable]) -> list[Any]:
        """Return values of variables, with one call per type; raises fmpy's exceptions."""
        result: list[Any] = [None] * len(variables)
        key = tuple(map(id, variables))
        if key not in self._layouts:
            self._layouts[key] = []
            for kind, positions in by_type(variables):
                members = [variables[i] for i in positions]
                # `members` keeps the variables alive: the key has only their ids
                self._layouts[key].append((kind, positions, ElementLayout(members), members))
        for kind, positions, layout, _ in self._layouts[key]:
            count = () if layout.size == len(layout.references) else (layout.size,)
            values = getattr(self.fmu, f"get{kind}")(layout.references, *count)
            for i, value in zip(positions, layout.pick(values), strict=True):
                result[i] = value
        return result

    def asks_to_end(self) -> bool:
        """Return whether the FMU discarded a step because it wants the run to end."""
        answer = c_int(0)
        status = self.status("fmi2GetBooleanStatus", fmi2Terminated, byref(answer))
        return status == OK and bool(answer.value)

    def last_successful_time(self) -> float:
        """Return the time in s that a discarded step of FMI 2.0 has reached; NaN if it is not known."""
        answer = c_double(math.nan)
        status = self.status("fmi2GetRealStatus", fmi2LastSuccessfulTime, byref(answer))
        return float(answer.value) if status == OK else math.nan

    def reset(self) -> None:
        """Reset the instance to its state after instantiation."""
        with self.calling():
            self.fmu.reset()

    def free(self) -> None:
        """Free the instance without terminating it; the library stays loaded."""
        self.fmu.fmi2FreeInstance(self.fmu.component)


Signature = tuple[Sequence[str], Sequence[Any], Any]
"""The names and the types in C of the arguments of a function, and the type of its result."""


class _Announced:
    """Announces each call, and treats any other result than a fine status as an error."""

    instance: FmiInstance
    dll: Any
    _functions: dict[str, Any]

    def _loadFunctions(self) -> None:
        """Look up all functions; fmpy inspects its methods for each instance, which takes long."""
        for name, (names, types, result) in read_signatures(type(self)).items():
            function = self._functions[name] = getattr(self.dll, name)
            function.argnames, function.argtypes, function.restype = names, types, result

    def _call(self, fname: str, *args: Any) -> Any:
        """Call an FMI function. Raise FMICallException for a status worse than a warning."""
        self.instance.announce(fname, args)
        try:
            answer = super()._call(fname, *args)  # type: ignore[misc]
        except SystemError as error:
            raise self.instance.python_error(fname, error) from error
        finally:
            self.instance.returned()
        if fname not in _WITHOUT_STATUS and answer not in FINE:
            raise FMICallException(fname, answer)
        return answer


@cache
def read_signatures(fmpy_class: type[Any]) -> Mapping[str, Signature]:
    """Return the functions that fmpy's class for FMUs calls, by name."""
    without_library: Any = object.__new__(fmpy_class)
    without_library.dll, without_library._functions = _AnyLibrary(), {}
    FMU2Slave._loadFunctions(without_library)  # that of all of fmpy's classes
    functions = without_library._functions
    return {name: (f.argnames, f.argtypes, f.restype) for name, f in functions.items()}


class _AnyLibrary:
    """A library with functions of all names."""

    def __getattr__(self, name: str) -> Any:
        return SimpleNamespace()


class FMU2AnnouncedSlave(_Announced, FMU2Slave):
    """fmpy's class for co-simulation; fmpy decides by the beginning of its name which functions to load."""


class FMU2AnnouncedModel(_Announced, FMU2Model):
    """fmpy's class for Model Exchange."""


class FMU3AnnouncedSlave(_Announced, Slave3):
    """fmpy's class for co-simulation of FMI 3.0."""


class FMU3AnnouncedModel(_Announced, Model3):
    """fmpy's class for Model Exchange of FMI 3.0."""


CLASSES = {
    ("CoSimulation", 2): FMU2AnnouncedSlave,
    ("ModelExchange", 2): FMU2AnnouncedModel,
    ("CoSimulation", 3): FMU3AnnouncedSlave,
    ("ModelExchange", 3): FMU3AnnouncedModel,
}
"""fmpy's classes for FMUs by kind and version of FMI."""


def load(
    kind: str, library: Path, folder: Path, identifier: str, guid: str | None, version: str = "2.0"
) -> Any:
    """Load the library of an FMU and return fmpy's object for an instance, without calling the FMU.

    The caller sets `instance` and `instanceName` of the object. Raises fmpy's exceptions if the library
    cannot be loaded.

    Args:
        kind: `CoSimulation` or `ModelExchange`.
        library: The shared library.
        folder: The unpacked FMU.
        identifier: The model identifier.
        guid: The GUID of the model description.
        version: The version of FMI.
    """
    fmpy_class = CLASSES[kind, 2 if version == "2.0" else 3]
    with restore_working_folder():  # fmpy changes to the library's folder
        return fmpy_class(
            guid=guid, unzipDirectory=str(folder), modelIdentifier=identifier, libraryPath=str(library)
        )


def kind_of(variable: ModelVariable) -> str:
    """Return the type of a variable as in the names of FMI functions."""
    if isinstance(variable, ElementVariable):
        return variable.data_type
    return "Integer" if variable.type == "Enumeration" else str(variable.type)


def by_type(variables: Sequence[ModelVariable]) -> Iterator[tuple[str, list[int]]]:
    """Yield the types, as in the names of FMI functions, each with the positions of its variables."""
    kinds = [kind_of(v) for v in variables]
    for kind in dict.fromkeys(kinds):
        yield kind, [i for i, k in enumerate(kinds) if k == kind]
