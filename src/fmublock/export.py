"""The parts of an FMU that native and PythonFMU FMUs share."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from .archive import content_guid, key_comment, write_archive
from .block import Block
from .description import FmuFeatures, format_xml, model_description
from .documentation import docstring_page, html_page, icon, with_variables
from .files import accept
from .fmi3_description import fmi3_model_description
from .recipe import LS_REF, RELATED, RELATED_LIST, Documents, Producer, RelatedFile
from .symbolic import SymbolicBlock


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
        # the compiler needs the sources even if the FMU must not contain them
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
        **_list_related_files(documents.related),
        "documentation/index.html": html_page(with_variables(page, block), name).encode(),
        "model.png": picture,
        "terminalsAndIcons/icon.png": picture,
        "terminalsAndIcons/terminalsAndIcons.xml": _describe_terminals(block, has_arrays=fmi == 3),
    }
    if documents.license is not None:
        files["documentation/licenses/license.txt"] = documents.license.encode()
    describe = fmi3_model_description if fmi == 3 else model_description
    # described twice: the GUID is the hash of everything else, also of the description without it
    anonymous = describe(block, symbolic, producer, "", offers)
    guid = content_guid({**files, "modelDescription.xml": anonymous})
    description = describe(block, symbolic, producer, guid, offers)
    return Draft(block, guid, description, files, has_sources, fmi)


_NAMESPACE = "http://fmi-standard.org/fmi-ls-manifest"


def _list_related_files(related: Sequence[RelatedFile]) -> dict[str, bytes]:
    """Return the files by their path in an FMU, with the manifest that lists them; none without files.

    Source of the manifest: FMI Layered Standard References 1.0.0-alpha.1,
    https://modelica.github.io/fmi-ls-ref/main/.

    Raises:
        BuildError: A text has a character that XML cannot hold.
    """
    if not related:
        return {}
    root = Element(
        "fmiReferences",
        {
            "xmlns:fmi-ls": _NAMESPACE,
            "fmi-ls:fmi-ls-name": LS_REF,
            "fmi-ls:fmi-ls-version": "1.0.0-alpha.1",
            "fmi-ls:fmi-ls-description": "Layered Standard providing information on related files included "
            "in an FMU.",
        },
    )
    for file in related:
        SubElement(
            root, "Related", type=file.type, source=file.name, role=file.role, description=file.description
        )
    files = {f"{RELATED}/{file.name}": file.text.encode() for file in related}
    return {**files, RELATED_LIST: format_xml(root)}


def _describe_terminals(block: Block, has_arrays: bool = False) -> bytes:
    """Return terminalsAndIcons.xml. Terminals of the same name connect members of the same name.

    FMI 2.0.4 adopts this file from FMI 3.0 (section 2.4.9 there).

    Args:
        block: The block.
        has_arrays: Whether the FMU's variables are arrays; otherwise they are their elements.
    """
    root = Element("fmiTerminalsAndIcons", fmiVersion="3.0")
    graphics = SubElement(root, "GraphicalRepresentation")
    square = {"x1": "-100", "y1": "-100", "x2": "100", "y2": "100"}
    SubElement(graphics, "CoordinateSystem", square, suggestedScalingFactorTo_mm="0.1")
    SubElement(graphics, "Icon", square)
    groups: dict[str, list[tuple[str, str]]] = {}
    for scalar in block.layout().scalars:
        if scalar.variable.terminal is None or (has_arrays and any(scalar.index)):
            continue
        name = str(scalar.variable.name) if has_arrays else scalar.name
        terminal, _, member = scalar.variable.terminal.partition(".")
        groups.setdefault(terminal, []).append((member or name, name))
    if groups:
        terminals = SubElement(root, "Terminals")
        for group, members in groups.items():
            terminal = SubElement(terminals, "Terminal", name=group, matchingRule="bus")
            for member, variable in members:
                SubElement(
                    terminal,
                    "TerminalMemberVariable",
                    variableName=variable,
                    memberName=member,
                    variableKind="signal",
                )
    return format_xml(root)
