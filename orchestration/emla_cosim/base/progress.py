"""The interface through which a command reports its progress."""

from .compatibility import CompatibilityReport


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
