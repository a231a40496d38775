"""Check the dependencies of libraries on the system."""

import ctypes
import re
from collections.abc import Iterator
from typing import Any

import fmpy

from ..check import check
from ..libraries import (
    Library,
    find_dependencies_file,
    list_libraries,
    list_needed_libraries,
    parse_library,
)
from ..messages import Breach, Problem, join_few_names, judge_problems
from ..subject import Subject
from ..verdict import CheckOutcome, fmi3, in_both, noted, skipped

_EVERYWHERE = re.compile(
    r"""
    lib(c|m|dl|rt|pthread|util|gcc_s|stdc\+\+)\.so(\.\d+)? | ld-(linux|musl)[-.\w]*
    | libSystem\.B\.dylib | libc\+\+(abi)?\.\d\.dylib | libobjc\.A\.dylib
    | (api|ext)-ms-win-[-\w]+\.dll | (kernel|user|gdi|advapi|shell|ole|oleaut|ws2_|comdlg)32\.dll
    | (ntdll|msvcrt|ucrtbase|bcrypt|crypt32|secur32|shlwapi|version|winmm|imagehlp|rpcrt4|psapi|dbghelp)\.dll
    | (comctl32|netapi32|wsock32|mswsock|wintrust|dhcpcsvc|iphlpapi|dnsapi|userenv|setupapi|cfgmgr32)\.dll
    | (wtsapi32|mpr|ncrypt|powrprof|normaliz|uxtheme|msimg32|opengl32|glu32)\.dll | winspool\.drv
    """,
    re.VERBOSE | re.IGNORECASE,
)
"""Libraries that come with every GNU/Linux, macOS or Windows."""

_ORIGIN = fmi3(
    "2.5.1.4.1",
    'RPATH="$ORIGIN" should be set when building ELF binaries to allow dynamic loading of dependencies on '
    "the target machine.",
)
_SYSTEM_FOLDER = re.compile(r"/(usr/(local/)?)?lib(32|64)?(/[^/]*-linux-[^/]*)?/?")
"""Folders with the libraries of a system, which every program finds without a path."""

_UNDEFINED = 0
"""Section index of symbols that other libraries define."""


@check(
    "binaries.imports",
    "Libraries need only standard system libraries",
    in_both(
        "2.3",
        "2.5.1.4.1",
        "Shared libraries should be statically linked against their dependencies [e.g. the Visual Studio C "
        "Runtime on Windows].",
    ),
    "Link it statically, ship it beside the library (with the RPATH $ORIGIN), or name it in "
    "documentation/externalDependencies.txt.",
    needs=("binaries.present",),
)
def imports(subject: Subject) -> CheckOutcome:
    """Check that every needed library and function is standard or shipped with the FMU."""
    found = [
        (one, binary) for one in list_libraries(subject) if (binary := parse_library(one.path)) is not None
    ]
    if not found:
        return skipped("There are no readable binaries.")
    doubts = [p for one, binary in found for p in (*_needed(one, binary), *_undefined(one, binary))]
    paths = [p for one, binary in found for p in _foreign_paths(one, binary)]
    if doubts and not paths and (documented := find_dependencies_file(subject)):
        return noted(f"{doubts[0]} {documented} is there to document what it needs.", details=tuple(doubts))
    fine = f"{join_few_names([str(one) for one, _ in found])} need only standard libraries."
    return judge_problems((), fine, [*doubts, *paths])


def _needed(library: Library, binary: Any) -> Iterator[str]:
    shipped = {p.name.lower() for p in library.path.parent.iterdir()}
    names = [name.rpartition("/")[2] for name in list_needed_libraries(binary)]
    unusual = [n or "''" for n in names if not _EVERYWHERE.fullmatch(n) and n.lower() not in shipped]
    if unusual:
        yield f"{library} needs {join_few_names(unusual)}, which some systems do not have."


def _foreign_paths(library: Library, binary: Any) -> Iterator[Problem]:
    """Yield folders of the machine of the exporter in which a Linux library looks for others."""
    import lief

    if not isinstance(binary, lief.ELF.Binary):
        return
    for entry in binary.dynamic_entries:
        if isinstance(entry, lief.ELF.DynamicEntryRpath):
            kind, paths = "RPATH", entry.rpath
        elif isinstance(entry, lief.ELF.DynamicEntryRunPath):
            kind, paths = "RUNPATH", entry.runpath
        else:
            continue
        folders = [f for f in str(paths).split(":") if f]
        other = [f for f in folders if not f.startswith(("$ORIGIN", "${ORIGIN}"))]
        if foreign := [f for f in other if not _SYSTEM_FOLDER.fullmatch(f)]:
            what = f"{library} looks for libraries in {join_few_names(foreign)} ({kind})"
            yield Breach(f"{what}, which is not in the FMU.", _ORIGIN)


def _undefined(library: Library, binary: Any) -> Iterator[str]:
    """Yield a warning about functions that a Linux library needs, but that no library it links has."""
    import lief

    if not isinstance(binary, lief.ELF.Binary):
        return
    imported = [s for s in binary.dynamic_symbols if s.shndx == _UNDEFINED and s.name]
    wanted = [s for s in imported if s.binding != lief.ELF.Symbol.BINDING.WEAK]
    open_ones = sorted({str(s.name) for s in wanted if not _versioned(s)})
    if open_ones and library.platform in (fmpy.platform, fmpy.platform_tuple):
        named = [handle for name in list_needed_libraries(binary) if (handle := _handle(name)) is not None]
        open_ones = [name for name in open_ones if not any(hasattr(handle, name) for handle in named)]
    elif any(not _EVERYWHERE.fullmatch(name) for name in list_needed_libraries(binary)):
        return
    if open_ones:
        yield f"{library} needs {join_few_names(open_ones)}, which none of its linked libraries has."


def _versioned(symbol: Any) -> bool:
    return bool(symbol.has_version and symbol.symbol_version.has_auxiliary_version)


def _handle(name: str) -> Any:
    """Load a library of this system. Return None if there is none with this name."""
    if not _EVERYWHERE.fullmatch(name):
        return None
    try:
        return ctypes.CDLL(name)
    except OSError:
        return None
