"""A lock that allows one run at a time to write to a folder."""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from ..base.errors import CommandError
from ..base.files import resolve_output_path
from ..base.ownership import is_new

_LOCK, _HOLDER = ".running", ".running.json"
_BEGINS = b'{"process": '
"""The beginning of the file that names the process with the lock."""


@contextmanager
def exclusive_lock(folder: Path, heir_of: int | None = None) -> Iterator[None]:
    """Lock a folder for the block.

    The lock ends with its process, however that ends. If an FMU started another process, that one keeps the
    lock. Without locks in the file system the folder is not locked.

    Args:
        folder: The folder.
        heir_of: A process that ended and whose lock is ignored.

    Raises:
        CommandError: If another process has the lock, or files that emla did not write have the names of the
            lock's files.
    """
    _check_names(folder)
    lock = FileLock(folder / _LOCK, timeout=0)
    try:
        lock.acquire()
    except Timeout as error:
        if heir_of is None or _read_lock(folder).get("process") != heir_of:
            raise CommandError(
                f"another run writes to '{folder}'{_holder(folder)}. Wait for it, or choose another folder."
            ) from error
    except NotImplementedError:
        yield
        return
    except OSError as error:
        raise CommandError(f"the output folder '{folder}' cannot be written: {error.strerror}.") from error
    holder = folder / _HOLDER
    try:
        began = datetime.now().astimezone().isoformat(timespec="seconds")
        with suppress(OSError):  # the lock works without this file
            holder.unlink(missing_ok=True)
            with holder.open("x", encoding="utf-8") as stream:  # "x" does not follow links
                stream.write(json.dumps({"process": os.getpid(), "began": began}))
        yield
    finally:
        for left in (holder, folder / _LOCK):
            with suppress(OSError):  # the folder may have been removed or replaced
                left.unlink()
        lock.release()


def _check_names(folder: Path) -> None:
    """Raise CommandError if a file of the lock is a link, no regular file, or not written by emla."""
    for name in (_LOCK, _HOLDER):
        place = resolve_output_path(folder / name, "the lock of the output folder")
        if not (is_new(place) or (name == _HOLDER and _is_holder(place))):
            raise CommandError(
                f"'{folder / name}' was not written by emla. Choose another output folder.",
                path=str(folder / name),
            )


def _is_holder(path: Path) -> bool:
    """Return whether a lock wrote this file, possibly in part on a full disk."""
    with suppress(FileNotFoundError, PermissionError), path.open("rb") as stream:
        head = stream.read(len(_BEGINS))
        return _BEGINS.startswith(head)
    return False


def _holder(folder: Path) -> str:
    found = _read_lock(folder)
    if not {"process", "began"} <= set(found):  # the other run just begins or ends
        return ""
    return f", process {found['process']} since {found['began']}"


def _read_lock(folder: Path) -> dict[str, Any]:
    """Return what the holder of the lock wrote, empty if it wrote nothing."""
    try:
        found = json.loads((folder / _HOLDER).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}
