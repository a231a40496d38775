"""Libraries of FMUs: loaded and bound once per unpacked file, however many instances there are of it."""

import copy
import ctypes
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from ..base.errors import CommandError
from .file import FmuFile
from .instance import FmiInstance, load

_POINTER, _SIZE = ctypes.c_void_p, ctypes.c_size_t
_VALUES = (_POINTER, _POINTER, _SIZE, _POINTER)
_PROTOTYPES = {
    "setReal": _VALUES,
    "getReal": _VALUES,
    "setInteger": _VALUES,
    "getInteger": _VALUES,
    "setBoolean": _VALUES,
    "getBoolean": _VALUES,
    "setRealInputDerivatives": (_POINTER, _POINTER, _SIZE, _POINTER, _POINTER),
    "doStep": (_POINTER, ctypes.c_double, ctypes.c_double, ctypes.c_int),
    "getFMUstate": (_POINTER, _POINTER),
    "setFMUstate": (_POINTER, _POINTER),
}
DERIVATIVE = "getDirectionalDerivative"
"""A function that a library may lack."""
_DERIVATIVE_TYPES = (_POINTER, _POINTER, _SIZE, _POINTER, _SIZE, _POINTER, _POINTER)


class LoadedLibrary:
    """The library of an FMU for all of its instances in this process; who entered it leaves it once.

    `functions` are those of a step by name, with prototypes of their own, because fmpy's checks would
    cost as much as the call; `addresses` are theirs.
    """

    _loaded: ClassVar[dict[Path, "LoadedLibrary"]] = {}

    def __init__(self, file: FmuFile) -> None:
        self._path = file.library
        guid = file.description.guid
        self._bound = load("CoSimulation", file.library, file.folder, file.model_identifier, guid)
        types = dict(_PROTOTYPES)
        if file.has_capability("providesDirectionalDerivative") and hasattr(
            self._bound.dll, _c_name(DERIVATIVE)
        ):
            types[DERIVATIVE] = _DERIVATIVE_TYPES
        self.functions: Mapping[str, Any] = {n: self._function(n, t) for n, t in types.items()}
        self.addresses = {n: ctypes.cast(f, _POINTER).value or 0 for n, f in self.functions.items()}
        self._inside = 0

    @classmethod
    def entered(cls, file: FmuFile) -> "LoadedLibrary":
        """That of an unpacked FMU, loaded if none of its instances did so.

        Raises CommandError where another instance is not allowed, and what fmpy raises where the library
        cannot be loaded.
        """
        library = cls._loaded.get(file.library)
        if library is None:
            library = cls._loaded[file.library] = cls(file)
        elif file.has_capability("canBeInstantiatedOnlyOncePerProcess"):
            raise CommandError(
                "it says that a process can have one instance of it, which this one has; "
                "`isolate` gives a component a process of its own."
            )
        library._inside += 1
        return library

    def calls_of(self, instance: FmiInstance) -> Any:
        """Return fmpy's object for an instance; nothing is called yet."""
        made = copy.copy(self._bound)  # what differs between instances is their name, callbacks and address
        made.instance, made.instanceName = instance, instance.name
        return made

    def leave(self) -> None:
        """An instance is freed, or was never made; after the last one the library is unloaded."""
        self._inside -= 1
        if not self._inside:
            del self._loaded[self._path]
            self._bound.freeLibrary()

    def _function(self, name: str, argument_types: tuple[Any, ...]) -> Any:
        function = self._bound.dll[_c_name(name)]
        function.argtypes, function.restype = argument_types, ctypes.c_int
        return function


def plain_name(function: str) -> str:
    """Return the name of an FMI function as sentences have it: doStep."""
    stem = function.removeprefix("fmi2")
    return f"{stem[0].lower()}{stem[1:]}"


def _c_name(name: str) -> str:
    return f"fmi2{name[0].upper()}{name[1:]}"
