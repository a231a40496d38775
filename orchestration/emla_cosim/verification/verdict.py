"""What one check says of an FMU."""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from ..recorders.tubes.signal_comparison import Comparison


class Verdict(StrEnum):
    """Verdict of a check: passed, warning, failed or skipped."""

    PASSED = "passed"
    WARNING = "warning"
    """The standard allows it, but somebody will stumble over it."""
    FAILED = "failed"
    SKIPPED = "skipped"
    """It could not be done, or does not apply; the sentence says why."""


@dataclass(frozen=True)
class Clause:
    """A sentence of FMI 2.0.4, and the section it stands in: `Clause("2.1.5", "The function ...")`.

    For what rests on something else, such as a reference, `document` says what that is.
    """

    section: str
    sentence: str
    document: str = "FMI 2.0.4"

    def __str__(self) -> str:
        return f"{self.document}, {self.section}"


@dataclass(frozen=True)
class CheckOutcome:
    """What a check found: a verdict, and one sentence that says it of this FMU.

    `details` are lines for the places where it is so, if there are several; `comparisons` are signals
    beside their references; `figures` are numbers by name, for programs. `hint` says what to do, and
    takes the place of the check's own.
    """

    verdict: Verdict
    sentence: str
    details: tuple[str, ...] = ()
    comparisons: tuple[Comparison, ...] = ()
    figures: dict[str, Any] = field(default_factory=dict)
    hint: str = ""


def passed(sentence: str, **more: Any) -> CheckOutcome:
    """All is as it should be."""
    return CheckOutcome(Verdict.PASSED, sentence, **more)


def failed(sentence: str, **more: Any) -> CheckOutcome:
    """The standard, or a reference, is not kept."""
    return CheckOutcome(Verdict.FAILED, sentence, **more)


def warned(sentence: str, **more: Any) -> CheckOutcome:
    """Allowed, but hardly meant so."""
    return CheckOutcome(Verdict.WARNING, sentence, **more)


def skipped(sentence: str, **more: Any) -> CheckOutcome:
    """There was nothing to check, or no way to; `sentence` is the reason."""
    return CheckOutcome(Verdict.SKIPPED, sentence, **more)
