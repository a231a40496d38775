"""Checks that libraries are for their platform, and for this version of the FMI."""

import ctypes
import re
from dataclasses import replace

import fmpy

from ..binary_headers import describe_mismatch, suggest_platform
from ..check import check
from ..libraries import SUFFIXES, list_libraries, list_platforms
from ..messages import judge_problems
from ..subject import Subject
from ..subprocess_run import note
from ..verdict import CheckOutcome, failed, passed, skipped, warned

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
