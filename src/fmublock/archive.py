"""FMU files whose bytes depend on their content alone."""

import errno
import hashlib
import os
import uuid
import zipfile
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

from .errors import BuildError
from .files import accept, real_place, write_atomically
from .platforms import platform_of

_ZIP_EPOCH = (1980, 1, 1, 0, 0, 0)
_KEY = "fmublock key "  # in the zip's comment, which is not part of the FMU; repacking drops it


def content_guid(files: Mapping[str, bytes]) -> str:
    """Return the hash of names and contents as a GUID: {8-4-4-4-12 hexadecimal digits}."""
    return "{" + str(uuid.UUID(bytes=_digest(files)[:16])) + "}"


def content_hash(files: Mapping[str, bytes]) -> str:
    """Return the hash of names and contents as twelve hexadecimal digits."""
    return _digest(files).hex()[:12]


def _digest(files: Mapping[str, bytes]) -> bytes:
    digest = hashlib.sha256()
    for name in sorted(files):
        digest.update(f"{name}\0{len(files[name])}\0".encode())
        digest.update(files[name])
    return digest.digest()


def key_comment(key: str) -> bytes:
    """Return the zip comment that holds an FMU's key."""
    return f"{_KEY}{key}".encode()


@dataclass(frozen=True)
class BuiltFmu:
    """What an FMU file says about its build: its key, and the platforms of its binaries."""

    key: str | None = None
    platforms: frozenset[str] = frozenset()


def read_built(path: Path) -> BuiltFmu:
    """Read key and platforms of an FMU without unpacking it.

    The result is empty if the file is missing, truncated, or not a zip.

    Raises:
        OSError: Too many files are open.
    """
    if not os.path.isfile(path):  # noqa: PTH113 (never raises); opening a pipe would block
        return BuiltFmu()
    try:
        with zipfile.ZipFile(path) as archive:
            comment = archive.comment.decode(errors="replace")
            names = archive.namelist()
    except (OSError, zipfile.BadZipFile) as error:
        if isinstance(error, OSError) and error.errno in (errno.EMFILE, errno.ENFILE):
            raise  # a limit of the machine must not make it a file that others built
        return BuiltFmu()
    platforms = frozenset(platform_of(name.split("/")[1]) for name in names if name.startswith("binaries/"))
    return BuiltFmu(comment.removeprefix(_KEY) if comment.startswith(_KEY) else None, platforms)


def check_replaceable(path: Path, overwrite: bool = False) -> None:
    """Check that an FMU may be written to `path`.

    Args:
        path: Where the FMU will be written.
        overwrite: Whether it may replace a file that fmublock did not build. It never replaces a
            link, a folder, a device or a pipe.

    Raises:
        BuildError: The FMU may not be written there.
    """
    try:
        file = real_place(path)
        is_new = not file.exists() or file.stat().st_size == 0
        if not is_new:
            file.open("rb").close()  # a limit must not make it a file that others built
    except OSError as error:
        raise BuildError(f"the FMU '{path}' cannot be written: {error.strerror or error}.") from error
    if not (overwrite or is_new or read_built(file).key):
        raise BuildError(
            f"'{path}' was not built by fmublock. Choose another folder for the FMU, or use --overwrite."
        )


def write_archive(
    path: Path,
    files: Mapping[str, bytes],
    comment: bytes = b"",
    stored: Collection[str] = (),
    check: Callable[[Path], object] = accept,
) -> None:
    """Zip files to `path`. A reader never sees an incomplete file there.

    Args:
        path: The zip file; missing folders are created.
        files: Contents by name.
        comment: The zip's comment.
        stored: Names of the files that are not compressed.
        check: Checks a file that is replaced; see `write_atomically`.

    Raises:
        OSError: The file cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with write_atomically(path, check) as stream, zipfile.ZipFile(stream, "w") as archive:
        for name in sorted(files):
            # the time and the permissions of files would differ between builds of the same content
            entry = zipfile.ZipInfo(name, _ZIP_EPOCH)
            entry.compress_type = zipfile.ZIP_STORED if name in stored else zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, files[name], compresslevel=9)
        archive.comment = comment
