"""Find the related files of an FMU, with their roles as FMI-LS-REF lists them."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from emla_cosim.base.errors import CommandError
from fmublock.recipe import RELATED_LIST

from ..layered_manifest import read_manifest
from ..messages import sentence
from ..verdict import NotRunError


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
        return list(_read(read_manifest(manifest).root, manifest, unpacked))
    except CommandError as error:
        raise NotRunError(sentence(error)) from error


def _read(root: Any, manifest: Path, unpacked: Path) -> Iterator[RelatedFile]:
    for element in root.iterfind("Related"):
        role, _, purpose = element.get("role", "").partition("/")
        source, type_ = element.get("source", ""), element.get("type", "application/octet-stream")
        yield RelatedFile(role, purpose, type_, source, resolve_source(manifest, source, unpacked))


def resolve_source(file: Path, source: str, unpacked: Path) -> Path | None:
    """Return the file of a relative URI in another file; None if the FMU has no such file.

    Args:
        file: The file with the URI.
        source: The URI.
        unpacked: Folder with the content of the FMU.
    """
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
