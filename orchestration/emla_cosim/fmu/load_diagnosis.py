"""Why the library of an FMU cannot be loaded on this machine, and what to do about it."""

import ctypes
import os
import platform
import re
import sys
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from ..base.errors import join_names
from ..base.wording import shorten_line
from .library_sources import find_source, find_system_with_glibc, find_version_of_gcc, parse_version

_LONGEST = 300
"""Most letters of the loader's message."""

_NO_FILE = re.compile(
    r"(?:Library not loaded: |^)(?:\S*/)?([^/\s:]+): cannot open shared object file|@rpath/(\S+)"
)
_VERSION = re.compile(r"^(?:\S*/)?([^/\s:]+): version [`']([\w.]+)' not found")
_SYMBOL = re.compile(r"undefined symbol: (\w+)|symbol not found in flat namespace '?_?(\w+)")
_MODULE = re.compile(r"No module named '?([\w.]+)'?")
_PYTHON_SYMBOL = re.compile(r"_?Py[A-Z_]\w*")
_LAUNCHER = "resources/launch.toml"
"""The file in which FMUs of UniFMU name the program that they start."""

_PROCESSORS = {"x86_64": "x86_64", "amd64": "x86_64", "arm64": "aarch64", "aarch64": "aarch64"}
_SYSTEMS = {"linux": "Linux", "darwin": "macOS", "win32": "Windows"}


class LoadFailure(NamedTuple):
    """Why a library cannot be loaded.

    Attributes:
        fact: The end of a message that begins with the library, without a full stop.
        remedy: What to do, as a message.
    """

    fact: str
    remedy: str


def diagnose_library(library: Path, error: BaseException) -> LoadFailure:
    """Return why the system could not load a library.

    Args:
        library: The library.
        error: What ctypes or fmpy raised.
    """
    text = _message(library, error)
    binary = _parse(library)
    # the most specific cause comes first: a library for another system lacks symbols, too
    rules = (
        _diagnose_target(binary),
        _diagnose_versions(binary, text),
        _diagnose_missing(library, binary, text),
        _diagnose_symbol(text),
        _diagnose_rights(library, text),
    )
    return next(filter(None, rules), None) or LoadFailure(
        f"cannot be loaded: {text}", "Export the FMU again; `ldd` shows what its library needs."
    )


def explain_python_needs(folder: Path, messages: Iterable[str]) -> str:
    """Return what an FMU with an interpreter lacks, as sentences; empty if nothing shows that it lacks any.

    Args:
        folder: The unpacked FMU.
        messages: What it said when it failed to start.
    """
    modules = dict.fromkeys(m[1].partition(".")[0] for text in messages for m in _MODULE.finditer(text))
    if modules:
        names = join_names([f"'{name}'" for name in modules])
        listed = folder / "resources" / "requirements.txt"
        install = f"-r {listed.name}, a file in its resources" if listed.is_file() else " ".join(modules)
        where = "that it starts" if _read_launcher(folder) else f"of emla, which is {sys.executable}"
        return (
            f"It needs the Python module {names}. Install it for the Python {where}: `pip install {install}`."
        )
    if launcher := _read_launcher(folder):
        return (
            f"It starts the program `{launcher}` (UniFMU, {_LAUNCHER}). Install that program and its "
            "packages, and make it available in PATH."
        )
    return ""


def describe_machine() -> str:
    """Return system and processor of this machine, such as `Linux on x86_64`."""
    machine = platform.machine().lower()
    return f"{_SYSTEMS.get(sys.platform, sys.platform)} on {_PROCESSORS.get(machine, machine)}"


def _message(library: Path, error: BaseException) -> str:
    """Return the loader's message without the folder of the library, in one line."""
    text = str(error)
    text = text.removeprefix(f"Failed to load shared library {library}. ")
    text = text.replace(f"{library.parent}{os.sep}", "")
    return shorten_line(text.strip().rstrip("."), _LONGEST)


def _parse(library: Path) -> Any:
    import lief  # slow to load, and only failures need it

    lief.logging.disable()
    with suppress(Exception):  # LIEF raises several kinds
        binary = lief.parse(str(library))
        return binary.at(0) if isinstance(binary, lief.MachO.FatBinary) else binary
    return None


def _diagnose_target(binary: Any) -> LoadFailure | None:
    """Diagnose a library that is none, or is for another system or processor."""
    import lief

    if binary is None:
        return LoadFailure("is not a shared library", "Download the FMU again, or export it again.")
    formats = {lief.ELF.Binary: "Linux", lief.PE.Binary: "Windows", lief.MachO.Binary: "macOS"}
    system = next((name for kind, name in formats.items() if isinstance(binary, kind)), "another system")
    header = binary.abstract.header
    names = {"ARM64": "aarch64", "ARM": "aarch32"}
    processor = str(header.architecture).rpartition(".")[2]
    target = f"{system} on {names.get(processor, processor.lower())}"
    if target == describe_machine():
        return None
    bits = " (32 bits)" if header.is_32 else ""
    return LoadFailure(
        f"is for {target}{bits}, but this machine is {describe_machine()}",
        "Export the FMU for this platform.",
    )


def _diagnose_versions(binary: Any, text: str) -> LoadFailure | None:
    """Diagnose a library that needs newer versions of system libraries."""
    if (match := _VERSION.search(text)) is None:
        return None
    holder, needed = match[1], max(_list_versions_of_family(binary, match[2]), key=parse_version)
    family, _, number = needed.rpartition("_")
    if family == "GLIBC":
        glibc_here = ""
        with suppress(OSError, ValueError, AttributeError, IndexError):  # systems without glibc
            glibc_here = f"; this machine has {(os.confstr('CS_GNU_LIBC_VERSION') or '').split()[-1]}"
        systems = find_system_with_glibc(number)
        newer = f"{systems} or newer" if systems else "a newer system"
        return LoadFailure(
            f"needs glibc {number} ({needed}){glibc_here}",
            f"Run it on {newer}, also in a container, or build the FMU on an older system.",
        )
    compiler = find_version_of_gcc(needed)
    newer = f" of GCC {compiler} or newer" if compiler else ""
    return LoadFailure(
        f"needs a newer {holder}, with {needed}",
        f"Install the library{newer}, or link the FMU with -static-libgcc -static-libstdc++.",
    )


def _list_versions_of_family(binary: Any, needed: str) -> Iterator[str]:
    """Yield all versions of the same family that a library needs; the loader names only the first."""
    yield needed
    for requirement in getattr(binary, "symbols_version_requirement", ()):
        names = (str(auxiliary.name) for auxiliary in requirement.get_auxiliary_symbols())
        yield from (n for n in names if n.rpartition("_")[0] == needed.rpartition("_")[0])


def _diagnose_missing(library: Path, binary: Any, text: str) -> LoadFailure | None:
    """Diagnose libraries that this machine lacks."""
    reported = [name for m in _NO_FILE.finditer(text) if (name := m[1] or m[2])]
    reported = [name for name in reported if name != library.name]
    if not reported and sys.platform != "win32":  # Windows does not name it
        return None
    unreported = [
        name for name in _list_needed(binary) if name not in reported and _is_missing(library, name)
    ]
    if not (missing := [*reported, *unreported]):
        return None
    in_same_folder = [name for name in missing if (library.parent / name).is_file()]
    if in_same_folder:
        return LoadFailure(
            f"does not find {join_names(in_same_folder)}, although it is in the same folder",
            "Report it to the exporter: it needs the RPATH $ORIGIN. Until then, set LD_LIBRARY_PATH.",
        )
    sources = {name: find_source(name) for name in missing}
    remedies = [f"{name} {source}." for name, source in sources.items() if source]
    if unknown := [name for name, source in sources.items() if not source]:
        where = "`apt-file search` finds packages of Debian that have it"
        remedies.append(f"Install {join_names(unknown)}, or ask the exporter to ship it; {where}.")
    fact = f"needs {join_names(missing)}, which this machine does not have"
    return LoadFailure(fact, " ".join(remedies))


def _list_needed(binary: Any) -> list[str]:
    return [str(getattr(x, "name", x)).rpartition("/")[2] for x in getattr(binary, "libraries", ())]


def _is_missing(library: Path, name: str) -> bool:
    """Return whether the loader does not find a library; the FMU's own library would have loaded it, too."""
    if (library.parent / name).is_file():
        return False
    try:
        ctypes.CDLL(name)
    except OSError as error:
        return (name in str(error) and "cannot open" in str(error)) or sys.platform == "win32"
    return False


def _diagnose_symbol(text: str) -> LoadFailure | None:
    """Diagnose a function that no library has."""
    if (match := _SYMBOL.search(text)) is None:
        return None
    name = match[1] or match[2]
    if name.startswith(("fmi2", "fmi3")):
        return LoadFailure(
            f"does not export {name}", "Report it to the exporter: the standard requires all functions."
        )
    if _PYTHON_SYMBOL.fullmatch(name):
        version = f"{sys.version_info.major}.{sys.version_info.minor}"
        return LoadFailure(
            f"needs {name} of another version of Python than {version}",
            "Run emla with the version of Python for which the FMU was exported.",
        )
    return LoadFailure(
        f"needs {name}, which none of its libraries has",
        "Report it to the exporter: a source file or a library was not linked.",
    )


def _diagnose_rights(library: Path, text: str) -> LoadFailure | None:
    """Diagnose a folder from which nothing may be run, and a stack that must be executable."""
    if "failed to map segment" in text or "Permission denied" in text:
        return LoadFailure(
            f"cannot be loaded from '{tempfile.gettempdir()}', from which this system runs no programs",
            "Set TMPDIR to another folder, which is not mounted with noexec.",
        )
    if "executable stack" in text:
        return LoadFailure(
            "needs an executable stack, which this system refuses",
            f"Report it to the exporter; `patchelf --clear-execstack {library.name}` mends the library.",
        )
    return None


def _read_launcher(folder: Path) -> str:
    """Return the program that an FMU of UniFMU starts here; empty for FMUs of other tools."""
    import tomllib  # only failures need it

    path = folder / _LAUNCHER
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
        words = table["command"][{"darwin": "macos", "win32": "windows"}.get(sys.platform, "linux")]
        return shorten_line(" ".join(map(str, words)), _LONGEST)
    except (OSError, ValueError, KeyError, TypeError):
        return ""
