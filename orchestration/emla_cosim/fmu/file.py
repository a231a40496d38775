"""FMU files: opened, checked and unpacked once, however many instances a system has."""

from dataclasses import dataclass
from pathlib import Path

import fmpy
from fmpy.model_description import ModelDescription, ModelVariable

from ..base.errors import CommandError
from ..base.files import hash_file
from ..base.wording import format_count
from .interface import Interface, read_interface
from .shared_library import find_library, missing_bytes
from .unpack import UnsafeArchiveError, unpack


@dataclass(frozen=True)
class FmuFile:
    """An unpacked FMI 2.0 co-simulation FMU."""

    path: Path
    folder: Path
    interface: Interface
    library: Path
    sha256: str

    @property
    def description(self) -> ModelDescription:
        """The model description."""
        return self.interface.description

    @property
    def model_identifier(self) -> str:
        """The name of the library, without its ending."""
        return self.interface.model_identifier

    @property
    def variables(self) -> dict[str, ModelVariable]:
        """Variables by name."""
        return self.interface.variables

    def has_capability(self, capability: str) -> bool:
        """Whether the FMU has a capability flag of the standard set, such as `canGetAndSetFMUstate`."""
        return bool(getattr(self.description.coSimulation, capability))


def open_fmu(path: Path, folder: Path) -> FmuFile:
    """Check an FMU file and unpack it to `folder`.

    Raises CommandError where the file is missing, is not an FMU, or cannot run here.
    """
    interface = read_interface(path)
    try:
        unpack(path, folder)
    except UnsafeArchiveError as error:
        raise CommandError(f"the FMU '{path}' {error}.") from error
    except OSError as error:
        place, reason = folder.parent.parent, error.strerror or error
        raise CommandError(
            f"the FMU '{path}' cannot be unpacked to '{place}': {reason}; TMPDIR can name another folder."
        ) from error
    except Exception as error:  # whatever zip readers raise
        raise CommandError(f"'{path}' is not an FMU that can be read: {error}.") from error
    return FmuFile(
        path=path,
        folder=folder,
        interface=interface,
        library=_check_complete(path, _library(path, folder, interface.model_identifier)),
        sha256=hash_file(path),
    )


def _library(path: Path, folder: Path, identifier: str) -> Path:
    """The FMU's library for this machine."""
    if (library := find_library(folder, identifier)) is not None:
        return library
    binaries = folder / "binaries"
    present = sorted(p.name for p in binaries.iterdir()) if binaries.is_dir() else []
    raise CommandError(
        f"'{path}' has no binary for {fmpy.platform}, only for {', '.join(present) or 'no platform'}."
    )


def _check_complete(path: Path, library: Path) -> Path:
    """The library, unless it is cut off."""
    if missing := missing_bytes(library):
        raise CommandError(
            f"the library '{library.parent.name}/{library.name}' of the FMU '{path}' is cut off: its last "
            f"{format_count(missing, 'byte is', 'bytes are')} missing; get the FMU anew."
        )
    return library
