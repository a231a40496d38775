"""Safe unpacking of zip files from any source."""

import zipfile
from pathlib import Path, PurePosixPath
from stat import S_ISLNK
from typing import IO

LARGEST = 4 * 2**30
"""The largest total size of unpacked files in bytes."""

_BLOCK = 2**20


class UnsafeArchiveError(Exception):
    """An archive is unsafe; the message is the end of one that begins with the archive's name."""


def unpack(path: Path, folder: Path) -> None:
    """Unpack a zip file to a folder; nothing is written outside of it.

    Raises zipfile's exceptions if it cannot read the file.

    Raises:
        UnsafeArchiveError: If a name, link or size is unsafe; nothing is written if that is in the archive's
            directory.
        OSError: If writing fails.
    """
    with zipfile.ZipFile(path) as archive:
        entries = archive.infolist()
        for entry in entries:
            _check_name(entry)
        if (total := sum(entry.file_size for entry in entries)) > LARGEST:
            raise UnsafeArchiveError(
                f"would unpack to {total / 2**30:.1f} GiB; the limit is {LARGEST // 2**30} GiB"
            )
        names: dict[str, str] = {}
        for entry in entries:
            target = folder / entry.filename
            first = names.setdefault(entry.filename.casefold(), entry.filename)
            if first != entry.filename and target.is_file():  # the file system ignores case
                raise UnsafeArchiveError(
                    f"has entries whose names differ only in case from '{entry.filename}'; the folder for "
                    "temporary files cannot hold both: set TMPDIR to another one"
                )
            if entry.is_dir():
                target.mkdir(parents=True, exist_ok=True)
                continue
            target.parent.mkdir(parents=True, exist_ok=True)
            with archive.open(entry) as source, target.open("wb") as stream:
                _copy(source, stream, entry)


def _check_name(entry: zipfile.ZipInfo) -> None:
    name = entry.filename
    # a colon separates the drive in Windows
    outside = name.startswith("/") or ":" in name or ".." in PurePosixPath(name).parts
    if outside or "\\" in entry.orig_filename:
        raise UnsafeArchiveError(f"has the entry '{entry.orig_filename}', which is not a path inside it")
    if S_ISLNK(entry.external_attr >> 16):
        raise UnsafeArchiveError(f"has the entry '{name}', which is a symbolic link")


def _copy(source: IO[bytes], target: IO[bytes], entry: zipfile.ZipInfo) -> None:
    """Copy an entry; raise UnsafeArchiveError if its size differs from that in the directory."""
    remaining = entry.file_size
    # the directory of a malicious archive may understate sizes, which were checked before
    while block := source.read(_BLOCK):
        remaining -= len(block)
        if remaining < 0:
            raise UnsafeArchiveError(f"has the entry '{entry.filename}', which is longer than it says")
        target.write(block)
    if remaining:
        raise UnsafeArchiveError(f"has the entry '{entry.filename}', which is shorter than it says")
