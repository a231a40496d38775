"""The interface through which a command reports its progress, and how well an FMU replaces a component."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

FITS = "fits"
"""The verdict on a variable that differs in its name only."""


@dataclass(frozen=True)
class VariableMatch:
    """A variable of the component and its counterpart in the FMU.

    Attributes:
        kind: The kind of variable, such as input or output.
        original: The name in the component.
        replacement: The name in the FMU.
        verdict: How they fit.
        fatal: Whether the system cannot run with this match.
    """

    kind: str
    original: str
    replacement: str
    verdict: str
    fatal: bool = False

    def __str__(self) -> str:
        names = " as ".join(filter(None, (self.original, self.replacement)))
        return f"the {self.kind} {names} {self.verdict}"


@dataclass(frozen=True)
class CompatibilityReport:
    """The result of comparing an FMU with the component that it replaces.

    Attributes:
        component: The name of the component.
        fmu: The FMU that replaces it.
        matches: The matches that are worth a line in a report.
        same: The number of other matches, which need no line.
    """

    component: str
    fmu: Path
    matches: Sequence[VariableMatch]
    same: int

    @property
    def is_noteworthy(self) -> bool:
        """Return whether anything differs by more than its name."""
        return any(m.fatal or m.verdict != FITS for m in self.matches)

    @property
    def problems(self) -> list[VariableMatch]:
        """Return the matches that keep the system from running."""
        return [m for m in self.matches if m.fatal]


class Progress:
    """Receives the progress of a command. This one ignores it; override the methods that you need.

    Examples:
        >>> import emla_cosim as ec
        >>> class Count(ec.Progress):
        ...     done = 0
        ...
        ...     def advance(self, count):
        ...         self.done += count
        >>> counter = Count()
        >>> found = ec.info("lift", progress=counter)
        >>> counter.done > 0
        True
    """

    def begin(self, task: str, total: int, unit: str = "") -> None:
        """Begin a task.

        Args:
            task: name of the task.
            total: number of units it consists of.
            unit: name of the units, if their rate is of interest.
        """

    def advance(self, count: int) -> None:
        """Count further units as done."""

    def finish(self) -> None:
        """End the task, also if fewer units than expected were done."""

    def note(self, sentence: str) -> None:
        """Report a note or warning."""

    def report_replacement(self, fit: CompatibilityReport) -> None:
        """Report how the FMU of a replacement fits."""
