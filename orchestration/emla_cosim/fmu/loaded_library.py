"""Libraries of FMUs, loaded and bound once per unpacked file for all its instances."""

import copy
import ctypes
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from ..base.errors import CommandError
from . import version_3
from .elements import is_version_3
from .file import FmuFile
from .instance import FmiInstance, load
from .interface import CO_SIMULATION, MODEL_EXCHANGE
from .load_diagnosis import diagnose_library
from .python_exceptions import find_left_exception

_POINTER, _SIZE = ctypes.c_void_p, ctypes.c_size_t
_VALUES = (_POINTER, _POINTER, _SIZE, _POINTER)
_CONTINUOUS = (_POINTER, _POINTER, _SIZE)
_PROTOTYPES = {
    **{f"{access}{kind}": _VALUES for kind in ("Real", "Integer", "Boolean") for access in ("set", "get")},
    "getFMUstate": (_POINTER, _POINTER),
    "setFMUstate": (_POINTER, _POINTER),
}
_OF_KIND = {
    CO_SIMULATION: {
        "setRealInputDerivatives": (_POINTER, _POINTER, _SIZE, _POINTER, _POINTER),
        "doStep": (_POINTER, ctypes.c_double, ctypes.c_double, ctypes.c_int),
    },
    MODEL_EXCHANGE: {
        "completedIntegratorStep": (_POINTER, ctypes.c_int, _POINTER, _POINTER),
        "getDerivatives": _CONTINUOUS,
    },
}
_OF_BOTH_VERSIONS = {
    CO_SIMULATION: {},
    MODEL_EXCHANGE: {
        "enterEventMode": (_POINTER,),
        "enterContinuousTimeMode": (_POINTER,),
        "setTime": (_POINTER, ctypes.c_double),
        "setContinuousStates": _CONTINUOUS,
        "getContinuousStates": _CONTINUOUS,
        "getEventIndicators": _CONTINUOUS,
        "getNominalsOfContinuousStates": _CONTINUOUS,
    },
}
DERIVATIVE, BOOLEAN_STATUS = "getDirectionalDerivative", "getBooleanStatus"
"""Functions that a library can lack."""
_DERIVATIVE_TYPES = (_POINTER, _POINTER, _SIZE, _POINTER, _SIZE, _POINTER, _POINTER)


class LoadedLibrary:
    """The library of an FMU for all its instances in this process.

    Each call of `acquire` needs one call of `release`. `functions` are the functions of a step, by name. They
    have their own prototypes because fmpy's checks take as long as the call. `addresses` are the addresses of
    the functions.
    """

    _libraries: ClassVar[dict[Path, "LoadedLibrary"]] = {}

    def __init__(self, file: FmuFile) -> None:
        self._path = file.library
        guid, version = file.description.guid, str(file.description.fmiVersion)
        self._fmpy_object = load(file.kind, file.library, file.folder, file.model_identifier, guid, version)
        self.is_version_3 = is_version_3(file.description)
        self._prefix = "fmi3" if self.is_version_3 else "fmi2"
        types = {**_PROTOTYPES, **_OF_KIND[file.kind]}
        if self.is_version_3:
            types = {**version_3.PROTOTYPES, **version_3.OF_KIND[file.kind]}
        types |= _OF_BOTH_VERSIONS[file.kind]
        # some libraries lack functions that the model description promises
        if file.has_capability("providesDirectionalDerivative") and hasattr(
            self._fmpy_object.dll, self._make_c_name(DERIVATIVE)
        ):
            derivative_types = version_3.DERIVATIVE_TYPES if self.is_version_3 else _DERIVATIVE_TYPES
            types = {**types, DERIVATIVE: derivative_types}
        self.functions: Mapping[str, Any] = {n: self._bind_function(n, t) for n, t in types.items()}
        self.addresses = {n: ctypes.cast(f, _POINTER).value or 0 for n, f in self.functions.items()}
        if BOOLEAN_STATUS not in self.addresses:
            status = getattr(self._fmpy_object.dll, self._make_c_name(BOOLEAN_STATUS), None)
            self.addresses[BOOLEAN_STATUS] = ctypes.cast(status, _POINTER).value or 0 if status else 0
        self._instance_count = 0

    @classmethod
    def acquire(cls, file: FmuFile) -> "LoadedLibrary":
        """Return the library of an unpacked FMU for one more instance; the first one loads it.

        Raises:
            CommandError: If the library cannot be loaded, or the FMU does not allow another instance.
        """
        library = cls._libraries.get(file.library)
        if library is None:
            try:
                library = cls._libraries[file.library] = cls(file)
            except Exception as error:  # fmpy raises bare ones
                if find_left_exception(error) is not None:
                    raise
                fact, remedy = diagnose_library(file.library, error)
                name = f"{file.library.parent.name}/{file.library.name}"
                raise CommandError(f"its library '{name}' {fact}. {remedy}") from error
        elif file.has_capability("canBeInstantiatedOnlyOncePerProcess"):
            raise CommandError(
                "it allows one instance per process, and this process already has one. "
                "Use `isolate` to run a component in a process of its own."
            )
        library._instance_count += 1
        return library

    def calls_of(self, instance: FmiInstance) -> Any:
        """Return fmpy's object for an instance; nothing is called yet."""
        calls = copy.copy(self._fmpy_object)  # instances differ in name, callbacks and address
        calls.instance, calls.instanceName = instance, instance.name
        return calls

    def release(self) -> None:
        """Release the library for one instance; the last release unloads it."""
        self._instance_count -= 1
        if not self._instance_count:
            del self._libraries[self._path]
            self._fmpy_object.freeLibrary()

    def _bind_function(self, name: str, argument_types: tuple[Any, ...]) -> Any:
        function = self._fmpy_object.dll[self._make_c_name(name)]
        function.argtypes, function.restype = argument_types, ctypes.c_int
        return function

    def _make_c_name(self, name: str) -> str:
        return f"{self._prefix}{name[0].upper()}{name[1:]}"


def plain_name(function: str) -> str:
    """Return the name of an FMI function for messages, such as doStep."""
    stem = function.removeprefix("fmi2").removeprefix("fmi3")
    return f"{stem[0].lower()}{stem[1:]}"
