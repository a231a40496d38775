"""List and parse the shared libraries of an FMU, and list the functions that they must export."""

import re
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from emla_cosim.fmu.file import missing_bytes

from .binary_headers import NAMES_OF_VERSION_2, parse_platform
from .subject import Subject

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
    """Return the folders of platforms with binaries."""
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
