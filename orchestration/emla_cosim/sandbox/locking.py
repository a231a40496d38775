"""One run at a time into one folder."""

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
"""How the file begins that names the process which holds the lock."""


@contextmanager
def exclusive_lock(folder: Path, heir_of: int | None = None) -> Iterator[None]:
    """Nobody else writes to this folder meanwhile; CommandError that names the process that does.

    The lock goes with its process, however that ends, unless an FMU started another one, which holds it
    too then. Who goes on for the process `heir_of`, which ended, does not mind a lock of that one. Where
    a file system knows no locks there is none. CommandError also where something else has the names that
    the lock needs.
    """
    _check_names(folder)
    lock = FileLock(folder / _LOCK, timeout=0)
    try:
        lock.acquire()
    except Timeout as error:
        if heir_of is None or _read_lock(folder).get("process") != heir_of:
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
            holder.unlink(missing_ok=True)
            with holder.open("x", encoding="utf-8") as stream:  # never through a link
                stream.write(json.dumps({"process": os.getpid(), "began": began}))
        yield
    finally:
        for left in (holder, folder / _LOCK):
            with suppress(OSError):  # the folder may be gone, or be a file by now
                left.unlink()
        lock.release()


def _check_names(folder: Path) -> None:
    """Raise CommandError where a file of the lock is a link, no file, or somebody else's."""
    for name in (_LOCK, _HOLDER):
        place = resolve_output_path(folder / name, "the lock of the output folder")
        if not (is_new(place) or (name == _HOLDER and _is_holder(place))):
            raise CommandError(
                f"'{folder / name}' was not written by emla. Choose another output folder.",
                path=str(folder / name),
            )


def _is_holder(path: Path) -> bool:
    """Return whether a lock wrote this file; on a full disk it may have only begun to."""
    with suppress(OSError), path.open("rb") as stream:
        head = stream.read(len(_BEGINS))
        return _BEGINS.startswith(head)
    return False


def _holder(folder: Path) -> str:
    found = _read_lock(folder)
    if not {"process", "began"} <= set(found):  # it is just beginning, or just over
        return ""
    return f", process {found['process']} since {found['began']}"


def _read_lock(folder: Path) -> dict[str, Any]:
    """What the holder of the lock wrote of itself; nothing where it did not."""
    try:
        found = json.loads((folder / _HOLDER).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}
