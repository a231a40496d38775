"""List and parse the shared libraries of an FMU: system, processor, functions."""

import re
import struct
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from emla_cosim.fmu.file import missing_bytes

from .subject import Subject

_ELF = {3: "x86", 62: "x86_64", 40: "aarch32", 183: "aarch64", 243: "riscv64"}
_PE = {0x014C: "x86", 0x8664: "x86_64", 0x01C4: "aarch32", 0xAA64: "aarch64"}
_MACH = {7: "x86", 0x01000007: "x86_64", 0x0100000C: "aarch64"}
_MACH_MAGIC = {b"\xce\xfa\xed\xfe": "<", b"\xcf\xfa\xed\xfe": "<"}
_FAT = (b"\xca\xfe\xba\xbe", b"\xca\xfe\xba\xbf")
# most processors of a universal library: Java classes begin with the same bytes
_MOST_PARTS = 20
# class of an ELF file: `ELFCLASS32`
_32_BITS = 1

_TARGETS_OF_VERSION_2 = {
    f"{name}{bits}": (system, processor)
    for name, system in (("linux", "linux"), ("win", "windows"), ("darwin", "darwin"))
    for bits, processor in ((32, "x86"), (64, "x86_64"))
}
_SYSTEMS = {
    **dict.fromkeys(("windows", "win"), "windows"),
    **dict.fromkeys(("darwin", "macos", "mac", "osx"), "darwin"),
    "linux": "linux",
}
_PROCESSORS = {
    **dict.fromkeys(("x86_64", "amd64", "x64", "64"), "x86_64"),
    **dict.fromkeys(("x86", "i386", "i686", "32"), "x86"),
    **dict.fromkeys(("aarch64", "arm64"), "aarch64"),
    **dict.fromkeys(("aarch32", "arm32", "armv7"), "aarch32"),
}
_WORDS = re.compile(f"{'|'.join(sorted({*_SYSTEMS, *_PROCESSORS}, key=len, reverse=True))}|[-_ ]|.+?")
"""Names of systems and processors, and what may separate them."""

NAMES_OF_VERSION_2 = frozenset(_TARGETS_OF_VERSION_2)
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
            processor = _ELF.get(struct.unpack_from(f"{order}H", head, 18)[0], "")
            is_x32 = processor == "x86_64" and head[4] == _32_BITS  # pointers have 32 bits
            return {("linux", "x32" if is_x32 else processor)}
        if head.startswith(b"MZ"):
            (position,) = struct.unpack_from("<I", head, 60)
            if head[position : position + 4] == b"PE\0\0":
                return {("windows", _PE.get(struct.unpack_from("<H", head, position + 4)[0], ""))}
        if head[:4] in _MACH_MAGIC:
            return {("darwin", _MACH.get(struct.unpack_from("<I", head, 4)[0], ""))}
        if head[:4] in _FAT:
            (count,) = struct.unpack_from(">I", head, 4)
            width = 20 if head[:4] == _FAT[0] else 32
            parts = range(count) if count <= _MOST_PARTS else ()
            processors = [struct.unpack_from(">I", head, 8 + width * k)[0] for k in parts]
            return {("darwin", _MACH.get(processor, "")) for processor in processors}
    except struct.error:
        pass  # truncated
    return set()


def parse_platform(folder: str) -> tuple[str, str] | None:
    """Return the system and processor of a platform's folder; None if its name is not standardized."""
    if folder in _TARGETS_OF_VERSION_2:
        return _TARGETS_OF_VERSION_2[folder]
    processor, _, system = folder.partition("-")
    processors = {*_ELF.values(), *_PE.values(), *_MACH.values()}
    is_standard = system in ("linux", "windows", "darwin") and processor in processors
    return (system, processor) if is_standard else None


def describe_mismatch(path: Path, folder: str) -> str:
    """Return the platforms of a library whose folder is for another one; otherwise an empty string."""
    expected, actual = parse_platform(folder), read_targets(path)
    if expected is None or not actual or expected in actual:
        return ""
    if folder == "darwin64" and ("darwin", "aarch64") in actual:
        return ""  # usual for macOS on ARM, for which FMI 2.0 had no name
    return " and ".join(
        sorted(f"{system} on {processor or 'another processor'}" for system, processor in actual)
    )


def suggest_platform(folder: str, version: int) -> str:
    """Return the standard name that a folder in `binaries` should have; empty if it has it, or none fits."""
    words = [word for word in _WORDS.findall(folder.lower()) if word not in "-_ "]
    systems = [_SYSTEMS[word] for word in words if word in _SYSTEMS]
    processors = [_PROCESSORS[word] for word in words if word in _PROCESSORS]
    if len(words) != 2 or len(systems) != 1 or len(processors) != 1:
        return ""
    target = systems[0], processors[0]
    names = {pair: name for name, pair in _TARGETS_OF_VERSION_2.items()} if version == 2 else {}
    name = names.get(target, f"{target[1]}-{target[0]}")
    return "" if name == folder else name


# bits of `n_type` in the symbol table of Mach-O: N_EXT, N_STAB and N_PEXT, N_TYPE, N_SECT
_EXTERNAL, _DEBUG_OR_PRIVATE, _TYPE, _IN_SECTION = 0x01, 0xF0, 0x0E, 0x0E

_OF_SYSTEM = {"linux": ".so", "windows": ".dll", "darwin": ".dylib"}
SUFFIXES = tuple(_OF_SYSTEM.values())
"""Suffixes of libraries."""


@dataclass(frozen=True)
class Library:
    """A library with the name of a model identifier, and the kinds of FMU that it is for."""

    path: Path
    kinds: tuple[str, ...]

    @property
    def platform(self) -> str:
        """Name of the platform's folder: `linux64`."""
        return self.path.parent.name

    def __str__(self) -> str:
        return f"{self.platform}/{self.path.name}"


def list_libraries(subject: Subject) -> list[Library]:
    """Return the libraries that model identifiers name, for all platforms."""
    by_path: dict[Path, list[str]] = {}
    for kind in subject.kinds:
        name = subject.tree.find(kind).get("modelIdentifier")
        for folder in list_platforms(subject):
            if subject.version == 3 and folder.name in NAMES_OF_VERSION_2:
                continue  # no tool looks there for a library of FMI 3.0
            suffix = find_suffix(folder.name)
            suffixes = (suffix,) if suffix else SUFFIXES
            for path in sorted(folder.iterdir()):
                if path.is_file() and path.stem == name and path.suffix in suffixes:
                    by_path.setdefault(path, []).append(kind)
    return [Library(path, tuple(kinds)) for path, kinds in by_path.items()]


def find_suffix(folder: str) -> str:
    """Return the suffix of libraries in the folder of a platform; empty if its name is not standardized."""
    target = parse_platform(folder)
    return "" if target is None else _OF_SYSTEM[target[0]]


def list_platforms(subject: Subject) -> list[Path]:
    """Return the folders in `binaries`, one for each platform; some may be empty."""
    binaries = subject.folder / "binaries"
    return sorted(p for p in binaries.iterdir() if p.is_dir()) if binaries.is_dir() else []


def find_dependencies_file(subject: Subject) -> str:
    """Return the file that lists the FMU's external dependencies, or an empty string."""
    names = [f"documentation/externalDependencies.{kind}" for kind in ("txt", "html")]
    return next((name for name in names if (subject.folder / name).is_file()), "")


def parse_library(path: Path) -> Any:
    """Parse a library with LIEF. Return None if it is not a library, or truncated."""
    import lief  # slow to load, and only three checks need it

    lief.logging.disable()
    if missing_bytes(path):
        return None
    with suppress(Exception):  # LIEF raises several kinds
        binary = lief.parse(str(path))
        if isinstance(binary, lief.MachO.FatBinary):
            return binary.at(0)
        return binary
    return None


@cache
def list_functions(kind: str, version: int) -> tuple[str, ...]:
    """Return the functions of an FMU of a kind, in the order of the header file of FMI 2.0 or 3.0."""
    header = (files("fmpy") / "c-code" / f"fmi{version}Functions.h").read_text(encoding="utf-8")
    if version == 3:
        return tuple(re.findall(r"FMI3_Export\s+fmi3\w+TYPE\s+(fmi3\w+);", header))
    title = {"ModelExchange": "Model Exchange", "CoSimulation": "Co-Simulation"}[kind]
    parts = re.split(r"/\*{9,}\s*(.+?)\s*\*{9,}/", header)
    bodies = [
        body
        for name, body in zip(parts[1::2], parts[2::2], strict=True)
        if name.endswith((title, "Common Functions"))
    ]
    return tuple(re.findall(r"fmi2FullName\((fmi2\w+)\)", "".join(bodies)))


def list_exports(binary: Any) -> set[str]:
    """Return the C names of the functions that a library exports."""
    import lief

    names = {
        str(function.name)
        for function in (*binary.exported_functions, *getattr(binary, "exported_symbols", ()))
    }
    if not isinstance(binary, lief.MachO.Binary):
        return names
    # older linkers write no export trie: symbols that are defined in the library and visible outside
    kinds = ((str(s.name), s.raw_type) for s in binary.symbols)
    names |= {n for n, t in kinds if t & _EXTERNAL and t & (_DEBUG_OR_PRIVATE | _TYPE) == _IN_SECTION}
    return {name.removeprefix("_") for name in names}


def list_needed_libraries(binary: Any) -> list[str]:
    """Return the names of the libraries that a library loads."""
    import lief

    if not isinstance(binary, lief.MachO.Binary):
        return [str(name) for name in binary.libraries]
    name_of_library = lief.MachO.LoadCommand.TYPE.ID_DYLIB
    return [str(command.name) for command in binary.libraries if command.command != name_of_library]
