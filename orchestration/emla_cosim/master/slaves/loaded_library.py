"""Libraries of FMUs: loaded and bound once per unpacked file, however many instances there are of it."""

import copy
import ctypes
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from fmpy import fmi2

from ...base.errors import CommandError
from ...base.files import coming_back
from ...fmu.file import FmuFile

_POINTER, _SIZE = ctypes.c_void_p, ctypes.c_size_t
_PROTOTYPES = {
    "fmi2SetReal": (_POINTER, _POINTER, _SIZE, _POINTER),
    "fmi2GetReal": (_POINTER, _POINTER, _SIZE, _POINTER),
    "fmi2SetInteger": (_POINTER, _POINTER, _SIZE, _POINTER),
    "fmi2GetInteger": (_POINTER, _POINTER, _SIZE, _POINTER),
    "fmi2SetBoolean": (_POINTER, _POINTER, _SIZE, _POINTER),
    "fmi2GetBoolean": (_POINTER, _POINTER, _SIZE, _POINTER),
    "fmi2SetString": (_POINTER, _POINTER, _SIZE, _POINTER),
    "fmi2Reset": (_POINTER,),
    "fmi2SetRealInputDerivatives": (_POINTER, _POINTER, _SIZE, _POINTER, _POINTER),
    "fmi2DoStep": (_POINTER, ctypes.c_double, ctypes.c_double, ctypes.c_int),
    "fmi2GetBooleanStatus": (_POINTER, ctypes.c_int, _POINTER),
    "fmi2GetFMUstate": (_POINTER, _POINTER),
    "fmi2SetFMUstate": (_POINTER, _POINTER),
    "fmi2FreeFMUstate": (_POINTER, _POINTER),
    "fmi2SerializedFMUstateSize": (_POINTER, _POINTER, _POINTER),
    "fmi2SerializeFMUstate": (_POINTER, _POINTER, _POINTER, _SIZE),
    "fmi2DeSerializeFMUstate": (_POINTER, _POINTER, _SIZE, _POINTER),
}
DERIVATIVE = "fmi2GetDirectionalDerivative"
"""A function that a library may lack."""
_DERIVATIVE_TYPES = (_POINTER, _POINTER, _SIZE, _POINTER, _SIZE, _POINTER, _POINTER)


class LoadedLibrary:
    """The library of an FMU for all of its instances in this process; who entered it leaves it once.

    `functions` are those of the FMI by name, with prototypes of their own, because fmpy's checks would
    cost as much as the call; `addresses` are theirs.
    """

    _loaded: ClassVar[dict[Path, "LoadedLibrary"]] = {}

    def __init__(self, file: FmuFile) -> None:
        self._path = file.library
        with coming_back():  # fmpy goes to the library's folder
            self._bound = fmi2.FMU2Slave(
                guid=file.description.guid,
                unzipDirectory=str(file.folder),
                modelIdentifier=file.model_identifier,
                libraryPath=str(file.library),
            )
        types = dict(_PROTOTYPES)
        if file.can("providesDirectionalDerivative") and hasattr(self._bound.dll, DERIVATIVE):
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
        elif file.can("canBeInstantiatedOnlyOncePerProcess"):
            raise CommandError(
                "it says that a process can have one instance of it, which this one has; "
                "`isolate` gives a component a process of its own."
            )
        library._inside += 1
        return library

    def instance(self, name: str) -> fmi2.FMU2Slave:
        """What makes an instance of this name; nothing is called yet."""
        made = copy.copy(self._bound)  # what differs between instances is their name, callbacks and address
        made.instanceName = name
        return made

    def leave(self) -> None:
        """An instance is freed, or was never made; after the last one the library is unloaded."""
        self._inside -= 1
        if not self._inside:
            del self._loaded[self._path]
            self._bound.freeLibrary()

    def _function(self, name: str, argument_types: tuple[Any, ...]) -> Any:
        function = self._bound.dll[name]
        function.argtypes, function.restype = argument_types, ctypes.c_int
        return function
