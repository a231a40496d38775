"""A folder on a file system that ignores case: the temporary folder, or exFAT in a file."""

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

_NEEDED = ("mkfs.exfat", "mount.exfat-fuse", "losetup", "umount")


@contextmanager
def folder_ignoring_case(here: Path) -> Iterator[Path]:
    """Open such a folder; skip where none can be had. Only root may mount one."""
    if ignores_case(here):
        yield here
        return
    if not hasattr(os, "geteuid") or os.geteuid() != 0:
        pytest.skip("Only root can mount a file system that ignores case.")
    if any(shutil.which(tool) is None for tool in _NEEDED):
        pytest.skip("exFAT needs the packages exfat-fuse and exfatprogs.")
    image, folder = here / "image", here / "exfat"
    folder.mkdir()
    with image.open("wb") as stream:
        stream.truncate(64 * 2**20)
    device = ""
    try:
        _call("mkfs.exfat", str(image))
        device = _call("losetup", "-f", "--show", str(image)).strip()
        _call("mount.exfat-fuse", device, str(folder))
    except subprocess.CalledProcessError:
        if device:
            _call("losetup", "-d", device)
        pytest.skip("exFAT cannot be mounted here.")
    try:
        assert ignores_case(folder)
        yield folder
    finally:
        os.chdir(here)
        _call("umount", str(folder))
        _call("losetup", "-d", device)


def ignores_case(folder: Path) -> bool:
    """Return whether a file of a folder has its name in small and capital letters."""
    (folder / "case").touch()
    found = (folder / "CASE").exists()
    (folder / "case").unlink()
    return found


def _call(*command: str) -> str:
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout
