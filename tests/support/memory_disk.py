"""Temporary files in memory, where a machine has room for them.

The suite unpacks FMUs some thousand times; on a disk a fifth of its time goes into folders made and removed.
"""

import os
import shutil
import tempfile
from pathlib import Path

import psutil

_SHARED_MEMORY = Path("/dev/shm")
_ROOM = 4 * 2**30
"""Bytes that have to be free; a whole run needs a tenth of them."""


def use_memory_disk() -> None:
    """Let this process and those that it starts put temporary files into memory, unless TMPDIR says where."""
    if "TMPDIR" not in os.environ and _is_usable():
        os.environ["TMPDIR"] = tempfile.tempdir = str(_SHARED_MEMORY)


def _is_usable() -> bool:
    """Whether there is room, and libraries can be loaded from it, which containers may forbid."""
    try:
        room = min(shutil.disk_usage(_SHARED_MEMORY).free, psutil.virtual_memory().available)
        return (
            room > _ROOM
            and os.access(_SHARED_MEMORY, os.W_OK)
            and not os.statvfs(_SHARED_MEMORY).f_flag & os.ST_NOEXEC
        )
    except (OSError, AttributeError):  # no such folder, or no such question
        return False
