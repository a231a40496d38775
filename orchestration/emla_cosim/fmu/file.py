"""FMU files: opened, checked and unpacked once, however many instances a system has."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

import fmpy
from fmpy.model_description import ModelDescription, ModelVariable, ValidationError

from ...errors import CommandError


@dataclass(frozen=True)
class FmuFile:
    """An unpacked FMI 2.0 co-simulation FMU."""

    path: Path
    folder: Path
    description: ModelDescription
    model_identifier: str
    library: Path
    variables: dict[str, ModelVariable]
    sha256: str

    def can(self, capability: str) -> bool:
        """Whether the FMU has a capability flag of the standard set, such as `canGetAndSetFMUstate`."""
        return bool(getattr(self.description.coSimulation, capability))


def open_fmu(path: Path, folder: Path) -> FmuFile:
    """Check an FMU file and unpack it to `folder`.

    Raises CommandError where the file is missing, is not an FMU, or cannot run here.
    """
    if not path.is_file():
        raise CommandError(f"there is no FMU file '{path}'.")
    try:
        description = fmpy.read_model_description(str(path))
        fmpy.extract(str(path), folder)
    except ValidationError as error:
        raise CommandError(
            f"'{path}' is not a valid FMU: {'; '.join(error.problems)}. `fmpy validate` shows more."
        ) from error
    except Exception as error:  # fmpy raises whatever zip and XML readers raise
        raise CommandError(f"'{path}' is not an FMU that can be read: {error}.") from error
    if description.fmiVersion != "2.0":
        raise CommandError(f"'{path}' is an FMI {description.fmiVersion} FMU; this master runs FMI 2.0.")
    if description.coSimulation is None:
        raise CommandError(f"'{path}' is for model exchange only; this master needs co-simulation.")
    identifier = str(description.coSimulation.modelIdentifier)
    return FmuFile(
        path=path,
        folder=folder,
        description=description,
        model_identifier=identifier,
        library=_library(path, folder / "binaries", f"{identifier}{fmpy.sharedLibraryExtension}"),
        variables={v.name: v for v in description.modelVariables},
        sha256=hashlib.sha256(path.read_bytes()).hexdigest(),
    )


def _library(path: Path, binaries: Path, name: str) -> Path:
    """The FMU's library for this machine: under the platform's tuple, or its FMI 2.0 name."""
    for platform in (fmpy.platform_tuple, fmpy.platform):
        if (binaries / platform / name).is_file():
            return binaries / platform / name
    present = sorted(p.name for p in binaries.iterdir()) if binaries.is_dir() else []
    raise CommandError(
        f"'{path}' has no binary for {fmpy.platform}, only for {', '.join(present) or 'no platform'}."
    )
