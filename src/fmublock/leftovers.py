"""Temporary folders and files whose names tell which process made them.

A process that is killed leaves them behind, and the next one removes them. The mark in a name is the process
id, the time at which that process started (process ids are used again), and a hash of the machine's boot and
of the process namespace (containers and machines that share a folder see other processes). Without
`/proc`, nothing is removed.
"""

import hashlib
import os
import re
import shutil
import stat
import tempfile
from contextlib import suppress
from functools import cache
from pathlib import Path

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
