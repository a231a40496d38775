"""Shared libraries: finding them, and detecting truncated ones, which end the process when loaded."""

import struct
from pathlib import Path

import fmpy

_ELF = b"\x7fELF\x02\x01"  # 64 bits, little-endian
_HEADER = struct.Struct("<32xQ14xHH6x")
"""The fields of the file header: the offset of the segment table, the size of an entry, and their number."""
_SEGMENT = struct.Struct("<I4xQ16xQ16x")
"""The fields of a segment: its type, its offset in the file, and its size there."""
_LOADED_TYPE = 1


def find_library(folder: Path, identifier: str) -> Path | None:
    """Return the library of an unpacked FMU for this machine, or None.

    It is in the folder of the platform tuple, or of the FMI 2.0 platform name.
    """
    for platform in (fmpy.platform_tuple, fmpy.platform):
        path = folder / "binaries" / platform / f"{identifier}{fmpy.sharedLibraryExtension}"
        if path.is_file():
            return path
    return None


def explain_missing_library(folder: Path, identifier: str) -> str:
    """Return why an unpacked FMU has no library for this machine, as the end of a message."""
    missing, name = f"has no binary for {fmpy.platform}", f"{identifier}{fmpy.sharedLibraryExtension}"
    for platform in (fmpy.platform_tuple, fmpy.platform):
        inside = folder / "binaries" / platform
        if inside.is_dir():
            present = sorted(str(p.relative_to(inside)) for p in inside.rglob("*") if p.is_file())
            if not present:
                return f"{missing}: the folder 'binaries/{platform}' is empty"
            more = f" and {len(present) - 4} more files" if len(present) > 4 else ""
            return (
                f"{missing}: the folder 'binaries/{platform}' has {', '.join(present[:4])}{more}, but not "
                f"'{name}', which is named after the modelIdentifier"
            )
    files = (p.relative_to(folder / "binaries") for p in folder.glob("binaries/*/**/*") if p.is_file())
    platforms = sorted({file.parts[0] for file in files})
    has_sources = any((folder / "sources").rglob("*.c"))
    for platform in platforms:
        right = platform.casefold()
        if platform != right in (fmpy.platform_tuple, fmpy.platform):
            return f"{missing}: the folder 'binaries/{platform}' must have the name '{right}'"
    if platforms:
        sources = ", and C sources, of which `fmpy compile` can make one" if has_sources else ""
        return f"{missing}, only for {', '.join(platforms)}{sources}"
    return (
        f"{missing}, only C sources; `fmpy compile` can build it"
        if has_sources
        else f"{missing} or any other platform"
    )


def missing_bytes(path: Path) -> int:
    """Return how many bytes of a library's ELF segments are beyond the end of its file.

    Linux maps such segments without an error, and the first access ends the process. Truncated headers, and
    files of other systems, give 0, because their loaders detect the fault.

    Raises:
        OSError: If the file cannot be read.
    """
    with path.open("rb") as stream:
        head = stream.read(_HEADER.size)
        if not head.startswith(_ELF) or len(head) < _HEADER.size:
            return 0
        table, width, count = _HEADER.unpack(head)
        if width != _SEGMENT.size:
            return 0
        stream.seek(min(table, path.stat().st_size))
        segments = stream.read(width * count)
    entries = segments[: len(segments) // width * width]
    ends = [offset + length for kind, offset, length in _SEGMENT.iter_unpack(entries) if kind == _LOADED_TYPE]
    return max(max(ends, default=0) - path.stat().st_size, 0)
