"""Find the related files of an FMU, with their roles as FMI-LS-REF lists them, and check their XML."""

import hashlib
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from emla_cosim.base.errors import CommandError
from emla_cosim.base.untrusted_xml import parse_xml
from fmublock.recipe import RELATED_LIST

from ..layered_manifest import read_manifest
from ..messages import format_sentence
from ..verdict import NotRunError

SRMD = "application/x-srmd-meta-data"
"""MIME type of simulation resource meta-data."""

_ROOT = "SimulationResourceMetaData"
_ENDINGS = (".xml", ".srmd", ".ssd", ".ssv", ".ssm", ".stmd", ".reqif")


@dataclass(frozen=True)
class RelatedFile:
    """A related file.

    Attributes:
        role: Its main role, such as `experiment`.
        purpose: The sub-role: `validation`, or a platform; empty without one.
        type: MIME type.
        source: Its URI in the manifest.
        path: The file; None if it is not in the FMU, which the standard allows.
    """

    role: str
    purpose: str
    type: str
    source: str
    path: Path | None


def list_related(unpacked: Path) -> list[RelatedFile]:
    """Return the related files of an FMU that is unpacked to a folder, in the order of the manifest.

    Raises:
        NotRunError: The manifest is not valid XML, which the check of manifests reports.
    """
    manifest = unpacked / RELATED_LIST
    if not manifest.is_file():
        return []
    try:
        root = read_manifest(manifest).root
    except CommandError as error:
        raise NotRunError(format_sentence(error)) from error
    related = []
    for element in root.iterfind("Related"):
        role, _, purpose = element.get("role", "").partition("/")
        source, type_ = element.get("source", ""), element.get("type", "application/octet-stream")
        path = resolve_source(manifest, source, unpacked)
        related.append(RelatedFile(role, purpose, type_, source, path))
    return related


def resolve_source(file: Path, source: str, unpacked: Path) -> Path | None:
    """Return the file of a relative URI in another file; None if the unpacked FMU has no such file."""
    if not is_relative(source):
        return None
    path = (file.parent / unquote(urlsplit(source).path)).resolve()
    return path if path.is_relative_to(unpacked.resolve()) and path.is_file() else None


def is_relative(source: str) -> bool:
    """Return whether a URI is relative, so that it is of a file in the FMU."""
    try:
        parts = urlsplit(source)
    except ValueError:
        return False
    return bool(parts.path) and not (parts.scheme or parts.netloc or parts.path.startswith("/"))


def is_of_type(file: RelatedFile, types: Collection[str], ending: str) -> bool:
    """Return whether a file has one of these MIME types, or an ending of its name such as `.exp`."""
    return file.type in types or file.source.lower().endswith(ending)


def is_xml(file: RelatedFile) -> bool:
    """Return whether a file is XML, by its type or its name."""
    plain = file.type.partition(";")[0].strip()
    return plain == SRMD or plain.endswith(("/xml", "+xml")) or file.source.lower().endswith(_ENDINGS)


def find_fault(file: RelatedFile, unpacked: Path) -> str:
    """Return what is wrong with an XML document in the FMU, as a message; empty if nothing is.

    Raises:
        NotRunError: It is about a file that is not in the FMU, which the standard allows.
    """
    assert file.path is not None
    try:
        root = parse_xml(file.path.read_bytes())
    except (SyntaxError, OSError) as error:
        return f"It is not valid XML: {error}."
    return _find_srmd_fault(root, file.path, unpacked) if is_of_type(file, (SRMD,), ".srmd") else ""


def _find_srmd_fault(root: Any, path: Path, unpacked: Path) -> str:
    tag = etree.QName(root).localname
    if tag != _ROOT:
        return f"It has the root element {tag}, not {_ROOT}."
    for name in ("version", "name"):
        if not root.get(name):
            return f"Its root element has no {name}."
    for element in root.iterfind(".//{*}ClassificationEntry"):
        if element.get("keyword") is None:
            return f"Its ClassificationEntry in line {element.sourceline} has no keyword."
    source, checksum = root.get("data"), root.get("checksum")
    if source is None or not is_relative(source):
        return ""
    data = resolve_source(path, source, unpacked)
    if data is None:
        raise NotRunError(f"It is about '{source}', which is not in the FMU.")
    if checksum and hashlib.sha3_256(data.read_bytes()).hexdigest() != checksum.lower():
        return f"The SHA3-256 checksum of '{source}' is not the one that it has."
    return ""
