"""Builds the faulty model as an FMU, and counts what masters leave behind in it."""

import ctypes
from enum import IntEnum
from pathlib import Path

import fmpy

from tests.support.handwritten_fmu import build_handwritten_fmu

MARK = "FAULTY_HANGS"
"""Variable of the environment with the name of a file that says that a step hangs."""


class Fault(IntEnum):
    """What goes wrong: values of the parameter `fault`. A step passes `at` if it ends later."""

    NONE = 0
    DISCARD = 1
    """Steps that would pass `at` are discarded."""
    ERROR = 2
    """The step that would pass `at` answers fmi2Error."""
    FATAL = 3
    """The step that would pass `at` answers fmi2Fatal."""
    NAN_Y = 4
    """From the step that passes `at` on the output y is NaN."""
    TERMINATE = 5
    """The step that would pass `at` ends there, discarded, and the FMU asks to end the run."""
    GET_REAL = 6
    """fmi2GetReal answers fmi2Error after `at`."""
    SET_REAL = 7
    """fmi2SetReal answers fmi2Error after `at`."""
    NAN_Z = 8
    """From the step that passes `at` on the output z is NaN."""
    PENDING = 9
    """The step that would pass `at` answers fmi2Pending, and is never done."""
    EXIT_INITIALIZATION = 10
    """fmi2ExitInitializationMode answers fmi2Error."""
    ENTER_INITIALIZATION = 11
    """fmi2EnterInitializationMode answers fmi2Error."""
    GET_STATE = 12
    """fmi2GetFMUstate answers fmi2Error after `at`."""
    WARNING = 13
    """Steps that pass `at` are done with fmi2Warning."""
    EXIT = 14
    """The step that would pass `at` ends the process with exit code 0."""
    SEGFAULT = 15
    """The step that would pass `at` ends the process with SIGSEGV."""
    ABORT = 16
    """The step that would pass `at` ends the process with SIGABRT."""
    HANG = 17
    """The step that would pass `at` never returns. Before, it makes the file that `MARK` names."""
    SEGFAULT_GET_REAL = 18
    """fmi2GetReal ends the process with SIGSEGV after `at`."""
    SEGFAULT_INITIALIZATION = 19
    """fmi2ExitInitializationMode ends the process with SIGSEGV."""
    SEGFAULT_TERMINATE = 20
    """fmi2Terminate ends the process with SIGSEGV."""
    SEGFAULT_FREE = 21
    """fmi2FreeInstance ends the process with SIGSEGV."""
    SEGFAULT_FREE_STATE = 22
    """fmi2FreeFMUstate ends the process with SIGSEGV."""
    NEGATIVE = 23
    """The step that would pass `at` answers -1, which is no status, and is not done."""
    HUGE_STATE = 24
    """fmi2SerializedFMUstateSize answers 2^60 bytes after `at`."""
    ORPHAN = 25
    """The step that would pass `at` ends the process with exit code 3, and leaves a copy of it behind."""
    GARBLE = 26
    """The step that passes `at` writes to every file that the process has open, but for the first three."""
    HANG_TERMINATE = 27
    """fmi2Terminate never returns."""


class Counts:
    """Counts over all instances of an unpacked faulty FMU, from now on: it keeps the library loaded."""

    def __init__(self, folder: Path, name: str = "Faulty") -> None:
        file = folder / "binaries" / fmpy.platform / f"{name}{fmpy.sharedLibraryExtension}"
        self._library = ctypes.CDLL(str(file))

    @property
    def instances(self) -> int:
        """Instances made and not freed."""
        return self._library.faulty_instances()

    @property
    def states(self) -> int:
        """FMU states made and not freed."""
        return self._library.faulty_states()

    @property
    def rollbacks(self) -> int:
        """How often a state was set."""
        return self._library.faulty_rollbacks()

    @property
    def calls_after_fatal(self) -> int:
        """Calls after fmi2Fatal, of which fmi2FreeInstance is none."""
        return self._library.faulty_calls_after_fatal()


def build_faulty_fmu(
    folder: Path, *, rollback: bool = True, name: str = "Faulty", interpolate: bool = True
) -> Path:
    """Build the FMU for this machine as `name`.fmu in the folder.

    Without `rollback` it declares no FMU states, without `interpolate` no derivatives of inputs;
    it then refuses these calls with fmi2Error.
    """
    flags = {"rollback": rollback, "interpolate": interpolate}
    return build_handwritten_fmu(
        folder / f"{name}.fmu",
        Path(__file__).parent / "faulty" / "faulty.c",
        placeholders={key: str(value).lower() for key, value in flags.items()},
        macros={key.upper(): int(value) for key, value in flags.items()},
    )
