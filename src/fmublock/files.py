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

_LEFT = re.compile(rf"{re.escape(UNFINISHED)}{MARK}-[a-z0-9_]{{8}}")

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
        place = Path(os.path.realpath(path) if is_folder else os.path.realpath(path.parent))
        place = place if is_folder else place / path.name
    except ValueError as error:  # a NUL in the name of a folder
        raise NotAFileError(0, str(error)) from error
    try:
        kind = stat.S_IFMT(place.lstat().st_mode)
    except ValueError as error:  # a NUL in the name of the file
        raise NotAFileError(0, str(error)) from error
    except FileNotFoundError:
        return place
    if kind != stat.S_IFREG:
        raise NotAFileError(0, f"it is {_KINDS.get(kind, 'no file')}")
    return place


def accept(place: Path) -> None:
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
    place = real_place(path)
    _remove_left(str(place.parent))
    handle, name = tempfile.mkstemp(dir=place.parent, prefix=f"{UNFINISHED}{mark_of_process()}-")
    unfinished = Path(name)
    try:
        with os.fdopen(handle, "wb") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        unfinished.chmod(_mode(place))
        if os.path.lexists(place):
            real_place(place)
            check(place)
        unfinished.replace(place)
    except BaseException:
        unfinished.unlink(missing_ok=True)
        raise


@cache
def _remove_left(folder: str) -> None:
    """Remove incomplete files that killed processes left in a folder. A process does this once."""
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            found = _LEFT.fullmatch(entry.name)
            if (
                found is not None
                and is_left(found[1], found[2], found[3])
                and entry.is_file(follow_symlinks=False)
            ):
                os.unlink(entry.path)  # noqa: PTH108 (a path is not needed)


def _mode(place: Path) -> int:
    """Return the permissions of the existing file, or those of a new one."""
    try:
        return stat.S_IMODE(place.stat().st_mode)
    except FileNotFoundError:
        mask = os.umask(0)
        os.umask(mask)
        return 0o666 & ~mask
