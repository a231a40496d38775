"""What a command tells while it goes on."""

from .compatibility import CompatibilityReport


class Progress:
    """Hears how a command goes on; this one keeps quiet."""

    def begin(self, task: str, total: int, unit: str = "") -> None:
        """A task of `total` units begins; `unit` is what they are called where their rate matters."""

    def advance(self, count: int) -> None:
        """So many units more are done."""

    def finish(self) -> None:
        """The task is done, if with fewer units than expected."""

    def note(self, sentence: str) -> None:
        """Something worth knowing while it goes on."""

    def report_replacement(self, fit: CompatibilityReport) -> None:
        """A component is replaced; this is how the other FMU fits."""
