"""The PythonFMU interface of an `Instance`; part of every PythonFMU FMU."""

import atexit
import ctypes
import json
import os
import sys
import zlib
from collections.abc import Callable
from contextlib import suppress
from functools import cache, wraps
from pathlib import Path
from typing import Any

from pythonfmu import Fmi2Slave
from pythonfmu.enums import Fmi2Status

from .block import Block
from .instance import BlockError, Instance

_TYPES = {"Real": "Real", "Integer": "Integer", "Enumeration": "Integer", "Boolean": "Boolean"}


def give_reference(thing: object) -> None:
    """Add a reference to a Python object, which PythonFMU 0.7.0 will release.

    PythonFMU releases references that it does not own. When it makes an instance, it runs the text of
    the FMU's main module again and releases the module's globals. When a call raises, it releases the
    slave, its class and its log. Without this the process crashes after some instances.
    """
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(thing))


@cache
def release_interpreter_at_exit(binary: Path) -> None:
    """Let PythonFMU 0.7.0's library release the interpreter before the process ends, and only once.

    At the end of a process its C++ object and its destructor both release the same reference count. The
    second does so in freed memory, and the C library may find its lists damaged and abort.
    """
    if sys.platform == "linux":
        # skip hosts that run a copy of the library, and libraries that have nothing to release
        with suppress(OSError, AttributeError):
            library = ctypes.CDLL(str(binary), mode=os.RTLD_LAZY | os.RTLD_NOLOAD)
            atexit.register(library.finalizePythonInterpreter)


def _survivable(method: Callable[..., Any]) -> Callable[..., Any]:
    """Keep the slave alive when a call raises; see `give_reference`."""

    @wraps(method)
    def guarded(self: "BlockSlave", *args: Any) -> Any:
        try:
            return method(self, *args)
        except Exception:
            for thing in (self, type(self), self.log_queue):
                give_reference(thing)
            raise

    return guarded


class BlockSlave(Fmi2Slave):
    """Base of the slave class in an FMU's main module, which names the block and the content's hash.

    Value references are those of the block. A step that fails is discarded. In other calls PythonFMU
    logs the text of an exception and returns fmi2Fatal.
    """

    block: type[Block]
    content: str

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        if not self.instance_name:
            raise BlockError("an instance needs a name; this one is empty.")
        self.instance = Instance(self.block(), self.instance_name)
        if self.resources:
            binaries = Path(self.resources).parent / "binaries"
            release_interpreter_at_exit(binaries / "linux64" / f"{self.block.__name__}.so")
        self._types = [_TYPES[s.variable.fmi_type] for s in self.instance.layout.scalars]

    @_survivable
    def setup_experiment(
        self, start_time: float, stop_time: float | None = None, tolerance: float | None = None
    ) -> None:
        """Set start and stop time in s; the tolerance is not used, `solver.internal_step` decides."""
        self.instance.setup_experiment(start_time, stop_time)

    @_survivable
    def enter_initialization_mode(self) -> None:
        """Start initialization."""
        self.instance.enter_initialization()

    @_survivable
    def exit_initialization_mode(self) -> None:
        """End initialization; raises BlockError if a value is outside its range."""
        self.instance.exit_initialization()
        self._report_limits()

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Do a step.

        Returns:
            False, with a log message, if the step fails. The instance is then as it was before.
        """
        try:
            self.instance.do_step(current_time, step_size)
        except BlockError as refused:
            self.log(str(refused), Fmi2Status.discard)
            return False
        except Exception as error:
            cause = f"{type(error).__name__}: {error}"
            self.log(f"{self.instance_name}: step at t = {current_time:.9g} s: {cause}", Fmi2Status.discard)
            return False
        self._report_limits()
        return True

    def _report_limits(self) -> None:
        for sentence in self.instance.left_limits():
            self.log(sentence, Fmi2Status.warning)

    @_survivable
    def terminate(self) -> None:
        """End the run."""
        self.instance.terminate()

    def get_real(self, vrs: list[int]) -> list[float]:
        """Return the values of Real variables."""
        return self._get(vrs, "Real")

    def get_integer(self, vrs: list[int]) -> list[int]:
        """Return the values of Integer and Enumeration variables."""
        return [int(x) for x in self._get(vrs, "Integer")]

    def get_boolean(self, vrs: list[int]) -> list[bool]:
        """Return the values of Boolean variables."""
        return [x != 0.0 for x in self._get(vrs, "Boolean")]

    def set_real(self, vrs: list[int], values: list[float]) -> None:
        """Set Real variables."""
        self._set(vrs, values, "Real")

    def set_integer(self, vrs: list[int], values: list[int]) -> None:
        """Set Integer and Enumeration variables."""
        self._set(vrs, values, "Integer")

    def set_boolean(self, vrs: list[int], values: list[bool]) -> None:
        """Set Boolean variables."""
        self._set(vrs, values, "Boolean")

    @_survivable
    def _get(self, vrs: list[int], fmi_type: str) -> list[float]:
        self._check(vrs, fmi_type)
        return self.instance.get(vrs)

    @_survivable
    def _set(self, vrs: list[int], values: list[Any], fmi_type: str) -> None:
        self._check(vrs, fmi_type)
        self.instance.set(vrs, values)

    def _check(self, vrs: list[int], fmi_type: str) -> None:
        for vr in vrs:
            if not 0 <= vr < len(self._types):
                raise BlockError(f"{self.instance_name}: there is no variable with value reference {vr}.")
            if self._types[vr] != fmi_type:
                name = self.instance.layout.scalars[vr].name
                raise BlockError(f"{self.instance_name}: {name} is of type {self._types[vr]}.")

    def _get_fmu_state(self) -> dict[str, Any]:
        return {**self._origin(), **self.instance.get_state()}

    @_survivable
    def _set_fmu_state(self, state: dict[str, Any]) -> None:
        if not self._origin().items() <= state.items():
            raise BlockError(f"{self.instance_name}: this is not a state of {self.block.__name__}.")
        self.instance.set_state(state)

    def _origin(self) -> dict[str, str]:
        """Return what tells states of this block from others; blocks of one package have the same content."""
        return {"block": self.block.__name__, "content": self.content}

    @staticmethod
    def _fmu_state_to_bytes(state: dict[str, Any]) -> bytes:
        text = json.dumps(state).encode()
        return b"%08x" % zlib.crc32(text) + text

    @staticmethod
    def _fmu_state_from_bytes(state: bytes) -> dict[str, Any]:
        """Read a serialized state; other bytes become a state that `_set_fmu_state` refuses."""
        checksum, text = bytes(state[:8]), bytes(state[8:])
        return json.loads(text) if checksum == b"%08x" % zlib.crc32(text) else {}
