"""Files: read with one sentence for whatever is wrong with them, written whole and where nothing else is."""

import atexit
import hashlib
import os
import re
import shutil
import stat
import tempfile
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from fmublock.cache import CacheError, cache_folder
from fmublock.files import UNFINISHED, NotAFileError, real_place, write_atomically

from .errors import CommandError, RunError

__all__ = [
    "HERE",
    "UNFINISHED",
    "CacheError",
    "NotAFileError",
    "cache_folder",
    "check_output_files",
    "get_working_folder",
    "hash_file",
    "hash_if_readable",
    "read_file",
    "read_text",
    "real_place",
    "remove_unfinished",
    "report_write_errors",
    "resolve_output_path",
    "restore_working_folder",
    "temporary_folder",
    "write_atomically",
]

HERE = Path()
"""The present working folder, whichever it is when a path is used."""


@contextmanager
def temporary_folder(prefix: str) -> Iterator[Path]:
    """A folder, by its real name, that is removed at the end of the block or of the process that made it.

    A process that divides from that one leaves it alone. Raises CommandError where there can be none.
    """
    try:
        folder, owner = Path(tempfile.mkdtemp(prefix=prefix)).resolve(), os.getpid()
    except OSError as error:
        raise CommandError(
            f"there is no place for temporary files: {error.strerror}; TMPDIR can name a folder."
        ) from error

    def remove() -> None:
        if os.getpid() == owner:
            with suppress(OSError):  # of who listens, which ignore_errors does not cover
                shutil.rmtree(folder, ignore_errors=True)

    atexit.register(remove)
    try:
        yield folder
    finally:
        atexit.unregister(remove)
        remove()


_going = threading.RLock()
"""Held by who goes to another folder for a while, and by who wants to know where this one is."""


def get_working_folder() -> Path:
    """The present working folder; CommandError where it was removed."""
    try:
        with _going:
            return Path.cwd()
    except OSError as error:
        raise CommandError("the present folder was removed; go to another one.") from error


@contextmanager
def restore_working_folder() -> Iterator[None]:
    """In the end the working folder, which all threads share, is the one of before; one at a time."""
    with _going:
        before = get_working_folder()
        try:
            yield
        finally:
            os.chdir(before)


def read_file(path: Path, what: str) -> bytes:
    """The content of a file; CommandError that says `what` it should have been where it cannot be read."""
    try:
        kind = stat.S_IFMT(path.stat().st_mode)
        if kind in (stat.S_IFCHR, stat.S_IFBLK):
            raise CommandError(f"{what} '{path}' cannot be read: it is a device.")
        if kind == stat.S_IFIFO:  # whose other end may never come
            raise CommandError(f"{what} '{path}' cannot be read: it is a pipe.")
        return path.read_bytes()
    except OSError as error:
        raise CommandError(f"{what} '{path}' cannot be read: {error.strerror}.") from error
    except ValueError as error:  # a name that no file can have
        raise CommandError(f"{what} {str(path)!r} cannot be read: {error}.") from error


def read_text(path: Path, what: str) -> str:
    """The text of a file in UTF-8, with a byte-order mark or without; CommandError as in `read_file`."""
    try:
        return read_file(path, what).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise CommandError(f"{what} '{path}' is not a text in UTF-8.") from error


def hash_file(path: Path) -> str:
    """The hash of a file's content; raises OSError where it cannot be read."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def hash_if_readable(path: Path) -> str | None:
    """The hash of a file's content; None where there is no file that can be read."""
    try:
        return hash_file(path) if path.is_file() else None
    except (OSError, ValueError):
        return None


def resolve_output_path(path: Path, what: str, folder: Path = HERE) -> Path:
    """Where a file that is to be written lies, its path relative to `folder`.

    Raises CommandError where it cannot be written, see `real_place`.
    """
    try:
        place = real_place(folder / path)
        if not place.parent.is_dir():
            raise NotAFileError(0, f"there is no folder '{path.parent}'")
    except OSError as error:
        raise CommandError(f"{what} '{path}' cannot be written: {error.strerror or error}.") from error
    return place


_UNFINISHED = re.compile(rf"{re.escape(UNFINISHED)}[a-z0-9_]{{8}}")


def remove_unfinished(folder: Path) -> None:
    """Remove files that were not complete when a process was killed that wrote to this folder."""
    with suppress(OSError):
        for path in folder.iterdir():
            if _UNFINISHED.fullmatch(path.name) and path.is_file() and not path.is_symlink():
                path.unlink()


@contextmanager
def report_write_errors(folder: Path) -> Iterator[None]:
    """Turn an OSError of what is written to an output folder into a RunError that names it."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or error
        raise RunError(f"the output folder '{folder}' cannot be written: {reason}.") from error


def check_output_files(written: Mapping[Path, str], used: Mapping[Path, str]) -> None:
    """Raise CommandError where a file cannot be written, or is used for something else.

    Both say by path what the files are.
    """
    others = {os.path.realpath(path): (path, role) for path, role in used.items()}
    for path, what in written.items():
        place = resolve_output_path(path, what)
        if str(place) in others:
            other, role = others[str(place)]
            named = "" if other == path else f" '{other}'"
            raise CommandError(f"{what} '{path}' is {role}{named} too; write it to another file.")
