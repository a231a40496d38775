"""File access: clear messages if reading fails, atomic writing, and protection of existing files."""

import atexit
import hashlib
import json
import os
import re
import stat
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from fmublock.cache import CacheError as CacheError
from fmublock.cache import cache_folder as cache_folder
from fmublock.files import MARK, UNFINISHED, NotAFileError, make_temporary_folder, real_place, remove_folder
from fmublock.files import is_left as is_left
from fmublock.files import mark_of_process as mark_of_process
from fmublock.files import write_atomically as write_atomically

from .errors import CommandError, RunError

CURRENT_FOLDER = Path()
"""The working folder at the time when a path is used."""


@contextmanager
def temporary_folder(kind: str) -> Iterator[Path]:
    """Create a folder that is removed at the end of the block, or when the process that made it ends.

    A forked child process does not remove it. What a killed process left is removed by the next command.

    Args:
        kind: What the folder is for, in small letters.

    Yields:
        The folder, with symbolic links resolved.

    Raises:
        RunError: If no folder can be created.
    """
    try:
        folder, owner = make_temporary_folder(kind).resolve(), os.getpid()
    except OSError as error:
        raise RunError(
            f"temporary files cannot be written: {error.strerror}. Set TMPDIR to a writable folder."
        ) from error

    def remove() -> None:
        if os.getpid() == owner:
            remove_folder(folder)

    atexit.register(remove)
    try:
        yield folder
    finally:
        atexit.unregister(remove)
        remove()


_chdir_lock = threading.RLock()
"""Held while a thread changes the working folder, and while another one asks for it."""


def get_working_folder() -> Path:
    """Return the current working folder.

    Raises:
        CommandError: If it was removed.
    """
    try:
        with _chdir_lock:
            return Path.cwd()
    except OSError as error:
        raise CommandError("the current folder was removed; change to another one.") from error


@contextmanager
def restore_working_folder() -> Iterator[None]:
    """Restore the working folder at the end of the block.

    All threads of a process share it, so only one thread can be in such a block.
    """
    with _chdir_lock:
        before = get_working_folder()
        try:
            yield
        finally:
            os.chdir(before)


def read_file(path: Path, label: str, most: int = -1) -> bytes:
    """Return the content of a file.

    Args:
        path: The file.
        label: What the error message calls it, such as `the input`.
        most: The number of bytes to read; all if negative.

    Raises:
        CommandError: If it cannot be read.
    """
    try:
        kind = stat.S_IFMT(path.stat().st_mode)
        if kind in (stat.S_IFCHR, stat.S_IFBLK):
            raise CommandError(f"{label} '{path}' cannot be read: it is a device.")
        if kind == stat.S_IFIFO:  # reading it could block
            raise CommandError(f"{label} '{path}' cannot be read: it is a pipe.")
        with path.open("rb") as stream:
            return stream.read(most)
    except OSError as error:
        raise CommandError(f"{label} '{path}' cannot be read: {error.strerror}.") from error
    except ValueError as error:  # an invalid file name
        raise CommandError(f"{label} {str(path)!r} cannot be read: {error}.") from error


def read_text(path: Path, label: str) -> str:
    """Return the text of a UTF-8 file, with or without a byte-order mark.

    Args:
        path: The file.
        label: What the error message calls it.

    Raises:
        CommandError: If it cannot be read, or is not UTF-8.
    """
    try:
        return read_file(path, label).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise CommandError(f"{label} '{path}' is not a text in UTF-8.") from error


def hash_file(path: Path) -> str:
    """Return the SHA-256 hash of a file.

    Raises:
        OSError: If it cannot be read.
    """
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def hash_plain_data(content: object) -> str:
    """Return a short hash of plain data."""
    text = json.dumps(content, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def hash_if_readable(path: Path) -> str | None:
    """Return the SHA-256 hash of a file, or None if it cannot be read or is not a file."""
    try:
        return hash_file(path) if path.is_file() else None
    except (OSError, ValueError):
        return None


def resolve_output_path(path: Path, label: str, folder: Path = CURRENT_FOLDER) -> Path:
    """Return the real path of a file to be written; see `real_place`.

    Args:
        path: The file, relative to `folder`.
        label: What the error message calls it.
        folder: The folder of a relative path.

    Raises:
        CommandError: If it cannot be written.
    """
    try:
        real_path = real_place(folder / path)
        if not real_path.parent.is_dir():
            raise NotAFileError(0, f"there is no folder '{path.parent}'")
    except OSError as error:
        raise CommandError(f"{label} '{path}' cannot be written: {error.strerror or error}.") from error
    return real_path


_UNFINISHED = re.compile(rf"{re.escape(UNFINISHED)}({MARK}-)?[a-z0-9_]{{8}}")


def remove_unfinished(folder: Path) -> None:
    """Remove incomplete files that a killed process left in this folder."""
    with suppress(OSError):
        for path in folder.iterdir():
            if _UNFINISHED.fullmatch(path.name) and path.is_file() and not path.is_symlink():
                path.unlink()


@contextmanager
def report_write_errors(folder: Path) -> Iterator[None]:
    """Convert an OSError from writing to an output folder to a RunError that names the folder."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or error
        raise RunError(f"the output folder '{folder}' cannot be written: {reason}.") from error


def check_output_files(written: Mapping[Path, str], used: Mapping[Path, str]) -> None:
    """Check that files can be written and are not used otherwise.

    Two new files whose names differ only in case are the same: on some file systems one replaces the other.

    Args:
        written: What each file to be written is, by path.
        used: What each other file of the command is, by path.

    Raises:
        CommandError: If a file cannot be written, or is in `used` too.
    """
    used_files = [(os.path.realpath(path), path, role) for path, role in used.items()]
    for path, label in written.items():
        real_path = str(resolve_output_path(path, label))
        for used_real_path, used_path, role in used_files:
            if not is_same_path(real_path, used_real_path):
                continue
            alias = "" if used_path == path else f" '{used_path}'"
            raise CommandError(f"{label} '{path}' is also {role}{alias}. Choose another file.")


def is_same_path(first: str, second: str) -> bool:
    """Return whether two real paths may be the same file, on a file system that ignores case, too."""
    if first == second or first.casefold() != second.casefold():
        return first == second
    exist = [os.path.lexists(path) for path in (first, second)]
    return Path(first).samefile(second) if all(exist) else not any(exist)
