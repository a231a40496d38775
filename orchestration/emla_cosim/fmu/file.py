"""FMU files: opened, checked and unpacked once for all instances in a system."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from fmpy.model_description import ModelDescription, ModelVariable

from ..base.errors import CommandError
from ..base.files import hash_file
from ..base.wording import format_count
from .interface import CO_SIMULATION, Interface, explain_unsupported_kind, read_interface
from .shared_library import explain_missing_library, find_library, missing_bytes
from .unpack import UnsafeArchiveError, unpack

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
    if missing := missing_bytes(library):
        raise CommandError(
            f"the library '{library.parent.name}/{library.name}' of the FMU '{path}' is truncated: its last "
            f"{format_count(missing, 'byte is', 'bytes are')} missing. Download or build the FMU again."
        )
    return library
