"""Rules for replacing files: new and empty files, files of emla, and with --overwrite any regular file.

A single file of emla has a mark in its content. In an output folder that holds a record of emla, such as
run.json, all files with the names of emla's files are emla's. Links, folders, devices and pipes are never
replaced.
"""

import json
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from .errors import CommandError, RunError
from .files import (
    CURRENT_FOLDER,
    NotAFileError,
    resolve_output_path,
    write_atomically,
)

_HEAD_SIZE = 4096
"""Bytes at the beginning and at the end of a file in which a mark must be."""

IsOurs = Callable[[Path], bool]
"""Return whether emla wrote the regular file at this path; may raise OSError."""


def has_mark(*marks: bytes) -> IsOurs:
    """Return a function that recognizes files with one of these marks near their beginning or end."""

    def is_ours(path: Path) -> bool:
        with path.open("rb") as stream:
            ends = stream.read(_HEAD_SIZE)
            stream.seek(max(path.stat().st_size - _HEAD_SIZE, 0))
            ends += stream.read(_HEAD_SIZE)
        return any(mark in ends for mark in marks)

    return is_ours


def has_format(name: str) -> IsOurs:
    """Return a function that recognizes JSON files that begin with a `format` entry of this name."""
    pattern = re.compile(rb'\s*\{\s*"format":\s*"' + re.escape(name).encode() + rb'[" ]')

    def is_ours(path: Path) -> bool:
        with path.open("rb") as stream:
            return pattern.match(stream.read(_HEAD_SIZE)) is not None

    return is_ours


def has_entries(*choices: set[str]) -> IsOurs:
    """Return a function that recognizes JSON files with all entries of one of these sets."""

    def is_ours(path: Path) -> bool:
        try:
            entries = json.loads(path.read_bytes())
        except (ValueError, RecursionError):
            return False
        return isinstance(entries, dict) and any(names <= entries.keys() for names in choices)

    return is_ours


is_page = has_mark(b'<meta name="generator" content="emla-cosim">')
"""Recognize pages that emla wrote."""

RECORDS: Mapping[str, IsOurs] = {
    "run.json": has_entries({"scenario", "status"}, {"settings", "versions"}),
    "sweep.json": has_entries({"identity", "status"}),
    "comparison.json": has_entries({"entrants", "runs"}),
    "certificate.csv": has_mark(b"gains,figure,unit"),
    "tune.json": has_entries({"plan", "best", "runs"}),
    "identify.json": has_format("emla-identification"),
    "size.json": has_format("emla-sizing"),
    "linearize.json": has_format("emla-linearization"),
}
"""Functions that recognize the record of an output folder, by its name. NAME.json of any other
analysis has the format emla-NAME.
"""


UNFINISHED_STATUS = "unfinished"
"""Status in a record whose command continues, or was killed with all its processes."""


def has_record(folder: Path, name: str) -> bool:
    """Return whether a folder holds this record of emla. Raises OSError."""
    path = folder / name
    is_ours = RECORDS.get(name) or has_format(f"emla-{path.stem}")
    return is_regular(path) and is_ours(path)


def is_new(path: Path) -> bool:
    """Return whether a file does not exist or is empty. Raises OSError."""
    try:
        return path.stat().st_size == 0
    except FileNotFoundError:
        return True


def is_regular(path: Path) -> bool:
    """Return whether a path is a regular file, and no link to one."""
    return path.is_file() and not path.is_symlink()


class OutputFile:
    """A file that a command writes. It is checked before the command computes anything.

    Attributes:
        path: the file as messages name it.
        real_path: its real path.
    """

    def __init__(
        self,
        path: Path,
        label: str,
        is_ours: IsOurs,
        overwrite: bool = False,
        folder: Path = CURRENT_FOLDER,
        creates_folder: bool = False,
    ) -> None:
        """Check that the file may be written.

        Args:
            path: The file, relative to `folder`.
            label: What messages call it, such as `the trajectory`.
            is_ours: Function that recognizes an earlier file of emla.
            overwrite: Whether to replace other regular files.
            folder: The folder of a relative path.
            creates_folder: Whether the folder of the file is created later if it does not exist.

        Raises:
            CommandError: If the file cannot be written, or emla did not write the existing one.
        """
        self.path, self.subject = path, label
        self._is_ours, self._overwrite = is_ours, overwrite
        if creates_folder and not (folder / path).parent.is_dir():
            self.real_path = folder / path  # there is no file to protect
            return
        self.real_path = resolve_output_path(path, label, folder)
        try:
            may_replace = self._can_replace()
        except OSError as error:
            raise CommandError(f"{label} '{path}' cannot be read: {error.strerror or error}.") from error
        if not may_replace:
            raise CommandError(
                f"'{path}' was not written by emla. Choose another file for {label}, or use --overwrite.",
                path=str(path),
            )

    def _can_replace(self) -> bool:
        return self._overwrite or is_new(self.real_path) or self._is_ours(self.real_path)

    def check_again(self, path: Path) -> None:
        """Raise NotAFileError if a file appeared that emla did not write; for `write_atomically`."""
        if not self._can_replace():
            raise NotAFileError(0, f"'{path.name}' appeared while emla ran, and emla did not write it")

    @contextmanager
    def open(self) -> Iterator[IO[bytes]]:
        """Open a stream for the file, which appears when it is complete; see `write_atomically`.

        Raises:
            RunError: If it cannot be written.
        """
        with self.report_errors(), write_atomically(self.real_path, self.check_again) as stream:
            yield stream

    def write(self, content: bytes) -> None:
        """Write the file, completely or not at all. Raises RunError."""
        with self.open() as stream:
            stream.write(content)

    @contextmanager
    def report_errors(self) -> Iterator[None]:
        """Convert an OSError to a RunError that names the file."""
        try:
            yield
        except OSError as error:
            raise RunError(
                f"{self.subject} '{self.path}' cannot be written: {error.strerror or error}."
            ) from error
