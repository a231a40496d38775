"""Checks that libraries are for their platform, and for this version of the FMI."""

import ctypes
import re
from collections.abc import Iterator
from pathlib import Path

import fmpy

from ..binary_headers import NAMES_OF_VERSION_2, read_targets, wanted_target
from ..check import check
from ..libraries import list_libraries, list_platforms
from ..messages import judge_problems
from ..subject import Subject
from ..subprocess_run import note
from ..verdict import CheckOutcome, Clause, failed, fmi3, passed, skipped, warned

_SUFFIXES = (".so", ".dll", ".dylib")
_HERE = (fmpy.platform_tuple, fmpy.platform)
_VERSION_3 = re.compile(rb"3\.0(\.[0-9]+)?")


@check(
    "binaries.platform",
    "Libraries are for the platform of their folder",
    Clause(
        "2.3",
        'The following names are standardized: for Windows: "win32", "win64"- for Linux: "linux32", '
        '"linux64", for Macintosh: "darwin32", "darwin64" where "32" stands for "32-bit x86" and "64" for '
        '"64-bit x86" respectively.',
        in_3=fmi3(
            "2.5.1.4.1",
            "The binaries must be placed in the respective <platformTuple> directory with the general format "
            "<arch>-<sys>.",
        ),
    ),
    "Move the library to the folder of its platform, or build it for this one.",
    needs=("binaries.present",),
)
def platform(subject: Subject) -> CheckOutcome:
    """Check the header of every library below `binaries`: system and processor."""
    names = {subject.tree.find(kind).get("modelIdentifier") for kind in subject.kinds}
    problems: list[str] = []
    doubts: list[str] = []
    count = 0
    for folder in list_platforms(subject):
        for path in sorted(p for p in folder.rglob("*") if p.is_file() and p.suffix in _SUFFIXES):
            count += 1
            is_model = path.stem in names and path.parent == folder
            (problems if is_model else doubts).extend(_misplaced(path, folder))
    if not count:
        return skipped("There are no binaries.")
    if subject.version == 3:
        folders = [folder.name for folder in list_platforms(subject) if folder.name in NAMES_OF_VERSION_2]
        doubts += [f"binaries/{name} is the name of FMI 2.0 for a platform." for name in folders]
    return judge_problems(problems, f"{count} libraries are for the platforms of their folders.", doubts)


def _misplaced(path: Path, folder: Path) -> Iterator[str]:
    wanted, found = wanted_target(folder.name), read_targets(path)
    if wanted is None or not found or wanted in found:
        return
    if wanted == ("darwin", "x86_64") and ("darwin", "aarch64") in found:
        return  # usual for macOS on ARM
    kinds = " and ".join(
        sorted(f"{system} on {processor or 'another processor'}" for system, processor in found)
    )
    yield f"{folder.name}/{path.relative_to(folder)} is a library for {kinds}, not for {folder.name}."


@check(
    "binaries.version",
    "The library is compiled for FMI 2.0",
    Clause(
        "2.1.4",
        'The standard header file as documented in this specification has version "2.0" (so this function '
        'usually returns "2.0").',
        in_3=fmi3(
            "2.2.5",
            "The standard header file as documented in this specification has version 3.0, so this function "
            "returns 3.0.",
        ),
    ),
    "Compile the library with the header files of FMI 2.0, and return fmi2Version and fmi2TypesPlatform.",
    needs=("binaries.loads",),
)
def version(subject: Subject) -> CheckOutcome:
    """Check what fmi2GetVersion and fmi2GetTypesPlatform return, before any other call."""
    for library in (one for one in list_libraries(subject) if one.platform in _HERE):
        loaded = ctypes.CDLL(str(library.path))
        if subject.version == 3:
            if not _VERSION_3.fullmatch(said := _text(loaded, "fmi3GetVersion") or b""):
                return failed(f"fmi3GetVersion of {library} returns {_shown(said)}, not '3.0'.")
            continue
        found = {name: _text(loaded, name) for name in ("fmi2GetVersion", "fmi2GetTypesPlatform")}
        if found["fmi2GetVersion"] != b"2.0":
            return failed(
                f"fmi2GetVersion of {library} returns {_shown(found['fmi2GetVersion'])}, not '2.0'."
            )
        if found["fmi2GetTypesPlatform"] != b"default":
            shown = _shown(found["fmi2GetTypesPlatform"])
            return warned(f"fmi2GetTypesPlatform of {library} returns {shown}, not 'default'.")
    if subject.version == 3:
        return passed("It is compiled for FMI 3.0.")
    return passed("It is compiled for FMI 2.0 and the default types.")


def _text(library: ctypes.CDLL, name: str) -> bytes | None:
    note(name)
    function = getattr(library, name)
    function.restype, function.argtypes = ctypes.c_char_p, []
    return function()


def _shown(text: bytes | None) -> str:
    return "NULL" if text is None else repr(text[:40].decode(errors="replace"))
