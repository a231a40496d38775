"""Header of an FMU: what its file and model description say about the whole."""

import math
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path, PurePosixPath
from typing import Any

from ..base.errors import CommandError
from ..base.files import hash_file
from ..base.untrusted_xml import parse_xml
from ..fmu.interface import Interface
from .info_parts import FmuInfo

_TERMINALS, _LARGEST = "terminalsAndIcons/terminalsAndIcons.xml", 2**24
"""The file with the terminals, and the largest size in bytes at which it is read."""

_KINDS = {
    "CoSimulation": "coSimulation",
    "ModelExchange": "modelExchange",
    "ScheduledExecution": "scheduledExecution",
}
"""The standard's name of an interface type, and fmpy's."""


def read_fmu_info(path: Path, shown: str, interface: Interface, remark: Callable[[str], None]) -> FmuInfo:
    """Return the header of an FMU.

    Args:
        path: The FMU.
        shown: What to call its file.
        interface: Its model description.
        remark: Takes notes on what cannot be read.

    Raises:
        CommandError: The FMU cannot be read.
    """
    said = interface.description
    try:
        content, size, platforms = hash_file(path), path.stat().st_size, _platforms(path)
    except OSError as error:
        raise CommandError(f"the FMU '{path}' cannot be read: {error.strerror}.") from error
    return FmuInfo(
        path=shown,
        model=_text(said.modelName),
        description=_text(said.description),
        fmi_version=_text(said.fmiVersion),
        kinds=tuple(kind for kind, name in _KINDS.items() if getattr(said, name, None) is not None),
        platforms=platforms,
        start_time=_seconds(said, "startTime"),
        stop_time=_seconds(said, "stopTime"),
        step_size=_seconds(said, "stepSize"),
        tolerance=_seconds(said, "tolerance"),
        tool=_text(said.generationTool),
        version=_text(said.version),
        author=_text(said.author),
        license=_text(said.license),
        guid=_text(said.guid),
        sha256=content,
        size=size,
        capabilities=_capabilities(path),
        terminals=_read_terminals(path, remark),
    )


def _capabilities(path: Path) -> dict[str, tuple[str, ...]]:
    """Return the flags that are set in the element of each kind."""
    with zipfile.ZipFile(path) as archive:
        root = parse_xml(archive.read("modelDescription.xml"))
    found = {kind: root.find(kind) for kind in _KINDS}
    return {
        kind: tuple(name for name, text in element.attrib.items() if text.strip() in ("true", "1"))
        for kind, element in found.items()
        if element is not None
    }


def _read_terminals(path: Path, remark: Callable[[str], None]) -> tuple[str, ...]:
    """Return the names of all terminals of FMI 3.0; none if the file is missing, or cannot be read."""
    try:
        with zipfile.ZipFile(path) as archive:
            if _TERMINALS not in archive.namelist():
                return ()
            if archive.getinfo(_TERMINALS).file_size > _LARGEST:
                remark(f"{_TERMINALS} of '{path}' is larger than {_LARGEST // 2**20} MiB and was not read")
                return ()
            root = parse_xml(archive.read(_TERMINALS))
    except (OSError, RuntimeError, EOFError, zlib.error, zipfile.BadZipFile, SyntaxError) as error:
        remark(f"{_TERMINALS} of '{path}' cannot be read: {error}")
        return ()
    paths = ([*reversed([*t.iterancestors("Terminal")]), t] for t in root.iterfind(".//Terminal"))
    return tuple(".".join(str(part.get("name", "")) for part in path) for path in paths)


def _platforms(path: Path) -> tuple[str, ...]:
    """Return the non-empty folders in binaries/."""
    with zipfile.ZipFile(path) as archive:
        parts = [PurePosixPath(e.filename).parts for e in archive.infolist() if not e.is_dir()]
    return tuple(sorted({p[1] for p in parts if len(p) > 2 and p[0] == "binaries"}))


def _text(text: Any) -> str:
    """Return a text, or an empty one."""
    return "" if text is None else str(text)


def _seconds(description: Any, name: str) -> float | None:
    """Return a number of the default experiment, or None if it is missing or not finite."""
    text = getattr(description.defaultExperiment, name, None)
    try:
        number = math.nan if text is None else float(text)
    except ValueError:  # the model description is invalid
        return None
    return number if math.isfinite(number) else None
