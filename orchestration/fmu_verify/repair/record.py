"""What a repair changes, and the record of it in the model description."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from lxml import etree  # pyright: ignore[reportAttributeAccessIssue]

from ..catalogue import CHECKS
from ..check import Clause

TOOL = "EMLA-Cosim"
"""The tool that FMI 2.0 names in VendorAnnotations."""

TYPE = "org.emla-cosim.repair"
"""The type of the annotation in FMI 3.0."""

_BEFORE_ANNOTATIONS = ("ModelVariables", "ModelStructure")


@dataclass(frozen=True)
class Change:
    """One change of a text in an FMU.

    Attributes:
        check: Name of the check whose clause the text violated.
        where: What was changed, such as an element and an attribute.
        before: The text before; empty for something that was missing.
        after: The text after; empty for something that was removed.
    """

    check: str
    where: str
    before: str
    after: str

    def find_clause(self, version: int) -> Clause:
        """Return the clause of the check for a version of FMI, 2 or 3."""
        return next(c for c in CHECKS if c.name == self.check).of(version).clause


def describe_element(element: Any) -> str:
    """Return the start tag of an element."""
    text = "".join(f' {name}="{value}"' for name, value in element.attrib.items())
    return f"<{element.tag}{text}>"


def write_record(root: Any, version: int, changes: Sequence[Change], tool_version: str) -> None:
    """Add a list of changes to the annotations of a model description of FMI 2.0 or 3.0."""
    holder = _find_or_make_holder(root, version)
    repairs = holder.find("Repairs")
    if repairs is None:
        repairs = etree.SubElement(holder, "Repairs")
    repair = etree.SubElement(repairs, "Repair", version=tool_version)
    for change in changes:
        # without characters that XML does not allow
        values = {
            name: "".join(c if c.isprintable() else " " for c in text)
            for name, text in asdict(change).items()
        }
        etree.SubElement(repair, "Change", values)


def _find_or_make_holder(root: Any, version: int) -> Any:
    """Return the element for our own annotations, which is made if there is none."""
    if version == 3:
        group = root.find("Annotations")
        if group is None:
            group = etree.SubElement(root, "Annotations")
        holder = next((e for e in group.iterfind("Annotation") if e.get("type") == TYPE), None)
        return etree.SubElement(group, "Annotation", type=TYPE) if holder is None else holder
    group = root.find("VendorAnnotations")
    if group is None:
        group = etree.Element("VendorAnnotations")
        variables = next(e for e in root if e.tag in _BEFORE_ANNOTATIONS)
        root.insert(root.index(variables), group)
    holder = next((e for e in group.iterfind("Tool") if e.get("name") == TOOL), None)
    return etree.SubElement(group, "Tool", name=TOOL) if holder is None else holder
