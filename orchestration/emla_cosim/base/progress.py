"""The interface through which a command reports its progress."""

from .compatibility import CompatibilityReport


class Progress:
    """Receives the progress of a command; this class ignores it."""

    def begin(self, task: str, total: int, unit: str = "") -> None:
        """Begin a task.

        Args:
            task: What the command does.
            total: The number of units.
            unit: The name of a unit, if their rate is of interest.
        """

    def advance(self, count: int) -> None:
        """Report `count` more units as done."""

    def finish(self) -> None:
        """End the task, possibly with fewer units than expected."""

    def note(self, sentence: str) -> None:
        """Report a message during the task."""

    def report_replacement(self, fit: CompatibilityReport) -> None:
        """Report how well an FMU replaces a component."""
