"""FMUs with variables of all types that do one thing wrong: a good one, in C, with a fault."""

import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from string import Template

import fmpy

from emla_cosim.verification.verdict import Verdict
from fmublock.archive import write_archive
from tests.support.broken.broken import Broken
from tests.support.handwritten_fmu import compile_library

_FOLDER = Path(__file__).parent
_GUID = "{7e9ed000-0000-4000-8000-000000000000}"
_STRUCTURE = {
    "y": "1 2 5 13",
    "sum": "8",
    "flag": "13",
    "initial_y": "1 2 5 13",
    "initial_sum": "8 9",
    "initial_flag": "13 14",
}
"""Dependencies of outputs, in Outputs and in InitialUnknowns, as they are."""


@cache
def _faults() -> dict[str, int]:
    """The numbers of the faults, by name, from the header that has them."""
    text = re.sub(r"/\*.*?\*/", "", (_FOLDER / "typed_faults.h").read_text(encoding="utf-8"))
    found = re.search(r"enum \{([^}]*)\}", text)
    assert found
    return {name.strip(): k for k, name in enumerate(found[1].split(","))}


def build_typed_fmu(folder: Path, fault: str = "NONE", name: str = "Typed", **structure: str) -> Path:
    """Build the FMU in a folder, with one fault, or with other dependencies than it has."""
    template = Template((_FOLDER / "typed.xml").read_text(encoding="utf-8"))
    path = folder / f"{name}.fmu"
    interpolates = str(fault not in ("STEP_DOES_NOTHING", "INPUT_IGNORED")).lower()
    values = {"name": name, "guid": _GUID, "interpolates": interpolates, **_STRUCTURE, **structure}
    described = template.substitute(values)
    content = {
        "modelDescription.xml": described.encode(),
        f"binaries/{fmpy.platform}/{name}{fmpy.sharedLibraryExtension}": _library(fault == "OTHER_VERSION"),
        "documentation/index.html": b"<!doctype html><title>Typed</title><p>It does what it says.",
        "documentation/licenses/license.txt": b"Do what you want.",
        "resources/fault.txt": f"{_faults()[fault]}\n".encode(),
    }
    write_archive(path, content)
    return path


@cache
def _library(other_version: bool) -> bytes:
    """Compiled once, for all faults but that of the version."""
    version = '"1.0"' if other_version else "fmi2Version"
    return compile_library(_FOLDER / "typed.c", {"MODEL_GUID": f'"{_GUID}"', "COMPILED_VERSION": version})


def _built(fault: str, name: str, structure: dict[str, str]) -> Callable[[Path], Path]:
    return lambda folder: build_typed_fmu(folder, fault, name, **structure)


def _fails(fault: str, check: str, what: str) -> Broken:
    name = _named(fault)
    return Broken(name, what, check, _built(fault, name, {}))


def _warns(fault: str, check: str, what: str) -> Broken:
    name = _named(fault)
    return Broken(name, what, check, _built(fault, name, {}), verdict=Verdict.WARNING)


def _lacks(name: str, what: str, **structure: str) -> Broken:
    """Return an FMU whose dependencies lack one."""
    return Broken(name, what, "dependencies.observed", _built("NONE", name, structure))


def _named(fault: str) -> str:
    return "".join(word.capitalize() for word in fault.split("_"))


TYPED: list[Broken] = [
    _fails("OTHER_VERSION", "binaries.version", "`fmi2GetVersion` returns 1.0"),
    _fails("START_REAL", "values.start", "a Real parameter starts with another value than declared"),
    _fails("START_INTEGER", "values.start", "an Integer parameter starts with another value than declared"),
    _fails("START_BOOLEAN", "values.start", "a Boolean parameter starts with another value than declared"),
    _fails("START_STRING", "values.start", "a String parameter starts with another value than declared"),
    _fails("BOOLEAN_42", "values.booleans", "a Boolean is 42"),
    _fails("ENUMERATION_OUTSIDE", "values.enumerations", "an Enumeration has a value that is no item"),
    _fails("STRING_NULL", "values.strings", "a String is NULL"),
    _fails("STRING_NOT_UTF8", "values.strings", "a String is not UTF-8"),
    _fails("STRING_FREED", "values.strings", "a String is in memory that is freed"),
    _fails("STRING_UNMAPPED", "values.strings", "a String is in memory that does not exist"),
    _fails("STRING_ON_THE_STACK", "values.strings", "a String is on the stack of a function that returned"),
    _fails("RESET_KEEPS_PARAMETER", "values.reset", "`fmi2Reset` keeps a Real parameter"),
    _fails("RESET_KEEPS_STRING", "values.reset", "`fmi2Reset` keeps a String parameter"),
    _fails("RESET_KEEPS_INPUT", "values.reset", "`fmi2Reset` keeps an Integer input"),
    _fails("SHARED_PARAMETER", "values.shared", "all instances share a parameter"),
    _fails("STATE_POINTER_KEPT", "state.freed", "`fmi2FreeFMUstate` keeps the pointer"),
    _fails("STATE_FORGETS_TUNABLE", "values.state", "a state lacks a tunable parameter"),
    _fails("STATE_FORGETS_BOOLEAN", "values.state", "a state lacks a Boolean"),
    _fails("STATE_FORGETS_STRING", "values.state", "a state lacks a String"),
    _fails("STATE_FORGETS_INPUT", "values.state", "a state lacks an Integer input"),
    _fails("BYTES_FORGET_TUNABLE", "values.state", "the bytes of a state lack a tunable parameter"),
    _lacks("LackBoolean", "a dependency on a Boolean input is not declared", y="1 2 5", initial_y="1 2 5"),
    _lacks("LackInteger", "a dependency on an Integer input is not declared", sum="", initial_sum="9"),
    _lacks("LackParameter", "a dependency on a parameter is not declared", initial_sum="8"),
    _fails("INTERPOLATION_IGNORED", "exchange.interpolation", "derivatives of inputs are not used"),
    _fails("STEP_DOES_NOTHING", "steps.integrate", "`fmi2DoStep` does nothing"),
    _fails("FILE_LEFT_OPEN", "process.resources", "each instance leaves a file open"),
    _fails("THREAD_LEFT", "process.resources", "each instance leaves a thread behind"),
    _fails("CHILD_LEFT", "process.resources", "each instance leaves a child process behind"),
    _fails("ORPHAN_LEFT", "process.resources", "each instance leaves a process in another session behind"),
    _fails("SIGNAL_TO_ITSELF", "run.completes", "`fmi2DoStep` sends SIGTERM to its process"),
    _fails("SIGNAL_TO_THE_GROUP", "run.completes", "`fmi2DoStep` sends SIGKILL to its process group"),
    _fails("SIGNAL_TO_THE_PARENT", "run.completes", "`fmi2DoStep` sends SIGKILL to the parent process"),
    _warns("START_STATE", "values.start", "a state starts with another value than declared"),
    _warns("INPUT_IGNORED", "exchange.inputs", "inputs are not used"),
    _warns("INPUT_SIGN", "steps.integrate", "steps use an input with the wrong sign"),
    _warns("WORKING_FOLDER", "process.settings", "it changes the working folder"),
    _warns("LOCALE", "process.settings", "it changes the locale"),
    _warns("ROUNDING", "process.settings", "it changes the rounding of floating-point numbers"),
    _warns("FLUSH_TO_ZERO", "process.settings", "it lets the processor replace tiny numbers by 0"),
    _warns("TRAPS", "process.settings", "it lets a division by 0 end the process"),
    _warns("SIGNAL_HANDLER", "process.settings", "it handles a signal"),
    _warns("OWN_FILE_WRITTEN", "process.files", "it writes into its own folder"),
    _warns("USER_FILE_WRITTEN", "process.files", "it writes into the working folder"),
    _warns("HOME_FILE_WRITTEN", "process.files", "it writes into the user's home folder"),
    _warns("FLOOD_ERRORS", "process.output", "it writes much to standard error"),
    _warns("UNLOAD_ABORTS", "process.unload", "it aborts when its library is unloaded"),
]
"""One for each fault, those that warn last."""
