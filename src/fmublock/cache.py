"""What is built: in a wheel, which brings some of it, and in the cache folder with the caches of tools."""

import os
import sys
import tempfile
from functools import cache
from pathlib import Path

from .errors import CacheError
from .platforms import has_musl

VARIABLE = "EMLA_COSIM_CACHE"
"""Environment variable that names another folder."""


PREBUILT = Path(__file__).parent / "prebuilt"
"""What a wheel brings: a cache that is only read. A source tree has none."""


def find_built(*parts: str) -> Path:
    """Return the path of a built file: in the wheel if it is there, otherwise in the cache folder.

    Args:
        parts: folders and name of the file in a cache.

    Raises:
        CacheError: the file is not in the wheel, and the cache folder is not writable.
    """
    return find_prebuilt(*parts) or cache_folder().joinpath(*parts)


def find_prebuilt(*parts: str) -> Path | None:
    """Return the path of a file that the wheel brings for this machine; None if there is none.

    Args:
        parts: folders and name of the file in a cache.
    """
    path = PREBUILT.joinpath(*parts)
    # the libraries in wheels are for glibc
    return path if path.is_file() and not has_musl() else None


def cache_folder() -> Path:
    """Return a writable cache folder of this user.

    This is the folder of the environment variable, else one in the user's cache of the operating system.
    Without a writable home (containers) it is one among the temporary files.

    Raises:
        CacheError: The variable's folder is not writable.
    """
    variable = os.environ.get(VARIABLE)
    if variable:
        folder = Path(variable).absolute()
        if not _is_writable(folder):
            raise CacheError(f"the folder '{variable}' of {VARIABLE} cannot be written to.")
        return folder
    home = _find_home_cache()
    return _make_temporary_folder() if home is None else home / "emla-cosim"


def tool_environment() -> dict[str, str]:
    """Return the environment variables that zig and matplotlib need without a writable home."""
    if _find_home_cache() is not None and (sys.platform == "win32" or os.environ.get("HOME")):
        return {}  # zig needs HOME; others find the home folder without it
    folder = cache_folder()
    folders = {
        "ZIG_GLOBAL_CACHE_DIR": folder / "zig",
        "ZIG_LOCAL_CACHE_DIR": folder / "zig",
        "MPLCONFIGDIR": folder / "matplotlib",
    }
    return {name: str(folder_of_tool) for name, folder_of_tool in folders.items() if name not in os.environ}


@cache
def _find_home_cache() -> Path | None:
    """Return the folder of all caches of this user; None if it is not writable."""
    from platformdirs import user_cache_path  # slow; needed only if the FMU is not found without the cache

    if os.environ.get("HOME") == "" and not os.environ.get("XDG_CACHE_HOME", "").strip():
        return None  # the cache would be in the root folder
    folder = user_cache_path()
    return folder if folder.is_absolute() and _is_writable(folder) else None


@cache
def _make_temporary_folder() -> Path:
    """Return a temporary folder that only this user can write to, as binaries are loaded from it."""
    user = os.getuid() if hasattr(os, "getuid") else "user"
    folder = Path(tempfile.gettempdir()) / f"emla-cosim-{user}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        # another user may have created the folder before, and could put libraries into it
        status = folder.lstat()
        if folder.is_symlink() or (
            hasattr(os, "getuid") and (status.st_uid != user or status.st_mode & 0o022)
        ):
            raise PermissionError
    except OSError:
        folder = Path(tempfile.mkdtemp(prefix="emla-cosim-"))
    return folder


def _is_writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        # permissions alone do not show a full disk or a read-only file system
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False
