"""Why the library of an FMU cannot be loaded on this machine, and what to do about it."""

import ctypes
import os
import platform
import re
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from ..base.errors import join_names
from ..base.wording import shorten_line

_MATLAB = "comes with MATLAB and with the free MATLAB Runtime: install the version with which it was exported"
_INTEL = "comes with the runtime of Intel's compilers: install intel-oneapi-runtime-compilers"

_SOURCES: Mapping[str, str] = {
    r"libgfortran\.so\.(\d)": "is in the Debian package libgfortran{0}",
    r"libquadmath\.so\.0": "is in the Debian package libquadmath0",
    r"libgomp\.so\.1": "is in the Debian package libgomp1",
    r"libstdc\+\+\.so\.6": "is in the Debian package libstdc++6",
    r"libgcc_s\.so\.1": "is in the Debian package libgcc-s1",
    r"libc\+\+\.so\.1": "is in the Debian package libc++1",
    r"libpython(\d)\.(\d+)m?\.so.*": "is in the Debian package libpython{0}.{1}; "
    "the FMU runs only with this version of Python",
    r"libpython3\.so": "is in the Debian package libpython3-dev; the FMU uses Python",
    r"python(\d)(\d+)\.dll": "comes with Python {0}.{1} for Windows; the FMU runs only with this version",
    r"lib(openblas)\.so\.0": "is in the Debian package libopenblas0",
    r"lib(blas|lapack)\.so\.3": "is in the Debian package lib{0}3",
    r"libz\.so\.1": "is in the Debian package zlib1g",
    r"libexpat\.so\.1": "is in the Debian package libexpat1",
    r"libxml2\.so\.2": "is in the Debian package libxml2",
    r"libzmq\.so\.5": "is in the Debian package libzmq5",
    r"libcurl\.so\.4": "is in the Debian package libcurl4",
    r"libuuid\.so\.1": "is in the Debian package libuuid1",
    r"lib(ssl|crypto)\.so\.3": "is in the Debian package libssl3",
    r"lib(ssl|crypto)\.so\.1\.1": "is of OpenSSL 1.1, which current systems do not have: export it again",
    r"libX11\.so\.6": "is in the Debian package libx11-6",
    r"libGL\.so\.1": "is in the Debian package libgl1",
    r"libtbb\.so\.12": "is in the Debian package libtbb12",
    r"libgsl\.so\.(\d+)": "is in the Debian package libgsl{0}",
    r"libgnat-(\d+)\.so.*": "is in the Debian package libgnat-{0}",
    r"libboost_(\w+)\.so\.([\d.]+)": "is in the Debian package libboost-{0}{1}",
    r"libsundials_\w+\.so.*": "is of SUNDIALS, in a Debian package libsundials-*",
    r"libc\.musl-.*": "is of musl: the FMU was built for Alpine Linux; build it for a system with glibc",
    r"libjvm\.so|jvm\.dll": "comes with Java: install it, such as the Debian package default-jre, and set "
    "LD_LIBRARY_PATH to its folder lib/server",
    r"libmonosgen-2\.0\.so.*": "is in the Debian package libmono-2.0-1",
    r"libcudart\.so.*": "comes with CUDA",
    r"lib(mw\w+|mx|mat|eng|ut)\.so.*|mcl\w+\.dll": _MATLAB,
    r"lib(SimulationRuntime|OpenModelicaRuntime|OpenModelicaFMIRuntime|omc)\w*\.so.*": "comes with "
    "OpenModelica: install it, or export with --fmuRuntimeDepends=all",
    r"lib(dymola|ds)\w*\.so.*|dsin\w*\.dll": "comes with Dymola: export with its option for binaries "
    "that need no license or runtime",
    r"lib(iomp5|imf|svml|intlc|irng|irc|ifcore\w*|ifport)\.so.*|lib(iomp5md|mmd|ifcoremd)\.dll": _INTEL,
    r"libmkl_\w+\.so.*|mkl_\w+\.dll": "comes with Intel MKL",
    r"(vcruntime|msvcp|concrt|vcomp)\d+(_\d)?\.dll": "comes with the Visual C++ Redistributable of Microsoft",
    r"(vcruntime|msvcp)\d+d\.dll|ucrtbased\.dll": "is for debugging and comes with Visual Studio only: "
    "build the FMU as a release",
}
"""What to say of a library, by a pattern for its name; `{0}` is the first group of the pattern."""

_GLIBC = {
    "2.28": "Debian 10, Red Hat Enterprise Linux 8",
    "2.31": "Debian 11, Ubuntu 20.04",
    "2.34": "Red Hat Enterprise Linux 9",
    "2.35": "Ubuntu 22.04",
    "2.36": "Debian 12",
    "2.39": "Ubuntu 24.04, Red Hat Enterprise Linux 10",
    "2.41": "Debian 13",
}
"""Systems by their version of glibc."""

_GCC = {
    "GLIBCXX_3.4.26": "9",
    "GLIBCXX_3.4.28": "10",
    "GLIBCXX_3.4.29": "11",
    "GLIBCXX_3.4.30": "12",
    "GLIBCXX_3.4.31": "13.1",
    "GLIBCXX_3.4.32": "13.2",
    "GLIBCXX_3.4.33": "14",
    "GLIBCXX_3.4.34": "15",
    "CXXABI_1.3.13": "11",
    "CXXABI_1.3.14": "13",
    "CXXABI_1.3.15": "14",
    "GFORTRAN_9": "9",
    "GFORTRAN_10": "10",
}
"""Versions of GCC with which versions of its libraries came."""


def find_source(library: str) -> str:
    """Return where a library usually comes from, as the end of a message; empty if that is not known.

    Args:
        library: The name of the file, such as `libgfortran.so.5`.
    """
    for pattern, text in _SOURCES.items():
        if match := re.fullmatch(pattern, library, re.IGNORECASE):
            return text.format(*match.groups())
    return ""


def find_system_with_glibc(version: str) -> str:
    """Return the oldest systems with this version of glibc; empty if the table has none."""
    needed = parse_version(version)
    return next((systems for glibc, systems in _GLIBC.items() if parse_version(glibc) >= needed), "")


def find_version_of_gcc(symbol_version: str) -> str:
    """Return the version of GCC whose libraries have a version such as `GLIBCXX_3.4.30`; empty if unknown."""
    return _GCC.get(symbol_version, "")


def parse_version(version: str) -> tuple[int, ...]:
    """Return the numbers of a version, such as `2.36` or `GLIBCXX_3.4.30`, to compare it with others."""
    return tuple(int(word) for word in re.findall(r"\d+", version))


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
    text = _shorten_message(library, error)
    binary = _parse_library(library)
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


def _shorten_message(library: Path, error: BaseException) -> str:
    """Return the loader's message without the folder of the library, in one line."""
    text = str(error)
    text = text.removeprefix(f"Failed to load shared library {library}. ")
    text = text.replace(f"{library.parent}{os.sep}", "")
    return shorten_line(text.strip().rstrip("."), _LONGEST)


def _parse_library(library: Path) -> Any:
    """Return what LIEF reads of a library; None if it is not one."""
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
        name for name in _list_needed_libraries(binary) if name not in reported and _is_missing(library, name)
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


def _list_needed_libraries(binary: Any) -> list[str]:
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
