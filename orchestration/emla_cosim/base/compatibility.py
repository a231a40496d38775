"""How an FMU fits in the place of a component, as data: made where one is replaced, shown to people."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

FITS = "fits"
"""The verdict on a variable that has another name, and the same unit."""


@dataclass(frozen=True)
class VariableMatch:
    """A variable of the component and its counterpart; `verdict` says how they fit.

    `fatal` is true where the system cannot run like this.
    """

    kind: str
    ours: str
    theirs: str
    verdict: str
    fatal: bool = False

    def __str__(self) -> str:
        names = " as ".join(filter(None, (self.ours, self.theirs)))
        return f"the {self.kind} {names} {self.verdict}"


@dataclass(frozen=True)
class CompatibilityReport:
    """How an FMU fits in the place of a component: matches worth a line, and how many need none."""

    component: str
    fmu: Path
    matches: Sequence[VariableMatch]
    same: int

    @property
    def is_noteworthy(self) -> bool:
        """Whether anything is not just as it was, perhaps under another name."""
        return any(m.fatal or m.verdict != FITS for m in self.matches)

    @property
    def problems(self) -> list[VariableMatch]:
        """What keeps the system from running."""
        return [m for m in self.matches if m.fatal]
