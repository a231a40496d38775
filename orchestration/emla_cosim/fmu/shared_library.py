"""Shared libraries, found, and looked at before they are loaded: a cut-off one would end the process."""

import struct
from pathlib import Path

import fmpy

_ELF = b"\x7fELF\x02\x01"  # of 64 bits, little-endian
_HEADER = struct.Struct("<32xQ14xHH6x")
"""Of the file: where its table of segments is, the size of an entry, and how many there are."""
_SEGMENT = struct.Struct("<I4xQ16xQ16x")
"""Of a segment: its type, where it is in the file, and its bytes there."""
_LOADED = 1


def find_library(folder: Path, identifier: str) -> Path | None:
    """Return the library of an unpacked FMU for this machine; None where there is none.

    It lies in the folder of the platform's tuple, or of its FMI 2.0 name.
    """
    for platform in (fmpy.platform_tuple, fmpy.platform):
        path = folder / "binaries" / platform / f"{identifier}{fmpy.sharedLibraryExtension}"
        if path.is_file():
            return path
    return None


def missing_bytes(path: Path) -> int:
    """How many bytes of a library's ELF segments lie beyond the end of its file.

    The loader of Linux maps them all the same, and the first access ends the process. It notices
    headers that are cut off, and other systems look at everything, so nothing is missing there.
    Raises OSError.
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
    whole = segments[: len(segments) // width * width]
    ends = [place + length for kind, place, length in _SEGMENT.iter_unpack(whole) if kind == _LOADED]
    return max(max(ends, default=0) - path.stat().st_size, 0)
