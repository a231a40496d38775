"""Check that the C sources of an FMU compile, and their build description."""

import re
import subprocess
import sys
import tempfile
from collections.abc import Collection, Iterator, Sequence
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

from ..c_sources import (
    BUILD_DESCRIPTION,
    NO_COMPILER,
    find_inside,
    find_machine_compiler,
    find_zig,
    read_build_description,
    run_compiler,
)
from ..check import CheckOutcome, Verdict, check, failed, passed, quote, skipped, unjudged, warned
from ..declarations import find_repeated
from ..libraries import (
    NAMES_OF_VERSION_2,
    list_exports,
    list_functions,
    list_platforms,
    parse_library,
    parse_platform,
)
from ..messages import Breach, Problem, join_few_names, judge_problems, shorten_sentence
from ..sanitizer.compiling import build_complete_library, find_sources
from ..subject import Subject
from ..subprocess_run import note
from .description import find_schema_problems

_BUILD_DESCRIPTION = "buildDescription.xml"
_C = (".c",)
_ERROR = re.compile(r"(?:error|undefined reference|multiple definition|cannot find)[^\n]*", re.IGNORECASE)
_MISSING = re.compile(r"fatal error: '?([^'\n]+?)'?(?:: No such file or directory| file not found)")


_TIME_FACTOR = 8.0
# Part of the time limit for the compiler, which may run twice. What takes longer is not judged.
_PART = 0.3

# Part of the time limit for the build with sanitizers. If it succeeds, other checks use it, too.
_PART_OF_SANITIZERS = 0.2

_LISTED = quote("sources.listed")


@check("sources.compile", needs=("description.schema",), time_factor=_TIME_FACTOR)
def compile_(subject: Subject) -> CheckOutcome:
    """Check that all listed source files exist, with their headers, and compile and link to a library."""
    if subject.version == 3:
        return _judge_configurations(subject)
    folder = subject.folder / "sources"
    elements = {kind: subject.tree.iterfind(f"{kind}/SourceFiles/File") for kind in subject.kinds}
    lists = {kind: [e.get("name") for e in files_of_kind] for kind, files_of_kind in elements.items()}
    if not any(lists.values()):
        if folder.is_dir() and any(folder.rglob("*.c")):
            message = "The FMU has sources, but SourceFiles does not list which to compile."
            return warned(message, clause=quote("sources.to_list"))
        return skipped("The FMU has no sources.")
    listed_files = {name for names in lists.values() for name in names}
    if missing := sorted(name for name in listed_files if find_inside(folder, name) is None):
        return judge_problems(
            [Breach(f"The source file {m} is not in `sources`.", _LISTED) for m in missing], ""
        )
    if (folder / _BUILD_DESCRIPTION).is_file():
        return skipped(f"The sources need {_BUILD_DESCRIPTION}, which is not supported.")
    seconds = _PART * _TIME_FACTOR * subject.settings.seconds
    # some tools put headers into folders that the model description cannot list
    header_folders = sorted({p.parent for p in folder.rglob("*.h")} - {folder})
    for names, kind in {tuple(names): kind for kind, names in lists.items() if names}.items():
        needed = {f for k, listed in lists.items() if tuple(listed) == names for f in list_functions(k, 2)}
        if any(Path(name).suffix not in _C for name in names):
            return skipped("Not all of the sources are C.")
        if not header_folders and _can_build_for_sanitizers(subject, kind, needed):
            continue
        if (outcome := _try_to_compile(folder, names, seconds, needed=needed)) is not None:
            is_late = outcome.verdict == Verdict.SKIPPED
            if is_late or not header_folders or _try_to_compile(folder, names, seconds, header_folders):
                return outcome
            return warned(
                "The sources compile only with include folders, which SourceFiles cannot list: "
                f"{join_few_names([p.relative_to(folder).as_posix() for p in header_folders])}.",
                hint="Include headers by their path from the folder `sources`.",
            )
    message = f"{', '.join(dict.fromkeys(n for names in lists.values() for n in names))} compile and link."
    return passed(message)


def _judge_configurations(subject: Subject) -> CheckOutcome:
    """Compile the sources that the build description names for each kind."""
    seconds = _PART * _TIME_FACTOR * subject.settings.seconds
    all_sources = {kind: find_sources(subject, kind) for kind in subject.kinds}
    source_sets = {kind: sources for kind, sources in all_sources.items() if sources is not None}
    if not source_sets:
        return skipped("The FMU has no sources with a build configuration for this machine.")
    folder = subject.folder / "sources"
    for sources, kind in {sources: kind for kind, sources in source_sets.items()}.items():
        if not sources.is_c:
            return skipped("Not all of the sources are C.")
        needed = list_functions(kind, 3)
        if _can_build_for_sanitizers(subject, kind, needed):
            continue
        names = [path.relative_to(folder.resolve()).as_posix() for path in sources.files]
        # functions then have no prefix, which those of static libraries have
        macros = (*sources.macros, "-DFMI3_OVERRIDE_FUNCTION_PREFIX")
        outcome = _try_to_compile(folder, names, seconds, sources.includes, macros, needed)
        if outcome is not None:
            return outcome
    return passed(f"The sources for {' and '.join(source_sets)} compile and link.")


def _can_build_for_sanitizers(subject: Subject, kind: str, needed: Collection[str]) -> bool:
    """Build the sources with sanitizers, for other checks, too. Return whether all functions are there."""
    if (sources := find_sources(subject, kind)) is None:
        return False
    note(f"a compiler building {', '.join(path.name for path in sources.files)} with sanitizers")
    seconds = _PART_OF_SANITIZERS * _TIME_FACTOR * subject.settings.seconds
    library = build_complete_library(subject, sources, seconds)
    return library is not None and not _list_missing_functions(library, needed)


def _try_to_compile(
    folder: Path,
    names: Sequence[str],
    seconds: float,
    includes: Sequence[Path] = (),
    macros: Sequence[str] = (),
    needed: Collection[str] = (),
) -> CheckOutcome | None:
    """Compile and link these files, with more include folders and macros.

    Return None on success; otherwise the outcome, also if there is no compiler or it takes too long.

    Args:
        folder: The folder `sources`.
        names: The files.
        seconds: Time limit of the compiler in s.
        includes: Further include folders.
        macros: Further options.
        needed: Functions that they must define.
    """
    compiler = find_machine_compiler() or find_zig()
    if not compiler:
        return unjudged(NO_COMPILER)
    with tempfile.TemporaryDirectory() as scratch, as_file(files("fmpy") / "c-code") as headers:
        command = [*compiler, "-shared", "-fPIC", "-O0", "-w", "-I", str(headers), "-I", str(folder)]
        command += [*(f"-I{path}" for path in includes), *macros]
        command += ["-Wl,--no-undefined"] if sys.platform == "linux" else []
        command += [str(folder / name) for name in names]
        command += ["-o", str(Path(scratch, "library")), *([] if sys.platform == "win32" else ["-lm"])]
        note(f"`{command[0]}` compiling {', '.join(names)}")
        try:
            process = run_compiler(command, Path(scratch), seconds)
        except subprocess.TimeoutExpired:
            return unjudged(f"The compiler takes more than {seconds:g} s.")
        except OSError as error:
            return skipped(f"No compiler can be run: {error.strerror}.")
        missing = _list_missing_functions(Path(scratch, "library"), needed) if process.returncode == 0 else []
    if missing:
        message = f"The sources ({', '.join(names)}) do not define {join_few_names(missing)}."
        return failed(shorten_sentence(message), hint="Implement all functions of the header files of FMI.")
    if process.returncode == 0:
        return None
    message = _ERROR.search(process.stderr)
    reason = message[0] if message else process.stderr.strip().rpartition("\n")[2]
    sentence = shorten_sentence(
        f"{', '.join(names)} does not compile: {reason.replace(f'{folder}/', '').rstrip('. ')}."
    )
    if missing := _MISSING.search(process.stderr):
        # the FMU should have a header that its sources include by a name in quotes
        include = re.compile(rb'#\s*include\s*"' + re.escape(missing[1].encode()) + rb'"')
        if any(include.search(p.read_bytes()) for p in folder.rglob("*.[ch]")):
            return failed(sentence)
    return warned(sentence)  # it may need compiler options that only its documentation lists


def _list_missing_functions(library: Path, needed: Collection[str]) -> list[str]:
    """Return the functions that a compiled library lacks; none if it shows none of them.

    Their names may have a prefix.
    """
    binary = parse_library(library)
    exported = set() if binary is None else list_exports(binary)
    defined = {name for name in needed if any(e == name or e.endswith(f"_{name}") for e in exported)}
    return [name for name in needed if name not in defined] if defined else []  # none: they are hidden


_VERSION = quote("builds.version")
_IDENTIFIER = quote("builds.identifier")
_FALLBACK = quote("builds.fallback")
_PLATFORM = quote("builds.platform")
_LIBRARY = quote("builds.library")


@check("sources.description", clause=quote("builds.valid"), needs=("description.schema",), only_for=3)
def description(subject: Subject) -> CheckOutcome:
    """Check the build description: its schema, version, model identifiers and source files."""
    folder = subject.folder / "sources"
    try:
        root = read_build_description(subject)
    except SyntaxError as error:
        return failed(shorten_sentence(f"{BUILD_DESCRIPTION} cannot be read: {str(error).rstrip('.')}."))
    if root is None:
        if any(folder.rglob("*.c")):
            return warned(f"The FMU has sources, but no {BUILD_DESCRIPTION}.")
        return skipped("The FMU has no sources.")
    if problems := find_schema_problems(root, "fmi3BuildDescription.xsd"):
        return judge_problems(problems, "")
    violations: list[Problem] = [*_find_contradictions(root, subject), *_find_missing_files(root, subject)]
    count = len(root.findall("BuildConfiguration"))
    fine = f"The build description has {count} configurations; all files exist."
    return judge_problems(violations, fine, [*_find_missing_libraries(root, subject)])


def _find_contradictions(root: Any, subject: Subject) -> Iterator[Problem]:
    """Yield contradictions to the model description."""
    version, expected = root.get("fmiVersion"), subject.tree.get("fmiVersion")
    if version != expected:
        yield Breach(f"The build description has the fmiVersion {version}, not {expected}.", _VERSION)
    identifiers = {subject.tree.find(kind).get("modelIdentifier") for kind in subject.kinds}
    configurations = root.findall("BuildConfiguration")
    for name in dict.fromkeys(e.get("modelIdentifier") for e in configurations):
        if name not in identifiers:
            yield Breach(f"A build configuration is for {name}, which is not a modelIdentifier.", _IDENTIFIER)
    fallbacks = [e.get("modelIdentifier") for e in configurations if e.get("platform") is None]
    for name in find_repeated(fallbacks):
        yield Breach(f"{name} has more than one build configuration without a platform.", _FALLBACK)


def _find_missing_files(root: Any, subject: Subject) -> Iterator[Problem]:
    """Yield source files and include directories that do not exist, and platforms named as in FMI 2.0."""
    folder = subject.folder / "sources"
    for name in dict.fromkeys(e.get("name") for e in root.iterfind(".//SourceFile")):
        if find_inside(folder, name) is None:
            yield Breach(f"The source file {name} is not in `sources`.", quote("builds.file"))
    for name in dict.fromkeys(e.get("name") for e in root.iterfind(".//IncludeDirectory")):
        if not (folder / name).is_dir():
            yield Breach(f"The include directory {name} is not in `sources`.", quote("builds.includes"))
    for configuration in root.iterfind("BuildConfiguration"):
        platform = configuration.get("platform")
        if platform in NAMES_OF_VERSION_2:
            tuple_ = "-".join(reversed(parse_platform(platform) or ()))
            yield Breach(f"A build configuration is for {platform}; in FMI 3.0 that is {tuple_}.", _PLATFORM)


def _find_missing_libraries(root: Any, subject: Subject) -> Iterator[Problem]:
    """Yield libraries that the environment need not provide, but that the FMU does not have."""
    for configuration in root.iterfind("BuildConfiguration"):
        platform = configuration.get("platform")
        # a configuration without a platform is for all
        folders = [p for p in list_platforms(subject) if platform in (None, p.name)]
        stems = {p.stem.removeprefix("lib") for f in folders for p in f.iterdir()}
        for library in configuration.iterfind("Library"):
            name = library.get("name")
            if library.get("external") not in ("true", "1") and not stems & {name, name.removeprefix("lib")}:
                yield Breach(f"The library {name} is not external, but not in `binaries`.", _LIBRARY)
