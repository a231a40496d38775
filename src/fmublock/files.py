"""Write files completely or not at all, and never in place of something that is not a regular file."""

import os
import re
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import IO

from .leftovers import MARK, is_left, mark_of_process

UNFINISHED = ".unfinished-"
"""Prefix of the names of incomplete files."""

_UNFINISHED_NAME = re.compile(rf"{re.escape(UNFINISHED)}{MARK}-[a-z0-9_]{{8}}")

_KINDS = {
    stat.S_IFLNK: "a symbolic link",
    stat.S_IFDIR: "a folder",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
}


class NotAFileError(OSError):
    """The path is taken by something that is not a regular file."""


def real_place(path: Path) -> Path:
    """Return the absolute path of a file that exists or will be written, in its real folder.

    Links to folders are followed. A link in place of the file is not.

    Raises:
        NotAFileError: A link, a folder, a device or the like has this name.
        OSError: No file can have this name.
    """
    try:
        is_folder = path.name in ("", "..")
        file = Path(os.path.realpath(path) if is_folder else os.path.realpath(path.parent))
        file = file if is_folder else file / path.name
    except ValueError as error:  # a NUL in the name of a folder
        raise NotAFileError(0, str(error)) from error
    try:
        kind = stat.S_IFMT(file.lstat().st_mode)
    except ValueError as error:  # a NUL in the name of the file
        raise NotAFileError(0, str(error)) from error
    except FileNotFoundError:
        return file
    if kind != stat.S_IFREG:
        raise NotAFileError(0, f"it is {_KINDS.get(kind, 'no file')}")
    return file


def accept(path: Path) -> None:
    """Let `write_atomically` replace any regular file."""


@contextmanager
def write_atomically(path: Path, check: Callable[[Path], object] = accept) -> Iterator[IO[bytes]]:
    """Open a stream for a file that appears, complete and on disk, at the end of the `with` block.

    Until then, and if the block fails, an existing file stays unchanged. A link is neither followed nor
    replaced.

    Args:
        path: The file.
        check: Called with the real path at the end if a file has this name. It raises an error if
            that file must not be replaced.

    Raises:
        NotAFileError: Something that is not a regular file has this name.
        OSError: The file cannot be written.
    """
    file = real_place(path)
    _remove_unfinished(str(file.parent))
    handle, name = tempfile.mkstemp(dir=file.parent, prefix=f"{UNFINISHED}{mark_of_process()}-")
    unfinished = Path(name)
    try:
        with os.fdopen(handle, "wb") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        unfinished.chmod(_get_mode(file))
        # checked again here: the file can appear while a command runs
        if os.path.lexists(file):
            real_place(file)
            check(file)
        unfinished.replace(file)
    except BaseException:
        unfinished.unlink(missing_ok=True)
        raise


@cache
def _remove_unfinished(folder: str) -> None:
    """Remove incomplete files that killed processes left in a folder. A process does this once."""
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            match = _UNFINISHED_NAME.fullmatch(entry.name)
            if (
                match is not None
                and is_left(match[1], match[2], match[3])
                and entry.is_file(follow_symlinks=False)
            ):
                os.unlink(entry.path)  # noqa: PTH108 (a path is not needed)


def _get_mode(path: Path) -> int:
    """Return the permissions of the existing file, or those of a new one."""
    try:
        return stat.S_IMODE(path.stat().st_mode)
    except FileNotFoundError:
        # the only way to read the mask is to set it
        mask = os.umask(0)
        os.umask(mask)
        return 0o666 & ~mask
