"""Read the manifests of layered standards: `extra/NAME/fmi-ls-manifest.xml`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from emla_cosim.base.errors import CommandError
from emla_cosim.base.untrusted_xml import parse_xml

EXTRA = "extra"
"""Folder of an FMU with the folders of layered standards and of tools."""

MANIFEST = "fmi-ls-manifest.xml"
"""Name of the manifest in the folder of a layered standard."""

_NAMESPACE = "{http://fmi-standard.org/fmi-ls-manifest}"


@dataclass(frozen=True)
class LayeredManifest:
    """The manifest of a layered standard.

    Attributes:
        path: The file.
        root: Its root element.
        name: Name of the standard in reverse domain name notation; None if the manifest has none.
        version: Version of the standard, or None.
        description: Description of the standard for users, or None.
    """

    path: Path
    root: Any
    name: str | None
    version: str | None
    description: str | None

    @property
    def label(self) -> str:
        """Path of the manifest in the FMU."""
        return label_manifest(self.path)


def list_manifests(unpacked: Path) -> list[Path]:
    """Return the manifests of an FMU that is unpacked to a folder, sorted by path."""
    return sorted(path for path in (unpacked / EXTRA).glob(f"*/{MANIFEST}") if path.is_file())


def label_manifest(path: Path) -> str:
    """Return the path of a manifest in the FMU, for messages."""
    return f"{EXTRA}/{path.parent.name}/{path.name}"


def read_manifest(path: Path) -> LayeredManifest:
    """Read a manifest. Its content is not checked.

    Raises:
        CommandError: The file cannot be read, or is not valid XML.
    """
    try:
        root = parse_xml(path.read_bytes())
    except (etree.XMLSyntaxError, OSError) as error:
        raise CommandError(f"'{label_manifest(path)}' is not valid XML: {error}.") from error
    name, version, description = (
        root.get(f"{_NAMESPACE}fmi-ls-{attribute}") for attribute in ("name", "version", "description")
    )
    return LayeredManifest(path, root, name, version, description)
