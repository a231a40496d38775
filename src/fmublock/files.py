"""Files that are written whole or not at all, and never in the place of something that is no file."""

import os
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

UNFINISHED = ".unfinished-"
"""How names of files begin that are not complete."""

_KINDS = {
    stat.S_IFLNK: "a symbolic link",
    stat.S_IFDIR: "a folder",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFIFO: "a pipe",
    stat.S_IFSOCK: "a socket",
}


class NotAFileError(OSError):
    """What is at a path is no file, so nothing may be written there."""


def real_place(path: Path) -> Path:
    """Return where a file of this name is, or would be: absolute, in the real folder.

    Links to folders are followed, a link in the place of the file is not. Raises NotAFileError where a
    link, a folder, a device or the like is in the way, OSError for a name that no file can have.
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


@contextmanager
def write_atomically(path: Path) -> Iterator[IO[bytes]]:
    """A stream for the content of a file, which appears at the end of the block, complete and on disk.

    Until then, and where the block fails, an earlier file stays as it is. A link is not followed, and not
    replaced. Raises NotAFileError and OSError.
    """
    place = real_place(path)
    handle, name = tempfile.mkstemp(dir=place.parent, prefix=UNFINISHED)
    unfinished = Path(name)
    try:
        with os.fdopen(handle, "wb") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        unfinished.chmod(_mode(place))
        unfinished.replace(place)
    except BaseException:
        unfinished.unlink(missing_ok=True)
        raise


def _mode(place: Path) -> int:
    """The rights of the file that was there, or those of a new one."""
    try:
        return stat.S_IMODE(place.stat().st_mode)
    except FileNotFoundError:
        mask = os.umask(0)
        os.umask(mask)
        return 0o666 & ~mask
