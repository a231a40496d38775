"""FMU files: opened, checked and unpacked once for all instances in a system, and their libraries."""

import struct
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from stat import S_ISLNK
from typing import IO

import fmpy
from fmpy.model_description import ModelDescription, ModelVariable

from ..base.errors import CommandError
from ..base.files import hash_file
from ..base.wording import format_count
from .interface import CO_SIMULATION, Interface, explain_unsupported_kind, read_interface

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
            _check_entry(entry)
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


def _check_entry(entry: zipfile.ZipInfo) -> None:
    """Raise UnsafeArchiveError for a path that leads out of the folder, and for a link."""
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


_EVENT_CAPABILITIES = ("hasEventMode", "mightReturnEarlyFromDoStep")


@dataclass(frozen=True)
class FmuFile:
    """An unpacked FMU.

    Attributes:
        path: The FMU file.
        folder: The folder with its content.
        interface: Its model description.
        library: The shared library for this machine.
        sha256: The hash of the file.
        kind: `CO_SIMULATION` or `MODEL_EXCHANGE`: as what its instances run.
        uses_event_mode: Whether its instances use event mode and early return, if it has them.
    """

    path: Path
    folder: Path
    interface: Interface
    library: Path
    sha256: str
    kind: str = CO_SIMULATION
    uses_event_mode: bool = True

    @property
    def description(self) -> ModelDescription:
        """Return the model description."""
        return self.interface.description

    @property
    def model_identifier(self) -> str:
        """Return the name of the library, without its extension."""
        return str(self.interface.kinds[self.kind].modelIdentifier)

    @property
    def is_ours(self) -> bool:
        """Return whether `fmublock` built the FMU."""
        return str(self.description.generationTool).endswith("fmublock")

    @property
    def variables(self) -> dict[str, ModelVariable]:
        """Return the variables by name."""
        return self.interface.variables

    def with_structure(self, structure: Mapping[str, int]) -> "FmuFile":
        """Return the file with other sizes of its arrays; `structure` is that of `Interface`."""
        return replace(self, interface=read_interface(self.path, structure)) if structure else self

    def has_capability(self, capability: str) -> bool:
        """Return whether the FMU has a capability flag of the standard, such as `canGetAndSetFMUstate`.

        Without event mode, it counts as one that has neither event mode nor early return.
        """
        if capability in _EVENT_CAPABILITIES and not self.uses_event_mode:
            return False
        return bool(getattr(self.interface.kinds[self.kind], capability, False))


def open_fmu(path: Path, folder: Path, kind: str | None = None) -> FmuFile:
    """Check an FMU file and unpack it to a folder.

    Args:
        path: The FMU file.
        folder: The folder to create.
        kind: As what it runs, one of its kinds. Default: co-simulation if it has that.

    Raises:
        CommandError: If the file does not exist, is not an FMU, or cannot run on this machine.
    """
    interface = read_interface(path)
    kind = kind or next(iter(interface.kinds))
    if kind not in interface.kinds:
        raise CommandError(f"the FMU '{path}' has no {kind}, only {next(iter(interface.kinds))}.")
    if (reason := explain_unsupported_kind(interface, kind)) is not None:
        raise CommandError(f"'{path}' {reason}.")
    try:
        unpack(path, folder)
    except UnsafeArchiveError as error:
        raise CommandError(f"the FMU '{path}' {error}.") from error
    except OSError as error:
        target_folder, reason = folder.parent.parent, error.strerror or error
        raise CommandError(
            f"the FMU '{path}' cannot be unpacked to '{target_folder}': {reason}. Set TMPDIR to another "
            "folder."
        ) from error
    except Exception as error:  # zipfile raises many types
        raise CommandError(f"'{path}' is not an FMU that can be read: {error}.") from error
    identifier = str(interface.kinds[kind].modelIdentifier)
    return FmuFile(
        path, folder, interface, _find_intact_library(path, folder, identifier), hash_file(path), kind
    )


def _find_intact_library(path: Path, folder: Path, identifier: str) -> Path:
    """Return the FMU's library for this machine; raise CommandError if it is missing or truncated."""
    if (library := find_library(folder, identifier)) is None:
        raise CommandError(f"'{path}' {explain_missing_library(folder, identifier)}.")
    # mapping a truncated library ends the process with SIGBUS where it is loaded
    if missing := missing_bytes(library):
        raise CommandError(
            f"the library '{library.parent.name}/{library.name}' of the FMU '{path}' is truncated: its last "
            f"{format_count(missing, 'byte is', 'bytes are')} missing. Download or build the FMU again."
        )
    return library
