"""Write files completely or not at all, and temporary folders that tell which process made them."""

import hashlib
import os
import re
import shutil
import stat
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import IO

MARK = r"(\d+)-(\d+)-([0-9a-f]{8})"
"""Pattern of the marks in names: process, start, place."""

_FOLDER = re.compile(rf"emla-[a-z]+-{MARK}-[a-z0-9_]{{8}}")


def mark_of_process() -> str:
    """Return the mark of this process for the names of its temporary files."""
    process = os.getpid()
    return f"{process}-{_find_start_time(process) or 0}-{_find_host_mark() or '0' * 8}"


def make_temporary_folder(kind: str) -> Path:
    """Create a temporary folder that `remove_leftovers` removes after this process was killed.

    Args:
        kind: What the folder is for, in small letters.

    Raises:
        OSError: If it cannot be created.
    """
    return Path(tempfile.mkdtemp(prefix=f"emla-{kind}-{mark_of_process()}-"))


def remove_leftovers() -> None:
    """Remove the temporary folders that killed processes of this user left. Errors are ignored."""
    with suppress(OSError), os.scandir(tempfile.gettempdir()) as entries:
        for entry in entries:
            match = _FOLDER.fullmatch(entry.name)
            if match is not None and is_left(match[1], match[2], match[3]) and _is_own_folder(entry):
                remove_folder(entry.path)


def remove_folder(folder: str | Path) -> None:
    """Remove a folder with all that is in it; a few open files are enough. Errors are ignored."""
    with suppress(OSError):  # from audit hooks, which ignore_errors does not cover
        shutil.rmtree(folder, ignore_errors=True)
        # rmtree has an open file for each level of folders, and gives up at the limit of open files
        for path, folders, files in os.walk(folder, topdown=False):
            for name in (*folders, *files):
                entry = Path(path, name)
                with suppress(OSError):
                    entry.unlink() if entry.is_symlink() or not entry.is_dir() else entry.rmdir()
        Path(folder).rmdir()


def is_left(process: str, start: str, host: str) -> bool:
    """Return whether the process of a mark has ended. If that cannot be known, it has not."""
    # in a shared folder, the process may run on another machine
    if host != _find_host_mark():
        return False
    try:
        os.stat(f"/proc/{process}")  # noqa: PTH116 (a path is not needed)
    except FileNotFoundError:
        return True
    except OSError:
        return False
    return _find_start_time(int(process)) not in (start, None)


def _is_own_folder(entry: os.DirEntry[str]) -> bool:
    """Return whether an entry is a folder that only this user can write to, and not a link."""
    status = entry.stat(follow_symlinks=False)
    return (
        stat.S_ISDIR(status.st_mode)
        and status.st_uid == os.geteuid()
        and not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    )


def _find_start_time(process: int) -> str | None:
    """Return the start of a process in clock ticks since the boot; None if it is unknown."""
    with suppress(OSError, IndexError):
        return Path(f"/proc/{process}/stat").read_text(errors="replace").rpartition(")")[2].split()[19]
    return None


@cache
def _find_host_mark() -> str | None:
    """Return a hash of what process ids depend on; None if it is unknown."""
    with suppress(OSError):
        boot = Path("/proc/sys/kernel/random/boot_id").read_text()
        return hashlib.sha256(f"{boot}{os.readlink('/proc/self/ns/pid')}".encode()).hexdigest()[:8]  # noqa: PTH115
    return None


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
