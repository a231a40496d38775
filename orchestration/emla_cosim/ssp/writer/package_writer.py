"""Writing of a system of FMUs to an SSP file."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from zipfile import BadZipFile, ZipFile

from fmublock.archive import write_archive

from ...base.errors import CommandError
from ...base.output_files import OutputFile
from ...fmu.interface import KINDS, MODEL_EXCHANGE
from ...system.model import System
from ...system.resolution import resolve_system
from ...system.structure import read_sized_interfaces
from ..documents.identifiers import format_id, make_identifier
from ..documents.ssd_data import DEFAULT_SSD, Structure
from ..documents.ssd_writer import format_structure
from .elements import StructurePart, build_root_system
from .parameter_files import file_name, parameter_files
from .version_2 import select_version


@dataclass(frozen=True)
class SystemTimes:
    """Start time, stop time and step size of a system in s."""

    start_time: float
    stop_time: float
    step_size: float


_MARK = b"emla-cosim package"
"""The zip comment of our packages. It is not part of the SSP, and repacking removes it."""


def check_package(path: Path, overwrite: bool = False) -> OutputFile:
    """Return the file of a package, which may be written.

    Args:
        path: The file.
        overwrite: Whether to replace a file that emla did not write.

    Raises:
        CommandError: If it must not be written.
    """
    if path.suffix.lower() != ".ssp":
        raise CommandError(f"a scenario is exported to a file that ends in .ssp or .fmu, not to '{path}'.")
    return OutputFile(path, "the package", _is_ours, overwrite, creates_folder=True)


def _is_ours(path: Path) -> bool:
    try:
        with ZipFile(path) as archive:
            return archive.comment == _MARK
    except BadZipFile:
        return False


def write_ssp(
    path: Path,
    name: str,
    description: str,
    system: System,
    fmus: Mapping[str, Path],
    experiment: SystemTimes,
    overwrite: bool = False,
) -> None:
    """Write a system with its FMUs to a package; equal content gives equal bytes.

    It is of SSP 1.0 unless the system needs SSP 2.0.

    Args:
        path: The file.
        name: The name of the system. Characters that not every tool accepts are replaced; `read_ssp` restores
            them.
        description: Its description.
        system: The system.
        fmus: The FMUs by component.
        experiment: The times of the default experiment.
        overwrite: Whether to replace a file that emla did not write.

    Raises:
        CommandError: If the system does not fit an SSP, or the file must not be replaced.
        RunError: If the file cannot be written.
    """
    package = check_package(path, overwrite)
    fmus = {c.name: fmus[c.name] for c in system.components}
    interfaces = read_sized_interfaces(system, fmus)
    plain = resolve_system(system, interfaces)
    uris: dict[Path, str] = {}
    for file in dict.fromkeys(fmus.values()):
        uris[file] = file_name(file.stem, ".fmu", uris.values())  # files of the same name are numbered
    version = select_version(plain, interfaces)
    parameters = parameter_files(system, interfaces, version)
    parts = {
        c.name: StructurePart(interfaces[c.name], uris[fmus[c.name]], parameters.bindings[c.name])
        for c in system.components
    }
    identifier = make_identifier(name)
    # OMSimulator integrates Model Exchange in systems with a solver only
    kinds = {KINDS.get(c.kind) or next(iter(interfaces[c.name].kinds)) for c in system.components}
    structure = Structure(
        identifier,
        build_root_system(identifier, plain, parts, version),
        experiment.start_time,
        experiment.stop_time,
        experiment.step_size,
        description,
        tuple(c.name for c in system.components if c.samples),
        system.bonds,
        format_id(identifier, name),
        kinds == {MODEL_EXCHANGE} and not any(c.samples for c in system.components),
        version,
    )
    contents = {uri: file.read_bytes() for file, uri in uris.items()}
    contents |= parameters.contents | {DEFAULT_SSD: format_structure(structure)}
    with package.report_errors():
        write_archive(path, contents, _MARK, check=package.check_again)
