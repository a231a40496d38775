"""One run at a time into one folder."""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path

from filelock import FileLock, Timeout

from .errors import CommandError

_LOCK, _HOLDER = ".running", ".running.json"


@contextmanager
def alone(folder: Path) -> Iterator[None]:
    """Nobody else writes to this folder meanwhile; CommandError that names the process that does.

    The lock goes with its process, however that ends. Where a file system knows no locks there is none.
    """
    lock = FileLock(folder / _LOCK, timeout=0)
    try:
        lock.acquire()
    except Timeout as error:
        raise CommandError(
            f"another run writes to '{folder}'{_holder(folder)}; wait for it, or give another folder."
        ) from error
    except NotImplementedError:
        yield
        return
    except OSError as error:
        raise CommandError(f"the output folder '{folder}' cannot be written: {error.strerror}.") from error
    holder = folder / _HOLDER
    try:
        began = datetime.now().astimezone().isoformat(timespec="seconds")
        with suppress(OSError):  # the lock holds without a name
            holder.write_text(json.dumps({"process": os.getpid(), "began": began}), encoding="utf-8")
        yield
    finally:
        for left in (holder, folder / _LOCK):
            left.unlink(missing_ok=True)
        lock.release()


def _holder(folder: Path) -> str:
    try:
        found = json.loads((folder / _HOLDER).read_text(encoding="utf-8"))
        return f", process {found['process']} since {found['began']}"
    except (OSError, ValueError, KeyError, TypeError):  # it is just beginning, or just over
        return ""
