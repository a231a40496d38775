"""What both flavours of an FMU have in common."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from .archive import content_guid, write_archive
from .block import Block
from .description import Offers, Producer, model_description
from .documentation import html_page, icon, variable_table
from .symbolic import SymbolicBlock
from .terminals import terminals_and_icons


class BuildError(Exception):
    """An FMU could not be built; the message is one sentence for the person who asked for it."""


@dataclass(frozen=True)
class Documents:
    """The texts that go into an FMU: its folder's README (Markdown) and the licence."""

    readme: str
    license: str


@dataclass(frozen=True)
class Draft:
    """An FMU before its binaries are made: everything that decides its GUID.

    `files` are its finished files by path, without modelDescription.xml and binaries/.
    """

    block: Block
    guid: str
    description: bytes
    files: Mapping[str, bytes]

    def write(self, path: Path, binaries: Mapping[str, bytes]) -> None:
        """Write the FMU with these further files. Raises OSError."""
        write_archive(path, {**self.files, **binaries, "modelDescription.xml": self.description})


def draft(
    block: Block,
    symbolic: SymbolicBlock,
    producer: Producer,
    documents: Documents,
    content: Mapping[str, bytes],
    offers: Offers,
) -> Draft:
    """Describe and document a block whose flavour adds `content`.

    The GUID is the hash of all of this: the same block, documents and tool give the same GUID.
    """
    name = type(block).__name__
    picture = icon(block)
    files = {
        **content,
        "documentation/index.html": html_page(documents.readme + variable_table(block), name).encode(),
        "documentation/licenses/license.txt": documents.license.encode(),
        "model.png": picture,
        "terminalsAndIcons/icon.png": picture,
        "terminalsAndIcons/terminalsAndIcons.xml": terminals_and_icons(block),
    }
    anonymous = model_description(block, symbolic, producer, "", offers)
    guid = content_guid({**files, "modelDescription.xml": anonymous})
    return Draft(block, guid, model_description(block, symbolic, producer, guid, offers), files)
