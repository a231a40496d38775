"""The parts of an FMU that native and PythonFMU FMUs share."""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from .archive import content_guid, key_comment, write_archive
from .block import Block
from .description import FmuFeatures, model_description
from .documentation import docstring_page, html_page, icon, with_variables
from .files import accept
from .fmi3_description import fmi3_model_description
from .recipe import Documents, Producer
from .related import related_files
from .symbolic import SymbolicBlock
from .terminals import terminals_and_icons


@dataclass(frozen=True)
class Draft:
    """An FMU without its binaries: all content that determines its GUID.

    `files` are its finished files by path, without modelDescription.xml and binaries/.
    """

    block: Block
    guid: str
    description: bytes
    files: Mapping[str, bytes]
    has_sources: bool = True
    """Whether the FMU contains `sources/`; the files are always in `files`, for the compiler."""
    fmi: int = 2

    @property
    def key(self) -> str:
        """The key of this content, for a recipe that has none."""
        return hashlib.sha256(self.guid.encode()).hexdigest()

    def write(
        self, path: Path, binaries: Mapping[str, bytes], key: str, check: Callable[[Path], object] = accept
    ) -> None:
        """Write the FMU with these further files and its key. Raises OSError, and what `check` raises."""
        included = {p: f for p, f in self.files.items() if self.has_sources or not p.startswith("sources/")}
        files = {**included, **binaries, "modelDescription.xml": self.description}
        write_archive(path, files, key_comment(key), check=check)


def draft(
    block: Block,
    symbolic: SymbolicBlock,
    producer: Producer,
    documents: Documents,
    content: Mapping[str, bytes],
    offers: FmuFeatures,
    has_sources: bool = True,
    fmi: int = 2,
) -> Draft:
    """Describe and document a block; `content` are the files that its flavour adds.

    Without sources, the default page has no equations either.

    The GUID is the hash of all of this: the same block, documents and tool give the same GUID.
    """
    name = type(block).__name__
    picture = icon(block)
    page = documents.readme
    if page is None:
        page = docstring_page(block, is_brief=not has_sources)
    files = {
        **content,
        **related_files(documents.related),
        "documentation/index.html": html_page(with_variables(page, block), name).encode(),
        "model.png": picture,
        "terminalsAndIcons/icon.png": picture,
        "terminalsAndIcons/terminalsAndIcons.xml": terminals_and_icons(block, has_arrays=fmi == 3),
    }
    if documents.license is not None:
        files["documentation/licenses/license.txt"] = documents.license.encode()
    describe = fmi3_model_description if fmi == 3 else model_description
    anonymous = describe(block, symbolic, producer, "", offers)
    guid = content_guid({**files, "modelDescription.xml": anonymous})
    description = describe(block, symbolic, producer, guid, offers)
    return Draft(block, guid, description, files, has_sources, fmi)
