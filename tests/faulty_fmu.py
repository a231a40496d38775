"""Builds the faulty model as an FMU, and counts what masters leave behind in it."""

import ctypes
import subprocess
import sys
import tempfile
from enum import IntEnum
from importlib.resources import files
from pathlib import Path
from string import Template

import fmpy

from fmublock.archive import content_guid, write_archive
from fmublock.native import TARGETS, host_platform

_SOURCES = Path(__file__).parent / "faulty"
_FLAGS = ["-std=c11", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-fPIC", "-s", "-Wall", "-Wextra"]


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
    template = Template((_SOURCES / "modelDescription.xml").read_text())
    sources = {f.name: f.read_bytes() for f in sorted(_SOURCES.glob("*.[ch]"))}
    values = {"name": name, "rollback": str(rollback).lower(), "interpolate": str(interpolate).lower()}
    draft = template.safe_substitute(values).encode()
    values["guid"] = content_guid({**sources, "modelDescription.xml": draft})
    defines = {
        "MODEL_GUID": f'"{values["guid"]}"',
        "ROLLBACK": int(rollback),
        "INTERPOLATE": int(interpolate),
    }
    library = f"binaries/{fmpy.platform}/{name}{fmpy.sharedLibraryExtension}"
    path = folder / f"{name}.fmu"
    content = {
        "modelDescription.xml": template.substitute(values).encode(),
        library: _compile([f"-D{key}={value}" for key, value in defines.items()]),
    }
    write_archive(path, content)
    return path


def _compile(defines: list[str]) -> bytes:
    headers = str(files("fmpy").joinpath("c-code"))
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder, f"faulty{fmpy.sharedLibraryExtension}")
        target, _ = TARGETS[host_platform()]
        command = [sys.executable, "-m", "ziglang", "cc", "-target", target, "-shared", *_FLAGS, *defines]
        command += ["-I", headers, str(_SOURCES / "faulty.c"), "-o", str(library)]
        compiled = subprocess.run(command, capture_output=True, text=True, check=False)
        assert compiled.returncode == 0, compiled.stderr
        return library.read_bytes()
