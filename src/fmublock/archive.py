"""FMU files whose bytes depend on their content alone."""

import hashlib
import os
import uuid
import zipfile
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path

from .errors import BuildError
from .files import real_place, write_atomically

_ZIP_EPOCH = (1980, 1, 1, 0, 0, 0)
_KEY = "fmublock key "  # a zip's comment is no part of the FMU; repacking leaves it out


def content_guid(files: Mapping[str, bytes]) -> str:
    """A GUID that is a hash of names and contents: {8-4-4-4-12 hexadecimal digits}."""
    return "{" + str(uuid.UUID(bytes=_digest(files)[:16])) + "}"


def content_hash(files: Mapping[str, bytes]) -> str:
    """Twelve hexadecimal digits that tell these files from others."""
    return _digest(files).hex()[:12]


def _digest(files: Mapping[str, bytes]) -> bytes:
    digest = hashlib.sha256()
    for name in sorted(files):
        digest.update(f"{name}\0{len(files[name])}\0".encode())
        digest.update(files[name])
    return digest.digest()


def key_comment(key: str) -> bytes:
    """The zip comment that holds an FMU's key."""
    return f"{_KEY}{key}".encode()


@dataclass(frozen=True)
class BuiltFmu:
    """An FMU file as it was built: its key, and the platforms that it has binaries for."""

    key: str | None = None
    platforms: frozenset[str] = frozenset()


def read_built(path: Path) -> BuiltFmu:
    """What a file tells without being unpacked; nothing if it is missing, cut off, or no zip."""
    if not os.path.isfile(path):  # noqa: PTH113 (it raises nothing); a pipe would have to be waited for
        return BuiltFmu()
    try:
        with zipfile.ZipFile(path) as archive:
            comment = archive.comment.decode(errors="replace")
            names = archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return BuiltFmu()
    platforms = frozenset(name.split("/")[1] for name in names if name.startswith("binaries/"))
    return BuiltFmu(comment.removeprefix(_KEY) if comment.startswith(_KEY) else None, platforms)


def check_replaceable(path: Path, overwrite: bool = False) -> None:
    """Raise BuildError where an FMU would replace a file that fmublock did not build.

    With `overwrite` any regular file may be replaced, but never a link, a folder, a device or a pipe.
    """
    try:
        place = real_place(path)
        is_new = not place.exists() or place.stat().st_size == 0
    except OSError as error:
        raise BuildError(f"the FMU '{path}' cannot be written: {error.strerror or error}.") from error
    if not (overwrite or is_new or read_built(place).key):
        raise BuildError(
            f"'{path}' was not built here. Choose another folder for the FMU, or use --overwrite."
        )


def write_archive(
    path: Path, files: Mapping[str, bytes], comment: bytes = b"", stored: Collection[str] = ()
) -> None:
    """Zip the files to `path`, those that are `stored` as they are; a reader never sees half a file there.

    Raises OSError.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with write_atomically(path) as stream, zipfile.ZipFile(stream, "w") as archive:
        for name in sorted(files):
            entry = zipfile.ZipInfo(name, _ZIP_EPOCH)
            entry.compress_type = zipfile.ZIP_STORED if name in stored else zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, files[name], compresslevel=9)
        archive.comment = comment
