"""Read the build description of the sources of an FMU."""

from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from emla_cosim.base.untrusted_xml import parse_xml

from .subject import Subject

BUILD_DESCRIPTION = "sources/buildDescription.xml"


def read_build_description(subject: Subject) -> Any:
    """Return the root element of the build description; None if there is none.

    Raises:
        lxml.etree.XMLSyntaxError: It is not XML.
    """
    path = subject.folder / BUILD_DESCRIPTION
    if not path.is_file():
        return None
    return parse_xml(path.read_bytes())


def list_source_files(subject: Subject) -> list[str]:
    """Return the names of source files to compile; none if the build description cannot be read."""
    if subject.version == 2:
        return [e.get("name") for e in subject.tree.iterfind(".//SourceFiles/File")]
    try:
        root = read_build_description(subject)
    except etree.XMLSyntaxError:
        return []
    return [] if root is None else [e.get("name") for e in root.iterfind(".//SourceFile")]
