"""Check the build description of FMI 3.0 sources."""

from collections.abc import Iterator
from typing import Any

from ..binary_headers import NAMES_OF_VERSION_2, parse_platform
from ..c_sources import BUILD_DESCRIPTION, find_inside, read_build_description
from ..check import check
from ..declarations import find_repeated
from ..libraries import list_platforms
from ..messages import Breach, Problem, judge_problems, shorten_sentence
from ..subject import Subject
from ..verdict import CheckOutcome, failed, quote, skipped, warned
from .description import find_schema_problems

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
