"""A lock that allows one command at a time to write to a folder."""

import json
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from .errors import CommandError
from .files import (
    MARK,
    is_left,
    mark_of_process,
    resolve_output_path,
)
from .output_files import is_new

_LOCK, _HOLDER = ".running", ".running.json"


_HOLDER_HEAD = b'{"process": '
"""The beginning of the file that names the process with the lock; on a full disk, only a part of it."""


@contextmanager
def exclusive_lock(folder: Path) -> Iterator[None]:
    """Lock a folder for the block.

    The lock ends with its process, however that ends. Without locks in the file system the folder is not
    locked.

    Args:
        folder: The folder.

    Raises:
        CommandError: If another process has the lock, or files that emla did not write have the names of the
            lock's files.
    """
    for path in (folder / _LOCK, folder / _HOLDER):
        real_path = resolve_output_path(path, "the lock of the output folder")
        if not (
            is_new(real_path) or (path.name == _HOLDER and _HOLDER_HEAD.startswith(_read_head(real_path)))
        ):
            raise CommandError(
                f"'{path}' was not written by emla. Choose another output folder.", path=str(path)
            )
    holder = folder / _HOLDER
    lock = FileLock(folder / _LOCK, timeout=0)
    try:
        try:
            lock.acquire()
        except Timeout:
            mark = re.fullmatch(MARK, str(_read_holder(holder).get("mark")))
            if mark is None or not is_left(*mark.groups()):
                raise
            (folder / _LOCK).unlink(missing_ok=True)  # a process that an FMU started has it open
            lock.acquire()
    except Timeout as error:
        raise CommandError(
            f"another run writes to '{folder}'{_describe_holder(holder)}. "
            "Wait for it, or choose another folder."
        ) from error
    except NotImplementedError:
        yield
        return
    except OSError as error:
        raise CommandError(f"the output folder '{folder}' cannot be written: {error.strerror}.") from error
    try:
        start_time = datetime.now().astimezone().isoformat(timespec="seconds")
        with suppress(OSError):  # the lock works without this file
            holder.unlink(missing_ok=True)
            with holder.open("x", encoding="utf-8") as stream:  # "x" does not follow links
                content = {"process": os.getpid(), "began": start_time, "mark": mark_of_process()}
                stream.write(json.dumps(content))
        yield
    finally:
        for path in (holder, folder / _LOCK):
            with suppress(OSError):  # the folder may have been removed or replaced
                path.unlink()
        lock.release()


def _read_head(path: Path) -> bytes:
    """Return the first bytes of the file that names the process with the lock; none without the file."""
    with suppress(FileNotFoundError), path.open("rb") as stream:  # the other run just ends
        return stream.read(len(_HOLDER_HEAD))
    return b""


def _read_holder(path: Path) -> dict[str, Any]:
    """Return what is noted about the process with the lock; nothing while it begins or ends."""
    try:
        holder = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return holder if isinstance(holder, dict) else {}


def _describe_holder(path: Path) -> str:
    """Return process and time of the lock as a part of a message; empty if they are not known."""
    holder = _read_holder(path)
    if not {"process", "began"} <= holder.keys():
        return ""
    return f", process {holder['process']} since {holder['began']}"
