"""What a library needs of the system that it is loaded on."""

import ctypes
import re
from collections.abc import Iterator
from typing import Any

import fmpy

from ..check import check
from ..libraries import Library, list_libraries, list_needed_libraries, parse_library
from ..messages import join_few_names, judge_problems
from ..subject import Subject
from ..verdict import CheckOutcome, Clause, skipped

_EVERYWHERE = re.compile(
    r"""
    lib(c|m|dl|rt|pthread|util|gcc_s|stdc\+\+)\.so(\.\d+)? | ld-(linux|musl)[-.\w]*
    | libSystem\.B\.dylib | libc\+\+(abi)?\.\d\.dylib | libobjc\.A\.dylib
    | (api|ext)-ms-win-[-\w]+\.dll | (kernel|user|gdi|advapi|shell|ole|oleaut|ws2_|comdlg)32\.dll
    | (ntdll|msvcrt|ucrtbase|bcrypt|crypt32|secur32|shlwapi|version|winmm|imagehlp|rpcrt4|psapi|dbghelp)\.dll
    """,
    re.VERBOSE | re.IGNORECASE,
)
"""Libraries that a plain system has: GNU/Linux, macOS, Windows."""
_UNDEFINED = 0
"""The section of symbols that are to be found elsewhere."""


@check(
    "binaries.imports",
    "Libraries need nothing unusual",
    Clause(
        "2.3",
        "Shared libraries should be statically linked against their dependencies [e.g. the Visual Studio C "
        "Runtime on Windows].",
    ),
    "Link it statically, ship it beside the library, or name it in documentation/externalDependencies.txt.",
    needs=("binaries.symbols",),
)
def imports(subject: Subject) -> CheckOutcome:
    """Every library and function that is needed is there on any system, or shipped."""
    found = [
        (one, binary) for one in list_libraries(subject) if (binary := parse_library(one.path)) is not None
    ]
    if not found:
        return skipped("There are no binaries that can be read.")
    doubts = [p for one, binary in found for p in (*_needed(one, binary), *_undefined(one, binary))]
    return judge_problems(
        (), f"Nothing unusual is needed by {join_few_names([str(one) for one, _ in found])}.", doubts
    )


def _needed(library: Library, binary: Any) -> Iterator[str]:
    shipped = {p.name.lower() for p in library.path.parent.iterdir()}
    names = [name.rpartition("/")[2] for name in list_needed_libraries(binary)]
    unusual = [n or "''" for n in names if not _EVERYWHERE.fullmatch(n) and n.lower() not in shipped]
    if unusual:
        yield f"{library} needs {join_few_names(unusual)}, which not every system has."


def _undefined(library: Library, binary: Any) -> Iterator[str]:
    """Functions that a library for Linux expects its host to have, as no library that it names has them."""
    import lief

    if not isinstance(binary, lief.ELF.Binary):
        return
    imported = [s for s in binary.dynamic_symbols if s.shndx == _UNDEFINED and s.name]
    wanted = [s for s in imported if s.binding != lief.ELF.Symbol.BINDING.WEAK]
    open_ones = sorted({str(s.name) for s in wanted if not _versioned(s)})
    if open_ones and library.platform == fmpy.platform:
        named = [handle for name in list_needed_libraries(binary) if (handle := _handle(name)) is not None]
        open_ones = [name for name in open_ones if not any(hasattr(handle, name) for handle in named)]
    elif any(not _EVERYWHERE.fullmatch(name) for name in list_needed_libraries(binary)):
        return
    if open_ones:
        yield f"{library} needs {join_few_names(open_ones)}, which no library that it names has."


def _versioned(symbol: Any) -> bool:
    return bool(symbol.has_version and symbol.symbol_version.has_auxiliary_version)


def _handle(name: str) -> Any:
    """A library of this system; None where it has none of the name."""
    if not _EVERYWHERE.fullmatch(name):
        return None
    try:
        return ctypes.CDLL(name)
    except OSError:
        return None
