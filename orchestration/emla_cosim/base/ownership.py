"""Rules for replacing files: new files, files of emla, and with --overwrite any regular file.

emla recognizes a single file by its content. An output folder has a manifest, `.emla.json`: the files that
commands wrote there, each with a fingerprint of its final state. Versions without a manifest left a record,
such as run.json, by which emla recognizes their folders. Links, folders, devices and pipes are never
replaced.

A command checks its output files before it computes anything (`check`). It lists them in the manifest before
it writes the first one (`claim`), and adds the fingerprints when all files are complete (`settle`). A file
that a killed command left has no fingerprint and may be replaced.
"""

import hashlib
import json
import os
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib.metadata import version
from pathlib import Path
from typing import IO

from .errors import CommandError, RunError, find_machine_fault
from .files import HERE, NotAFileError, real_place, resolve_output_path, write_atomically

MANIFEST = ".emla.json"
FORMAT = "emla-output"
_VERSION = 1

_HEAD = 4096
"""Bytes at the beginning of a file in which a mark must be."""

_PART = 2**20
"""Bytes at each end of a file that its fingerprint depends on."""

_SEAL = b"emla-cosim "
_SEALED = re.compile(rb"[^\n]{0,9}" + _SEAL + rb"([0-9a-f]{64})[^\n]{0,9}\n\Z")

IsOurs = Callable[[Path], bool]
"""Return whether emla wrote the regular file at this path."""

_State = tuple[int, int, int, int] | None


def check_replaceable(
    path: Path, what: str, is_ours: IsOurs, overwrite: bool = False, folder: Path = HERE
) -> Path:
    """Check that a file may be replaced; the module describes the rules.

    Args:
        path: The file, relative to `folder`.
        what: What error messages call it.
        is_ours: Returns whether emla wrote a file; called for regular files only.
        overwrite: Also replace regular files that emla did not write.
        folder: The folder of a relative path.

    Returns:
        The real path of the file.

    Raises:
        CommandError: If the file cannot be written, or emla did not write it.
    """
    place = resolve_output_path(path, what, folder)
    if not is_new(place):
        with _faults_of_files():  # `is_ours` may not notice them
            place.open("rb").close()
    if not (overwrite or is_new(place) or is_ours(place)):
        raise CommandError(
            f"'{path}' was not written by emla. Choose another file for {what}, or use --overwrite.",
            path=str(path),
        )
    return place


def refuse_others(is_ours: IsOurs, overwrite: bool = False) -> Callable[[Path], None]:
    """Return the check of `write_atomically` for a file that `check_replaceable` checked earlier."""

    def check(place: Path) -> None:
        if not (overwrite or is_new(place) or is_ours(place)):
            raise NotAFileError(0, f"'{place.name}' appeared while emla ran, and emla did not write it")

    return check


def is_new(path: Path) -> bool:
    """Return whether a file does not exist or is empty."""
    try:
        return path.stat().st_size == 0
    except FileNotFoundError:
        return True


def has_mark(*marks: bytes) -> IsOurs:
    """Return a function that recognizes files with one of these marks near their beginning."""

    def is_ours(path: Path) -> bool:
        head = _read_head(path)
        return any(mark in head for mark in marks)

    return is_ours


def seal(content: bytes, begin: bytes, end: bytes) -> bytes:
    """Return the content of a file with a comment at its end, by which `has_seal` recognizes it.

    Args:
        content: The content.
        begin: What begins a comment in the format.
        end: What ends it.
    """
    return content + begin + _SEAL + hashlib.sha256(content).hexdigest().encode() + end


def has_seal(path: Path) -> bool:
    """Return whether a file has a seal, and nobody has changed it since."""
    content = b""
    with _faults_of_files():
        content = path.read_bytes()
    found = _SEALED.search(content)
    return found is not None and hashlib.sha256(content[: found.start()]).hexdigest().encode() == found[1]


def has_format(name: str) -> IsOurs:
    """Return a function that recognizes JSON files that begin with a `format` entry of this name."""
    pattern = re.compile(rb'\s*\{\s*"format":\s*"' + re.escape(name).encode() + rb'[" ]')
    return lambda path: pattern.match(_read_head(path)) is not None


def has_entries(*names: str) -> IsOurs:
    """Return a function that recognizes JSON files with all these entries."""
    return lambda path: set(names) <= set(_read_json(path))


class OutputFiles:
    """The files of an output folder, and which of them emla wrote."""

    def __init__(
        self,
        place: Path,
        shown: Path,
        marker: str,
        is_record: IsOurs,
        known: Collection[str],
        overwrite: bool = False,
    ) -> None:
        """Open a folder.

        Args:
            place: The real folder.
            shown: The folder as error messages call it.
            marker: The file that marks a folder of a version without a manifest.
            is_record: Returns whether a file is such a marker.
            known: The names that this kind of command gives its files.
            overwrite: Also replace regular files that emla did not write.
        """
        self.overwrite = overwrite
        self._place, self._shown = place, shown
        self._identity: tuple[int, int] | None = None
        self._checked: dict[str, _State] = {}
        """What was in place of each file when it was last checked, claimed or written."""
        self._marker, self._is_record, self._known = marker, is_record, known

    def check(self, names: Iterable[str], what: str) -> None:
        """Check that files can be written.

        Args:
            names: The names of the files.
            what: What error messages call them.

        Raises:
            CommandError: If one cannot be written, or emla did not write it.
        """
        entries = self._entries()
        for name in (MANIFEST, *names):
            path = self._place / name
            self._checked[name] = _state(path)
            if not os.path.lexists(path):
                continue
            try:
                real_place(path)
            except OSError as error:
                raise CommandError(
                    f"{what} '{self._shown / name}' cannot be written: {error.strerror or error}."
                ) from error
            if not self._may_replace(name, entries):
                changed = "was changed since emla wrote it" if name in entries else "was not written by emla"
                raise CommandError(
                    f"'{self._shown / name}' {changed}. Choose another output folder, or use --overwrite.",
                    path=str(self._shown / name),
                )

    def claim(self, names: Iterable[str]) -> None:
        """List files that are about to be written.

        The list includes files of a version without a manifest, because its record is about to be replaced.

        Raises:
            RunError: If the folder was replaced since the first claim.
            OSError: If the manifest cannot be written.
        """
        self._check_unchanged()
        entries = self._entries()
        for name in names:
            self._checked.setdefault(name, _state(self._place / name))
        earlier = (
            [n for n in self._known if _is_regular(self._place / n)] if self._is_earlier(entries) else []
        )
        wanted = {**dict.fromkeys(earlier), **entries, **dict.fromkeys(names)}
        if wanted != entries:
            self._write(wanted)

    @contextmanager
    def write(self, name: str) -> Iterator[IO[bytes]]:
        """Write a file atomically; see `write_atomically`.

        Raises:
            NotAFileError: The file was not there, or was another one, when it was claimed.
            OSError: The file cannot be written.
        """
        self.claim([name])
        with write_atomically(self._place / name, self._check_appeared) as stream:
            yield stream
        self._checked[name] = _state(self._place / name)

    def _check_appeared(self, place: Path) -> None:
        """Raise NotAFileError if a file appeared, or was changed, after it was claimed."""
        if self.overwrite or is_new(place) or _state(place) == self._checked[place.name]:
            return
        known = self._entries().get(place.name)
        if known is None or known != _fingerprint(place):
            raise NotAFileError(0, f"'{place.name}' appeared while emla ran, and emla did not write it")

    def _check_unchanged(self) -> None:
        """Raise RunError if the folder is another one than at the first file."""
        status = self._place.lstat()
        identity = status.st_dev, status.st_ino
        self._identity = self._identity or identity
        if identity != self._identity:
            raise RunError(f"the output folder '{self._shown}' was replaced while emla wrote to it.")

    def settle(self, names: Collection[str] | None = None) -> None:
        """Add the fingerprints of files that are complete now.

        The entries of other files stay as they are: their writer may still be at work.

        Args:
            names: The files; default: all in the folder.

        Raises:
            OSError: If the manifest cannot be written.
        """
        entries = self._entries()
        chosen = entries.keys() if names is None else names
        found = {name: known for name, known in entries.items() if name not in chosen}
        for name in chosen:
            if _is_regular(path := self._place / name):
                known = entries.get(name)
                found[name] = _fingerprint(path) if known is None else known
        if found != entries:
            self._write(found)

    def remove(self, names: Iterable[str], to_be_written: Collection[str] = ()) -> None:
        """Remove files that emla wrote. Links, and everything else that is not a regular file, stay.

        Args:
            names: The names of the files.
            to_be_written: Files that --overwrite removes even if emla did not write them.

        Raises:
            OSError: If a file cannot be removed.
        """
        entries, replaced = self._entries(), set(to_be_written) if self.overwrite else set()
        there = [name for name in names if _is_regular(self._place / name)]
        # check all files first: removing the record makes the others unrecognizable
        for name in [n for n in there if n in replaced or self._owns(n, entries)]:
            (self._place / name).unlink()

    def owns(self, name: str) -> bool:
        """Return whether emla wrote this file and it is unchanged."""
        return _is_regular(self._place / name) and self._owns(name, self._entries())

    def _may_replace(self, name: str, entries: Mapping[str, str | None]) -> bool:
        path = self._place / name
        if name == MANIFEST:
            return self.overwrite or is_new(path) or has_format(FORMAT)(path)
        return self.overwrite or is_new(path) or self._owns(name, entries)

    def _owns(self, name: str, entries: Mapping[str, str | None]) -> bool:
        if name in entries:
            known = entries[name]
            return known is None or known == _fingerprint(self._place / name)
        return name in self._known and self._is_earlier(entries)

    def _is_earlier(self, entries: Mapping[str, str | None]) -> bool:
        """Return whether a version without a manifest wrote to the folder last."""
        record = self._place / self._marker
        return self._marker not in entries and _is_regular(record) and self._is_record(record)

    def _entries(self) -> dict[str, str | None]:
        """Return the fingerprints of the manifest by name; None for files that may be incomplete."""
        path = self._place / MANIFEST
        found = _read_json(path) if _is_regular(path) else {}
        files = found.get("files") if found.get("format") == FORMAT else None
        if not isinstance(files, dict):
            return {}
        return {str(name): known for name, known in files.items() if known is None or isinstance(known, str)}

    def _write(self, entries: Mapping[str, str | None]) -> None:
        content = {
            "format": FORMAT,
            "version": _VERSION,
            "made_by": f"emla-cosim {version('emla-cosim')}",
            "files": dict(sorted(entries.items())),
        }
        check = refuse_others(has_format(FORMAT), self.overwrite)
        with write_atomically(self._place / MANIFEST, check) as stream:
            stream.write((json.dumps(content, indent=1) + "\n").encode())


def _state(path: Path) -> _State:
    """Return what changes if a file is replaced or written; None if there is none."""
    try:
        found = path.lstat()
    except OSError:
        return None
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns


def _is_regular(path: Path) -> bool:
    return path.is_file() and not path.is_symlink()


def _read_head(path: Path) -> bytes:
    """Return the beginning of a file, empty if it cannot be read."""
    with _faults_of_files(), path.open("rb") as stream:
        return stream.read(_HEAD)
    return b""


def _read_json(path: Path) -> dict[str, object]:
    """Return the entries of a JSON file, none if it is something else."""
    found = None
    with _faults_of_files(), suppress(ValueError, RecursionError):
        found = json.loads(path.read_bytes())
    return found if isinstance(found, dict) else {}


def _fingerprint(path: Path) -> str | None:
    """Return size and partial hash of a file; None if it cannot be read."""
    with _faults_of_files(), path.open("rb") as stream:
        size = os.fstat(stream.fileno()).st_size
        first = stream.read(_PART)
        stream.seek(max(size - _PART, 0))
        return f"{size} {hashlib.sha256(first + stream.read(_PART)).hexdigest()[:16]}"
    return None


@contextmanager
def _faults_of_files() -> Iterator[None]:
    """Ignore an OSError, unless the machine caused it: a limit must not make a file of emla the user's."""
    try:
        yield
    except OSError as error:
        if find_machine_fault(error) is not None:
            raise
