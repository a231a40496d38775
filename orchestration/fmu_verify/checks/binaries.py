"""Checks of binaries: present, complete, loadable, with all functions."""

import ctypes
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import fmpy

from emla_cosim.fmu.file import explain_missing_library, missing_bytes
from emla_cosim.fmu.load_diagnosis import diagnose_library

from ..c_sources import list_source_files
from ..check import CheckOutcome, blocked, check, failed, passed, quote, skipped
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
    list_platforms,
    parse_library,
)
from ..messages import Breach, Problem, join_few_names, judge_problems, shorten_sentence
from ..subject import Subject
from ..subprocess_run import note

_THIS_PLATFORM = (fmpy.platform_tuple, fmpy.platform)
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
        folders = ", ".join(p.name for p in list_platforms(subject)) or "no platform"
        name = subject.tree.find(missing_kinds[0]).get("modelIdentifier")
        message = f"There are binaries for {folders}, but none has the name {name}, and there are no sources."
        return failed(message)
    names = join_few_names(sorted({library.platform for library in libraries}))
    message = f"There are binaries for {names}."
    if not libraries:
        message = "There are sources only."
    elif not any(library.platform in _THIS_PLATFORM for library in libraries):
        message = f"There are binaries for {names}, but none for {fmpy.platform}."
    is_here = any(library.platform in _THIS_PLATFORM for library in misnamed)
    return replace(judge_problems(problems, message, doubts), blocks=is_here or not (libraries or sources))


class _Misnamed(NamedTuple):
    """A platform with libraries, but without one that has the name of the model."""

    platform: str
    message: str
    is_similar: bool
    """Whether a library has the name of the model in another spelling, with which tools do not find it."""


def _find_misnamed(subject: Subject) -> Iterator[_Misnamed]:
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
    problems = [(c, p) for c in libraries for p in _find_missing_functions(c, subject.version)]
    fine = f"All functions are exported by {join_few_names([str(library) for library in libraries])}."
    outcome = judge_problems([p for _, p in problems], fine)
    return replace(outcome, blocks=any(library.platform in _THIS_PLATFORM for library, _ in problems))


def _find_missing_functions(library: Library, version: int) -> Iterator[str]:
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
