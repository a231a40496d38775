"""Checks of libraries: complete, for their platform, with what they import and export."""

import ctypes
import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import Any, NamedTuple

import fmpy

from emla_cosim.fmu.file import explain_missing_library, missing_bytes
from emla_cosim.fmu.load_diagnosis import diagnose_library

from ..c_sources import list_source_files
from ..check import CheckOutcome, blocked, check, failed, noted, passed, quote, skipped, warned
from ..libraries import (
    NAMES_OF_VERSION_2,
    SUFFIXES,
    Library,
    describe_mismatch,
    find_dependencies_file,
    find_suffix,
    list_exports,
    list_functions,
    list_libraries,
    list_needed_libraries,
    list_platforms,
    parse_library,
    suggest_platform,
)
from ..messages import Breach, Problem, join_few_names, judge_problems, shorten_sentence
from ..subject import Subject
from ..subprocess_run import note

_THIS_PLATFORM = (fmpy.platform_tuple, fmpy.platform)
_VERSION_3 = re.compile(rb"3\.0(\.[0-9]+)?")


@check("binaries.platform", needs=("binaries.present",))
def platform(subject: Subject) -> CheckOutcome:
    """Check the names of folders in `binaries`, and the header of every library: system and processor."""
    names = {subject.tree.find(kind).get("modelIdentifier") for kind in subject.kinds}
    problems: list[str] = []
    doubts: list[str] = []
    count, is_here = 0, False
    for folder in list_platforms(subject):
        paths = sorted(p for p in folder.rglob("*") if p.is_file() and p.suffix in SUFFIXES)
        count += len(paths)
        if paths and (suggestion := suggest_platform(folder.name, subject.version)):
            message = f"Tools do not look into binaries/{folder.name} for a library, but into"
            message = f"{message} binaries/{suggestion}."
            (problems if suggestion == folder.name.lower() else doubts).append(message)
            is_here |= suggestion in _THIS_PLATFORM
        for path in paths:
            is_model = path.stem in names and path.parent == folder
            if actual := describe_mismatch(path, folder.name):
                where = f"{folder.name}/{path.relative_to(folder)}"
                message = f"{where} is a library for {actual}, not for {folder.name}."
                (problems if is_model else doubts).append(message)
                is_here |= is_model and folder.name in _THIS_PLATFORM
    if not count:
        return skipped("There are no binaries.")
    fine = f"{count} libraries are for the platforms of their folders."
    return replace(judge_problems(problems, fine, doubts), blocks=is_here)


@check("binaries.version", needs=("binaries.loads",))
def version(subject: Subject) -> CheckOutcome:
    """Check what fmi2GetVersion and fmi2GetTypesPlatform return, before any other call."""
    for library in list_libraries(subject):
        if library.platform not in _THIS_PLATFORM:
            continue
        handle = ctypes.CDLL(str(library.path))
        if subject.version == 3:
            if not _VERSION_3.fullmatch(version_text := _call_text_function(handle, "fmi3GetVersion") or b""):
                return failed(f"fmi3GetVersion of {library} returns {_quote(version_text)}, not '3.0'.")
            continue
        names = ("fmi2GetVersion", "fmi2GetTypesPlatform")
        texts = {name: _call_text_function(handle, name) for name in names}
        if texts["fmi2GetVersion"] != b"2.0":
            message = f"fmi2GetVersion of {library} returns {_quote(texts['fmi2GetVersion'])}, not '2.0'."
            return failed(message)
        if texts["fmi2GetTypesPlatform"] != b"default":
            types_platform = _quote(texts["fmi2GetTypesPlatform"])
            return warned(f"fmi2GetTypesPlatform of {library} returns {types_platform}, not 'default'.")
    if subject.version == 3:
        return passed("It is compiled for FMI 3.0.")
    return passed("It is compiled for FMI 2.0 and the default types.")


def _call_text_function(library: ctypes.CDLL, name: str) -> bytes | None:
    note(name)
    function = getattr(library, name)
    # ctypes takes int for a function without a type, which cuts a pointer
    function.restype, function.argtypes = ctypes.c_char_p, []
    return function()


def _quote(text: bytes | None) -> str:
    return "NULL" if text is None else repr(text[:40].decode(errors="replace"))


_STANDARD_LIBRARY = re.compile(
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

# folders with the libraries of a system, which every program finds without a path
_SYSTEM_FOLDER = re.compile(r"/(usr/(local/)?)?lib(32|64)?(/[^/]*-linux-[^/]*)?/?")

_UNDEFINED = 0
"""Section index of symbols that other libraries define."""


@check("binaries.imports", needs=("binaries.present",))
def imports(subject: Subject) -> CheckOutcome:
    """Check that every needed library and function is standard or shipped with the FMU."""
    parsed = [(library, parse_library(library.path)) for library in list_libraries(subject)]
    libraries = [(library, binary) for library, binary in parsed if binary is not None]
    if not libraries:
        return skipped("There are no readable binaries.")
    doubts = [
        p
        for library, binary in libraries
        for p in (*_find_unusual_libraries(library, binary), *_find_undefined_functions(library, binary))
    ]
    paths = [p for library, binary in libraries for p in _find_foreign_paths(library, binary)]
    if doubts and not paths and (dependencies_file := find_dependencies_file(subject)):
        message = f"{doubts[0]} {dependencies_file} is there to document what it needs."
        return noted(message, details=tuple(doubts))
    fine = f"{join_few_names([str(library) for library, _ in libraries])} need only standard libraries."
    return judge_problems((), fine, [*doubts, *paths])


def _find_unusual_libraries(library: Library, binary: Any) -> Iterator[str]:
    shipped = {p.name.lower() for p in library.path.parent.iterdir()}
    names = [name.rpartition("/")[2] for name in list_needed_libraries(binary)]
    unusual = [n or "''" for n in names if not _STANDARD_LIBRARY.fullmatch(n) and n.lower() not in shipped]
    if unusual:
        yield f"{library} needs {join_few_names(unusual)}, which some systems do not have."


def _find_foreign_paths(library: Library, binary: Any) -> Iterator[Problem]:
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
        absolute_folders = [f for f in folders if not f.startswith(("$ORIGIN", "${ORIGIN}"))]
        if foreign := [f for f in absolute_folders if not _SYSTEM_FOLDER.fullmatch(f)]:
            message = f"{library} looks for libraries in {join_few_names(foreign)} ({kind})"
            yield Breach(f"{message}, which is not in the FMU.", quote("imports.origin"))


def _find_undefined_functions(library: Library, binary: Any) -> Iterator[str]:
    """Yield a warning about functions that a Linux library needs, but that no library it links has."""
    import lief

    if not isinstance(binary, lief.ELF.Binary):
        return
    imported = [s for s in binary.dynamic_symbols if s.shndx == _UNDEFINED and s.name]
    required = [s for s in imported if s.binding != lief.ELF.Symbol.BINDING.WEAK]
    undefined_names = sorted({str(s.name) for s in required if not _has_version(s)})
    if undefined_names and library.platform in (fmpy.platform, fmpy.platform_tuple):
        handles = [handle for n in list_needed_libraries(binary) if (handle := _load_library(n)) is not None]
        undefined_names = [n for n in undefined_names if not any(hasattr(h, n) for h in handles)]
    elif any(not _STANDARD_LIBRARY.fullmatch(name) for name in list_needed_libraries(binary)):
        return
    if undefined_names:
        yield f"{library} needs {join_few_names(undefined_names)}, which none of its linked libraries has."


def _has_version(symbol: Any) -> bool:
    return bool(symbol.has_version and symbol.symbol_version.has_auxiliary_version)


def _load_library(name: str) -> Any:
    """Load a standard library of this system. Return None if it is not standard, or not there."""
    with suppress(OSError):
        return ctypes.CDLL(name) if _STANDARD_LIBRARY.fullmatch(name) else None
    return None


_NAME = quote("binaries.name")


@check("binaries.present", needs=("description.schema",))
def present(subject: Subject) -> CheckOutcome:
    """Check that there is a library for this or another platform, or sources, with the model's name."""
    libraries = list_libraries(subject)
    sources = list_source_files(subject)
    misnamed = list(_find_misnamed(subject))
    problems: list[Problem] = [Breach(library.message, _NAME) for library in misnamed if library.is_similar]
    doubts: list[Problem] = [Breach(library.message, _NAME) for library in misnamed if not library.is_similar]
    missing_kinds = [k for k in subject.kinds if not any(k in library.kinds for library in libraries)]
    if missing_kinds and not sources and not problems:
        folders = ", ".join(p.name for p in list_platforms(subject))
        name = subject.tree.find(missing_kinds[0]).get("modelIdentifier")
        message = f"There are binaries for {folders}, but none has" if folders else "There is no binary with"
        return failed(f"{message} the name {name}, and there are no sources.")
    names = join_few_names(sorted({library.platform for library in libraries}))
    message = f"There are binaries for {names}."
    if not libraries:
        message = "There are sources only."
    elif not any(library.platform in _THIS_PLATFORM for library in libraries):
        message = f"There are binaries for {names}, but none for {fmpy.platform}."
    is_here = any(library.platform in _THIS_PLATFORM for library in misnamed)
    return replace(judge_problems(problems, message, doubts), blocks=is_here or not (libraries or sources))


class _Misnamed(NamedTuple):
    """What is wrong with the libraries of a platform: none, or none with one of the model's names."""

    platform: str
    message: str
    is_similar: bool
    """Whether a library has the name of the model in another spelling, with which tools do not find it."""


def _find_misnamed(subject: Subject) -> Iterator[_Misnamed]:
    """Yield platforms whose libraries lack a name of the model, or that are empty."""
    names = {subject.tree.find(kind).get("modelIdentifier") for kind in subject.kinds}
    for folder in list_platforms(subject):
        suffix = find_suffix(folder.name)
        if not suffix or (subject.version == 3 and folder.name in NAMES_OF_VERSION_2):
            continue
        files = [p for p in sorted(folder.iterdir()) if p.is_file() and p.suffix.lower() in SUFFIXES]
        found_names = {p.stem for p in files if p.suffix == suffix and p.stem in names}
        if not any(folder.iterdir()):
            yield _Misnamed(folder.name, f"binaries/{folder.name} is empty.", False)
        if not files or found_names == names:
            continue
        if found_names:
            expected = join_few_names(sorted(f"{name}{suffix}" for name in names - found_names))
            yield _Misnamed(folder.name, f"binaries/{folder.name} has no {expected}.", False)
            continue
        stems = {prefix + name.casefold() for name in names for prefix in ("", "lib")}
        similar = [p for p in files if p.stem.casefold() in stems and not describe_mismatch(p, folder.name)]
        if not similar and any(describe_mismatch(p, folder.name) for p in files):
            continue  # `binaries.platform` reports it
        expected = join_few_names(sorted(f"{name}{suffix}" for name in names))
        actual = join_few_names([p.name for p in similar or files])
        is_found = suffix == ".dll" and any(p.name.casefold() in expected.casefold() for p in similar)
        message = f"binaries/{folder.name} has {actual}, but no {expected}."
        yield _Misnamed(folder.name, message, bool(similar) and not is_found)  # Windows ignores the case


@check("binaries.symbols", needs=("binaries.present",))
def symbols(subject: Subject) -> CheckOutcome:
    """Check that each library exports every FMI function for the kinds of the FMU."""
    libraries = [c for c in list_libraries(subject) if not describe_mismatch(c.path, c.platform)]
    if not libraries:
        return skipped("There are no binaries.")
    problems = [(c, p) for c in libraries for p in _find_export_problems(c, subject.version)]
    fine = f"All functions are exported by {join_few_names([str(library) for library in libraries])}."
    outcome = judge_problems([p for _, p in problems], fine)
    return replace(outcome, blocks=any(library.platform in _THIS_PLATFORM for library, _ in problems))


def _find_export_problems(library: Library, version: int) -> Iterator[str]:
    """Yield that a library is truncated, cannot be read, or does not export required functions."""
    if missing := missing_bytes(library.path):
        if library.platform not in _THIS_PLATFORM:  # `binaries.loads` reports the others
            yield f"{library} is truncated: its last {missing} bytes are missing."
        return
    note(f"reading {library}", is_reading=True)
    binary = parse_library(library.path)
    if binary is None:
        yield f"{library} is not a readable shared library."
        return
    names = list_exports(binary)
    required = dict.fromkeys(n for kind in library.kinds for n in list_functions(kind, version))
    if missing_names := [name for name in required if name not in names]:
        yield f"{library} does not export {join_few_names(missing_names)}."


@check("binaries.loads", needs=("binaries.platform", "binaries.symbols"))
def loads(subject: Subject) -> CheckOutcome:
    """Check that the system can load the library for this platform."""
    libraries = [candidate for candidate in list_libraries(subject) if candidate.platform in _THIS_PLATFORM]
    if not libraries:
        identifier = subject.tree.find(subject.kinds[0]).get("modelIdentifier")
        return blocked(f"It {explain_missing_library(subject.folder, identifier)}.")
    for library in libraries:
        if missing := missing_bytes(library.path):
            return failed(f"{library} is truncated: its last {missing} bytes are missing.")
    for library in libraries:
        note(f"loading {library}")
        try:
            # loading runs initializers of the library, which may crash: hence the note before
            ctypes.CDLL(str(library.path))
        except (OSError, UnicodeDecodeError) as error:  # the loader's message can quote bytes of the library
            fact, remedy = diagnose_library(library.path, error)
            sentence = shorten_sentence(f"{library} {fact}")
            if dependencies_file := find_dependencies_file(subject):
                return blocked(f"{sentence}; {dependencies_file} lists what it needs.")
            return failed(f"{sentence}.", hint=remedy)
    if subject.description_problem:
        return blocked(subject.description_problem)
    return passed(f"{join_few_names([str(candidate) for candidate in libraries])} can be loaded.")
