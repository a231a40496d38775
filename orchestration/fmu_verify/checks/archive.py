"""Checks of the archive: safe to unpack, format, layout, documents."""

import difflib
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path

from emla_cosim.base.errors import find_machine_fault
from emla_cosim.fmu.file import UnsafeArchiveError, unpack

from ..check import CheckOutcome, check, failed, passed, quote, warned
from ..declarations import find_repeated
from ..messages import Breach, Problem, join_few_names, judge_problems, shorten_sentence
from ..subject import Subject

_MAX_UNCHECKED_SIZE = 256 * 2**20
"""Size in bytes up to which the compression ratio is not checked."""
_MAX_RATIO = 100
"""Largest compression ratio of archives that unpack to more than `_MAX_UNCHECKED_SIZE`."""
_STANDARD_ENTRIES = (
    *("modelDescription.xml", "model.png", "documentation", "sources", "binaries", "resources"),
    *("extra", "terminalsAndIcons"),
)
_STANDARD_FILES = (
    "documentation/index.html",
    "documentation/licenses",
    "sources/buildDescription.xml",
    "terminalsAndIcons/icon.png",
    "terminalsAndIcons/terminalsAndIcons.xml",
)
_LICENCE_KINDS = ("txt", "html", "spdx")
"""Suffixes of the entry point of licences."""
_PICTURES = {
    "documentation/diagram": quote("archive.diagram"),
    "terminalsAndIcons/icon": quote("archive.icon"),
}
_PAGES = (".pdf", ".md", ".htm", ".html", ".txt")
"""How the names of start pages end."""
_STORED_OR_DEFLATED = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_MAX_ZIP_VERSION = 20
_SIZE_BEHIND_DATA = 1 << 3
_LFS = b"version https://git-lfs.github.com/spec/"


@check("archive.safe")
def safe(subject: Subject) -> CheckOutcome:
    """Check that it is a complete zip file with all entries inside its folder. Unpack it there."""
    if not subject.path.is_file():
        return failed("The file does not exist.", hint="Name an FMU file.")
    if _is_lfs_pointer(subject.path):
        return failed(
            "The file is a pointer of Git LFS, not the FMU.",
            hint="Run `git lfs pull`. In CI, check out with LFS: `lfs: true` for actions/checkout.",
        )
    try:
        with zipfile.ZipFile(subject.path) as archive:
            entries = archive.infolist()
        _check_entries(entries, subject.path)
        unpack(subject.path, subject.folder)
    except UnsafeArchiveError as error:
        return failed(shorten_sentence(f"It {error}."))
    except MemoryError:
        raise
    except Exception as error:  # whatever zip readers raise
        if find_machine_fault(error) is not None:
            raise
        message = error.strerror if isinstance(error, OSError) else str(error)
        reason = shorten_sentence(message or type(error).__name__).rstrip(".")
        return failed(f"It cannot be unpacked: {reason}.")
    return judge_problems((), f"Its {len(entries)} entries were unpacked.", _find_case_collisions(entries))


def _is_lfs_pointer(path: Path) -> bool:
    try:
        with path.open("rb") as stream:
            return stream.read(len(_LFS)) == _LFS
    except OSError:  # reported when it is unpacked
        return False


def _check_entries(entries: Sequence[zipfile.ZipInfo], path: Path) -> None:
    """Raise UnsafeArchiveError for repeated entries and zip bombs, which `unpack` allows."""
    if repeated := find_repeated(e.filename for e in entries if not e.is_dir()):
        message = f"has more than one entry '{repeated[0]}'; tools differ in which one they read"
        raise UnsafeArchiveError(message)
    size, archive_size = sum(e.file_size for e in entries), path.stat().st_size
    if size > max(_MAX_UNCHECKED_SIZE, _MAX_RATIO * archive_size):
        raise UnsafeArchiveError(
            f"would unpack from {archive_size / 2**20:.3g} MiB to {size / 2**20:.4g} MiB, as zip bombs do"
        )


def _find_case_collisions(entries: Sequence[zipfile.ZipInfo]) -> list[str]:
    """Return warnings about files that overwrite each other on case-insensitive file systems."""
    names_by_key: dict[str, list[str]] = {}
    for entry in entries:
        if not entry.is_dir():
            names_by_key.setdefault(entry.filename.casefold(), []).append(entry.filename)
    return [
        f"{' and '.join(names)} are the same file on case-insensitive systems such as Windows."
        for names in names_by_key.values()
        if len(names) > 1
    ]


@check("archive.format", needs=("archive.safe",))
def format_(subject: Subject) -> CheckOutcome:
    """Check that entries are stored or deflated, in format 2.0, and stored ones have their size first."""
    with zipfile.ZipFile(subject.path) as archive:
        entries = archive.infolist()
    problems = [
        f"{e.filename} is compressed with method {e.compress_type}."
        for e in entries
        if e.compress_type not in _STORED_OR_DEFLATED
    ]
    newer = [e.filename for e in entries if e.extract_version > _MAX_ZIP_VERSION and not problems]
    streamed = [
        e.filename
        for e in entries
        if e.flag_bits & _SIZE_BEHIND_DATA and e.compress_type == zipfile.ZIP_STORED and not e.is_dir()
    ]
    doubts = [f"{join_few_names(newer)} needs a newer version of the format than 2.0."] if newer else []
    if streamed:
        doubts.append(f"{join_few_names(streamed)} is stored with its size behind the data (bit 3).")
    return judge_problems(problems, f"{len(entries)} entries are stored or deflated.", doubts)


@check("archive.layout", needs=("description.readable",))
def layout(subject: Subject) -> CheckOutcome:
    """Check that the top folder has only the entries of the standard, and files have its names."""
    unknown = sorted(p.name for p in subject.folder.iterdir() if p.name not in _STANDARD_ENTRIES)
    problems: list[Problem] = [*_find_other_spellings(subject.folder)]
    if subject.version == 3:
        problems += _find_missing_companions(subject.folder)
    missing = {name.casefold() for name in _STANDARD_ENTRIES if not (subject.folder / name).exists()}
    doubts = [
        f"The top folder has {name}, which is not in the standard{_suggest_entry(name)}."
        for name in unknown
        if name.casefold() not in missing  # those are problems
    ]
    return judge_problems(problems, "The top folder has only entries of the standard.", doubts)


def _suggest_entry(name: str) -> str:
    """Return the end of a message with a similar name of the standard; empty if there is none."""
    close = difflib.get_close_matches(name.casefold(), _STANDARD_ENTRIES, n=1, cutoff=0.7)
    return f"; it has {close[0]}" if close else ""


def _find_other_spellings(folder: Path) -> Iterator[str]:
    """Yield files and folders whose names differ from those of the standard by case only."""
    for standard_name in (*_STANDARD_ENTRIES, *_STANDARD_FILES):
        path = folder / standard_name
        names = {p.name for p in path.parent.iterdir()} if path.parent.is_dir() else set()
        similar = sorted(name for name in names if name.casefold() == path.name.casefold())
        if similar and path.name not in similar:
            actual_name = (path.parent / similar[0]).relative_to(folder).as_posix()
            yield (
                f"The FMU has {actual_name}; its name must be {standard_name}, in this case, to be found on "
                "every system."
            )


def _find_missing_companions(folder: Path) -> Iterator[Problem]:
    """Yield files of FMI 3.0 without those that must be beside them."""
    for picture, clause in _PICTURES.items():
        if (folder / f"{picture}.svg").is_file() and not (folder / f"{picture}.png").is_file():
            yield Breach(f"The FMU has {picture}.svg, but no {picture}.png.", clause)
    licences = folder / "documentation/licenses"
    if licences.is_dir() and not any((licences / f"license.{kind}").is_file() for kind in _LICENCE_KINDS):
        names = " or ".join(f"license.{kind}" for kind in _LICENCE_KINDS)
        yield Breach(f"documentation/licenses has no {names}.", quote("archive.licence"))


@check("documents.present", needs=("description.readable",))
def documents(subject: Subject) -> CheckOutcome:
    """Check that documentation has its start page. Documentation and a licence are optional."""
    folder = subject.folder / "documentation"
    pages = sorted(p.name for p in folder.glob("*.*") if p.suffix.lower() in _PAGES)
    has_page = any(name.lower() == "index.html" for name in pages)  # `archive.layout` reports the case
    if pages and not has_page:
        return warned(f"documentation/index.html is missing; there is {pages[0]}.")
    licences = [folder / "licenses" / f"license.{kind}" for kind in _LICENCE_KINDS]
    has_licence = any(p.is_file() for p in licences) or bool(subject.tree.get("license"))
    page = "It has a start page." if has_page else "It has no documentation, which is optional."
    licence = "It has a licence." if has_licence else "It names no licence, which is only recommended."
    return passed(f"{page} {licence}")
