"""What a repair changes."""

from dataclasses import dataclass
from typing import Any

from ..catalogue import CHECKS
from ..verdict import Clause


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
