"""Find reference results inside an FMU, which FMI-LS-REF lists.

Source: FMI Layered Standard References 1.0.0-alpha.1, https://modelica.github.io/fmi-ls-ref/main/.
"""

from pathlib import Path

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from fmublock.recipe import RELATED, RELATED_LIST

from ...base.errors import CommandError
from ...base.untrusted_xml import parse_xml


def find_related_result(unpacked: Path) -> Path | None:
    """Return the first CSV file with the role `result`, or None.

    Files that are not there, or are outside of the FMU, do not count: the standard allows both.

    Args:
        unpacked: Folder with the content of the FMU.

    Raises:
        CommandError: The list of related files is not valid XML.
    """
    listed = unpacked / RELATED_LIST
    if not listed.is_file():
        return None
    try:
        root = parse_xml(listed.read_bytes())
    except (etree.XMLSyntaxError, OSError) as error:
        raise CommandError(f"'{RELATED_LIST}' is not valid XML: {error}.") from error
    inside = unpacked.resolve()
    for one in root.iterfind("Related"):
        role, kind, source = (one.get(name, "") for name in ("role", "type", "source"))
        if role.partition("/")[0] != "result" or kind != "text/csv":
            continue
        place = (unpacked / RELATED / source).resolve()
        if place.is_relative_to(inside) and place.is_file():
            return place
    return None
