"""Builds FMUs that are written by hand: those of `toyfmu/`, and C files of other folders.

An FMU of `toyfmu/` is a C file with only what is special, on `toyfmu.h`, and a model description beside it.
"""

import ctypes
import hashlib
import os
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Mapping
from enum import IntEnum
from importlib.resources import files
from pathlib import Path
from string import Template

import fmpy

from fmublock.archive import content_guid, write_archive
from fmublock.cache import VARIABLE
from fmublock.platforms import TARGETS, host_platform

TOYS = Path(__file__).parent / "toyfmu"
FMI_3 = fmpy.platform_tuple
"""The folder of binaries of FMI 3.0; that of FMI 2.0 is the default."""

_FLAGS = ["-std=c11", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-fPIC", "-s"]
# FMI prescribes parameters that a function may not need
_WARNINGS = ["-Wall", "-Wextra", "-Wno-unused-parameter"]


def build_handwritten_fmu(
    path: Path,
    source: Path,
    placeholders: Mapping[str, str] | None = None,
    macros: Mapping[str, int | str] | None = None,
    platform: str = fmpy.platform,
    description: Path | None = None,
) -> Path:
    """Build an FMU for this machine, with the file's name as its model identifier.

    Args:
        path: The FMU file.
        source: The C file. It gets MODEL_GUID and `macros`.
        placeholders: Values of the model description besides $name and $guid.
        macros: Macros of the C file.
        platform: The folder of its binary.
        description: The model description, by default modelDescription.xml in the folder of the C file.
    """
    description = description or source.parent / "modelDescription.xml"
    template = Template(description.read_text(encoding="utf-8"))
    values = {"name": path.stem, **(placeholders or {})}
    draft = template.safe_substitute(values).encode()
    guid = content_guid({**_sources(source), "modelDescription.xml": draft})
    library = compile_library(source, {"MODEL_GUID": f'"{guid}"', **(macros or {})})
    content = {
        "modelDescription.xml": template.substitute(values, guid=guid).encode(),
        f"binaries/{platform}/{path.stem}{fmpy.sharedLibraryExtension}": library,
    }
    write_archive(path, content)
    return path


def compile_library(source: Path, macros: Mapping[str, int | str]) -> bytes:
    """Return the shared library of a C file for this machine; it is kept for later runs."""
    defined = [f"-D{name}={value}" for name, value in macros.items()]
    target, _ = TARGETS[host_platform()]
    options = ["-target", target, "-shared", *_FLAGS, *_WARNINGS, *defined]
    content = repr([*options, source.name, *sorted(_sources(source).items())])
    cached = Path(os.environ[VARIABLE], "hand-written", hashlib.sha256(content.encode()).hexdigest())
    if not cached.exists():
        cached.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=cached.parent) as folder:
            library = Path(folder, f"{source.stem}{fmpy.sharedLibraryExtension}")
            command = [sys.executable, "-m", "ziglang", "cc", *options, "-I", str(TOYS)]
            command += ["-I", str(files("fmpy").joinpath("c-code")), str(source), "-o", str(library)]
            command += [] if "windows" in target else ["-lm"]
            compiled = subprocess.run(command, capture_output=True, text=True, check=False)
            assert compiled.returncode == 0, compiled.stderr
            library.replace(cached)
    return cached.read_bytes()


def _sources(source: Path) -> dict[str, bytes]:
    """Return the C file and the headers that it may include."""
    headers = {*source.parent.glob("*.h"), TOYS / "toyfmu.h"}
    return {f.name: f.read_bytes() for f in [source, *sorted(headers)]}


def _build_toy(
    path: Path,
    name: str,
    placeholders: Mapping[str, str] | None = None,
    macros: Mapping[str, int | str] | None = None,
    platform: str = FMI_3,
    source: str = "",
) -> Path:
    """Build an FMU of `toyfmu/` by name."""
    file = TOYS / f"{source or name}.c"
    return build_handwritten_fmu(path, file, placeholders, macros, platform, TOYS / f"{name}.xml")


def edit_description(fmu: Path, target: Path, *edits: str) -> Path:
    """Write a copy of an FMU with an old text, a new text, and so on replaced in its description."""
    with zipfile.ZipFile(fmu) as archive:
        content = {name: archive.read(name) for name in archive.namelist()}
    for old, new in zip(edits[::2], edits[1::2], strict=True):
        assert old.encode() in content["modelDescription.xml"], old
        content["modelDescription.xml"] = content["modelDescription.xml"].replace(old.encode(), new.encode())
    write_archive(target, content)
    return target


def _text(flag: bool) -> str:
    return str(flag).lower()


# ---- FMI 2.0 -----------------------------------------------------------------------------------


def build_all_types_fmu(path: Path) -> Path:
    """Build the FMU with outputs and local variables of all types of FMI 2.0."""
    return _build_toy(path, "all_types", platform=fmpy.platform)


def build_reluctant_fmu(path: Path, tolerance: str = "1e-5") -> Path:
    """Build the FMU that ignores start values, or is slow, with the tolerance of its default experiment."""
    return _build_toy(path, "reluctant", {"tolerance": tolerance}, platform=fmpy.platform)


def build_integrated_fmu(
    path: Path,
    *,
    rollback: bool = True,
    input: str = "continuous",
    version: int = 2,
    indicators: int = 1,
    clock: str = "",
) -> Path:
    """Build the FMU for Model Exchange with events.

    Args:
        path: The FMU file.
        rollback: Whether it declares FMU states.
        input: Variability of its input.
        version: 2 or 3, of FMI.
        indicators: The number of event indicators that it reports, of FMI 3.0.
        clock: Further variables of the model description, of FMI 3.0.
    """
    placeholders = {"rollback": _text(rollback), "input": input, "clock": clock}
    macros = {"FMI": version, "INDICATORS": indicators}
    if version == 2:
        return _build_toy(path, "integrated", placeholders, macros, fmpy.platform)
    return _build_toy(path, "integrated_3", placeholders, macros, source="integrated")


def build_forgetful_fmu(path: Path) -> Path:
    """Build the FMU of FMI 2.0 whose saved states are not complete."""
    return _build_toy(path, "forgetful", platform=fmpy.platform)


def build_strict_fmu(path: Path, version: int = 2) -> Path:
    """Build the FMU of FMI 2.0 or 3.0 that refuses steps past its parameter `last`."""
    if version == 2:
        return _build_toy(path, "strict", macros={"FMI": version}, platform=fmpy.platform)
    return _build_toy(path, "strict_3", macros={"FMI": version}, source="strict")


def build_faulty_fmu(
    folder: Path, *, rollback: bool = True, name: str = "Faulty", interpolate: bool = True
) -> Path:
    """Build the FMU that fails as its parameter `fault` says, as `name`.fmu in the folder.

    Without `rollback` it declares no FMU states, without `interpolate` no derivatives of inputs;
    it then refuses these calls with fmi2Error.
    """
    flags = {"rollback": rollback, "interpolate": interpolate}
    placeholders = {key: _text(value) for key, value in flags.items()}
    macros = {key.upper(): int(value) for key, value in flags.items()}
    return _build_toy(folder / f"{name}.fmu", "faulty", placeholders, macros, fmpy.platform)


MARK = "FAULTY_HANGS"
"""Environment variable with the name of a file that exists when a step hangs."""


class Fault(IntEnum):
    """What goes wrong: values of the parameter `fault`. A step passes `at` if it ends later."""

    NONE = 0
    DISCARD = 1  # Steps that would pass `at` are discarded
    ERROR = 2  # The step that would pass `at` answers fmi2Error
    FATAL = 3  # The step that would pass `at` answers fmi2Fatal
    NAN_Y = 4  # From the step that passes `at` on the output y is NaN
    TERMINATE = 5  # The step that would pass `at` ends there, discarded, and the FMU asks to end the run
    GET_REAL = 6  # fmi2GetReal answers fmi2Error after `at`
    SET_REAL = 7  # fmi2SetReal answers fmi2Error after `at`
    NAN_Z = 8  # From the step that passes `at` on the output z is NaN
    PENDING = 9  # The step that would pass `at` answers fmi2Pending, and is never done
    EXIT_INITIALIZATION = 10  # fmi2ExitInitializationMode answers fmi2Error
    ENTER_INITIALIZATION = 11  # fmi2EnterInitializationMode answers fmi2Error
    GET_STATE = 12  # fmi2GetFMUstate answers fmi2Error after `at`
    WARNING = 13  # Steps that pass `at` are done with fmi2Warning
    EXIT = 14  # The step that would pass `at` ends the process with exit code 0
    SEGFAULT = 15  # The step that would pass `at` ends the process with SIGSEGV
    ABORT = 16  # The step that would pass `at` ends the process with SIGABRT
    HANG = 17  # The step that would pass `at` never returns. Before, it makes the file that `MARK` names
    SEGFAULT_GET_REAL = 18  # fmi2GetReal ends the process with SIGSEGV after `at`
    SEGFAULT_INITIALIZATION = 19  # fmi2ExitInitializationMode ends the process with SIGSEGV
    SEGFAULT_TERMINATE = 20  # fmi2Terminate ends the process with SIGSEGV
    SEGFAULT_FREE = 21  # fmi2FreeInstance ends the process with SIGSEGV
    SEGFAULT_FREE_STATE = 22  # fmi2FreeFMUstate ends the process with SIGSEGV
    NEGATIVE = 23  # The step that would pass `at` answers -1, which is not a status, and is not done
    HUGE_STATE = 24  # fmi2SerializedFMUstateSize answers 2^60 bytes after `at`
    ORPHAN = 25  # The step that would pass `at` ends the process with exit code 3, and leaves a copy
    GARBLE = 26  # The step that passes `at` writes to all open files, but for the first three
    HANG_TERMINATE = 27  # fmi2Terminate never returns
    SET_STATE = 28  # fmi2SetFMUstate answers fmi2Error after `at`
    SET_DERIVATIVE = 29  # fmi2SetRealInputDerivatives answers fmi2Error after `at`


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
        """Calls after fmi2Fatal, except fmi2FreeInstance."""
        return self._library.faulty_calls_after_fatal()


# ---- FMI 3.0 -----------------------------------------------------------------------------------


def build_all_types_3_fmu(path: Path) -> Path:
    """Build the FMU with all types of FMI 3.0, arrays, and steps that return early or are discarded."""
    return _build_toy(path, "all_types_3")


def build_state_space_fmu(path: Path) -> Path:
    """Build the FMU with structural parameters: sizes of the matrices of its state space."""
    return _build_toy(path, "state_space")


CLOCKS = {
    "periodic": (1, 'intervalVariability="constant" intervalDecimal="0.1" shiftDecimal="0.25"'),
    "fixed": (2, 'intervalVariability="fixed"'),
    "changing": (3, 'intervalVariability="changing"'),
    "countdown": (4, 'intervalVariability="countdown"'),
    "triggered": (0, 'intervalVariability="triggered"'),
}
"""The clocks of the FMU with events, each with its number in the C file and its attributes."""

_CLOCK = """<Clock name="tick" valueReference="20" causality="input" {}/>
    <Float64 name="w" valueReference="21" causality="input" variability="discrete" start="0" clocks="20"/>
    <Float64 name="sum" valueReference="22" causality="output" variability="discrete" clocks="20"/>"""


def build_event_fmu(
    path: Path, events: bool = True, early: bool = True, varies: bool = True, clock: str | None = None
) -> Path:
    """Build the FMU with events and a clock, which refuses calls at the wrong time.

    Args:
        path: The FMU file.
        events: Whether it has event mode.
        early: Whether its steps may end early.
        varies: Whether it can do steps of any size.
        clock: The kind of its clock, one of `CLOCKS`; without a clock by default.
    """
    number, attributes = CLOCKS[clock] if clock else (0, "")
    placeholders = {"events": _text(events), "early": _text(early), "varies": _text(varies)}
    placeholders["clocks"] = _CLOCK.format(attributes) if clock else ""
    placeholders["structure"] = '<Output valueReference="22" dependencies="20 21"/>' if clock else ""
    return _build_toy(path, "events", placeholders, {"CLOCK": number, "VARIES": int(varies)})


_SUB = """<Clock name="beat" valueReference="31" causality="input" intervalVariability="constant"
      intervalDecimal="0.1"/>
    <Clock name="sub" valueReference="32" causality="input" clocks="31" intervalVariability="constant"
      intervalDecimal="{}"/>
    <Int32 name="beats" valueReference="33" causality="output" variability="discrete"/>
    <Int32 name="subs" valueReference="34" causality="output" variability="discrete"/>"""


def build_trigger_fmu(path: Path, sub: float | None = None) -> Path:
    """Build the FMU with output clocks and triggered input clocks.

    Args:
        path: The FMU file.
        sub: Interval in s of a clock that depends on a periodic one; without both by default.
    """
    has_sub = sub is not None
    structure = '<Output valueReference="33"/><Output valueReference="34"/>' if has_sub else ""
    placeholders = {"clocks": _SUB.format(sub) if has_sub else "", "structure": structure}
    return _build_toy(path, "triggers", placeholders, {"SUB": int(has_sub)})
