"""Header of an FMU: what its file and model description say about the whole."""

import math
import zipfile
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import Any

from ..base.errors import CommandError
from ..base.files import hash_file
from ..fmu.interface import Interface
from .info_parts import FmuInfo

_KINDS = {
    "CoSimulation": "coSimulation",
    "ModelExchange": "modelExchange",
    "ScheduledExecution": "scheduledExecution",
}
"""The standard's name of an interface type, and fmpy's."""


def read_fmu_info(path: Path, shown: str, interface: Interface) -> FmuInfo:
    """Return the header of an FMU; `shown` names its file. Raise CommandError if it cannot be read."""
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
        terminals=tuple(_terminals(path)),
    )


def _capabilities(path: Path) -> dict[str, tuple[str, ...]]:
    """Return the flags that are set in the element of each kind."""
    root = _read_xml(path, "modelDescription.xml")
    found = {kind: root.find(kind) for kind in _KINDS} if root is not None else {}
    return {
        kind: tuple(name for name, text in element.attrib.items() if text.strip() in ("true", "1"))
        for kind, element in found.items()
        if element is not None
    }


def _terminals(path: Path) -> Iterator[str]:
    """Yield the names of all terminals of FMI 3.0."""
    root = _read_xml(path, "terminalsAndIcons/terminalsAndIcons.xml")
    for terminal in root.iterfind(".//Terminal") if root is not None else ():
        parts = [terminal, *terminal.iterancestors("Terminal")]
        yield ".".join(str(one.get("name", "")) for one in reversed(parts))


def _read_xml(path: Path, name: str) -> Any:
    """Return the root element of a file in the archive; None if it is missing or no XML."""
    from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]  # slow to import

    with zipfile.ZipFile(path) as archive, suppress(KeyError, etree.XMLSyntaxError):
        return etree.fromstring(archive.read(name), etree.XMLParser(resolve_entities=False, no_network=True))
    return None


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
