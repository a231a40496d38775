"""Related files of an FMU, with their roles as FMI-LS-REF lists them.

Source: FMI Layered Standard References 1.0.0-alpha.1, https://modelica.github.io/fmi-ls-ref/main/.
"""

from collections.abc import Sequence
from xml.etree.ElementTree import Element, SubElement

from .description import format_xml
from .recipe import LS_REF, RELATED, RELATED_LIST, RelatedFile

_NAMESPACE = "http://fmi-standard.org/fmi-ls-manifest"


def related_files(related: Sequence[RelatedFile]) -> dict[str, bytes]:
    """Return the files by their path in an FMU, with the manifest that lists them; none without files.

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
