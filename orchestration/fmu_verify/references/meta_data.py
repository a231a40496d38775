"""Read meta-data of simulation resources (SRMD), and other XML documents."""

import hashlib
from pathlib import Path
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from emla_cosim.base.untrusted_xml import parse_xml

from ..verdict import NotRunError
from .related_files import RelatedFile, is_of_type, is_relative, resolve_source

SRMD = "application/x-srmd-meta-data"
"""MIME type of simulation resource meta-data."""

_ROOT = "SimulationResourceMetaData"
_ENDINGS = (".xml", ".srmd", ".ssd", ".ssv", ".ssm", ".stmd", ".reqif")


def is_xml(file: RelatedFile) -> bool:
    """Return whether a file is XML, by its type or its name."""
    plain = file.type.partition(";")[0].strip()
    return plain == SRMD or plain.endswith(("/xml", "+xml")) or file.source.lower().endswith(_ENDINGS)


def find_fault(file: RelatedFile, unpacked: Path) -> str:
    """Return what is wrong with an XML document, as a sentence; empty if nothing is.

    Args:
        file: The file, which is in the FMU.
        unpacked: Folder with the content of the FMU.

    Raises:
        NotRunError: It is about a file that is not in the FMU, which the standard allows.
    """
    assert file.path is not None
    try:
        root = parse_xml(file.path.read_bytes())
    except (etree.XMLSyntaxError, OSError) as error:
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
