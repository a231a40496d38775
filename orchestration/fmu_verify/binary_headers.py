"""Read from the header of a library for which system and processor it is."""

import struct
from pathlib import Path

_ELF = {3: "x86", 62: "x86_64", 40: "aarch32", 183: "aarch64", 243: "riscv64"}
_PE = {0x014C: "x86", 0x8664: "x86_64", 0x01C4: "aarch32", 0xAA64: "aarch64"}
_MACH = {7: "x86", 0x01000007: "x86_64", 0x0100000C: "aarch64"}
_MACH_MAGIC = {b"\xce\xfa\xed\xfe": "<", b"\xcf\xfa\xed\xfe": "<"}
_FAT = (b"\xca\xfe\xba\xbe", b"\xca\xfe\xba\xbf")
_MOST_PARTS = 20
"""Most processors of a universal library: Java classes begin with the same bytes."""

_OF_FOLDER = {
    "linux32": ("linux", "x86"),
    "linux64": ("linux", "x86_64"),
    "win32": ("windows", "x86"),
    "win64": ("windows", "x86_64"),
    "darwin32": ("darwin", "x86"),
    "darwin64": ("darwin", "x86_64"),
}

NAMES_OF_VERSION_2 = frozenset(_OF_FOLDER)
"""Names of platforms in FMI 2.0."""


def read_targets(path: Path) -> set[tuple[str, str]]:
    """Return the systems and processors that a library is for, such as `("linux", "x86_64")`.

    The set is empty for a file that is not a library of a known kind. An unknown processor is `""`.
    """
    with path.open("rb") as stream:
        head = stream.read(4096)
    try:
        if head.startswith(b"\x7fELF"):
            order = "<" if head[5] == 1 else ">"
            return {("linux", _ELF.get(struct.unpack_from(f"{order}H", head, 18)[0], ""))}
        if head.startswith(b"MZ"):
            (place,) = struct.unpack_from("<I", head, 60)
            if head[place : place + 4] == b"PE\0\0":
                return {("windows", _PE.get(struct.unpack_from("<H", head, place + 4)[0], ""))}
        if head[:4] in _MACH_MAGIC:
            return {("darwin", _MACH.get(struct.unpack_from("<I", head, 4)[0], ""))}
        if head[:4] in _FAT:
            (count,) = struct.unpack_from(">I", head, 4)
            width = 20 if head[:4] == _FAT[0] else 32
            parts = range(count) if count <= _MOST_PARTS else ()
            found = [struct.unpack_from(">I", head, 8 + width * k)[0] for k in parts]
            return {("darwin", _MACH.get(processor, "")) for processor in found}
    except struct.error:
        pass  # truncated
    return set()


def wanted_target(folder: str) -> tuple[str, str] | None:
    """Return the system and processor of a platform's folder; None if its name is not standardized."""
    if folder in _OF_FOLDER:
        return _OF_FOLDER[folder]
    processor, _, system = folder.partition("-")
    known = {*_ELF.values(), *_PE.values(), *_MACH.values()}
    return (system, processor) if system in ("linux", "windows", "darwin") and processor in known else None
