"""The outcome of a check."""

from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cache
from importlib.resources import files
from typing import Any

import msgspec

from emla_cosim.base.tolerances import Comparison
from emla_cosim.fmu.loaded_library import describe_left_exception


class Verdict(StrEnum):
    """Verdict of a check: passed, warning, failed or skipped."""

    PASSED = "passed"
    WARNING = "warning"
    """The standard allows it, but it causes problems for some users."""
    FAILED = "failed"
    SKIPPED = "skipped"
    """The check could not run or does not apply; the message gives the reason."""


@dataclass(frozen=True)
class Clause:
    """A quotation of FMI 2.0.4 with its section: `Clause("2.1.5", "The function ...")`.

    `document` names another document that is quoted, `in_3` is what FMI 3.0 says instead.
    """

    section: str
    sentence: str
    document: str = "FMI 2.0.4"
    in_3: "Clause | None" = None

    def __str__(self) -> str:
        return f"{self.document}, {self.section}"

    def of(self, version: int) -> "Clause":
        """Return the clause for FMUs of a version of FMI, 2 or 3."""
        return self.in_3 if version == 3 and self.in_3 is not None else self


@cache
def _read_quotations() -> dict[str, dict[str, tuple[str, str]]]:
    content = (files(__package__ or "") / "quotations.json").read_bytes()
    return msgspec.json.decode(content, type=dict[str, dict[str, tuple[str, str]]])


def quote(name: str) -> Clause:
    """Return a quotation by its name in quotations.json, or a rule of this program (`emla verify`).

    The file has the section and the words by document. A second document is that for FMI 3.0.
    """
    clauses = [
        Clause(*quotation, document=document) for document, quotation in _read_quotations()[name].items()
    ]
    return replace(clauses[0], in_3=clauses[1]) if len(clauses) > 1 else clauses[0]


def is_own_rule(clause: Clause) -> bool:
    """Return whether a clause is a rule of this program."""
    return clause.document == "emla verify"


RETURNS = quote("verdict.returns")
"""A function that crashes, ends the process or never returns violates this clause."""


LEAVES_EXCEPTION = quote("verdict.leaves_exception")
"""The rule for FMUs that use Python; hosts in Python end with such an exception, and others ignore it."""


def describe_exception(doing: str, error: BaseException) -> str:
    """Return the message for an FMU that left an exception of Python in a call."""
    return f"{doing} left an exception of Python: {describe_left_exception(error)}."


class NotRunError(Exception):
    """A check cannot run, although nothing is wrong with the FMU. The message says why."""


@dataclass(frozen=True)
class CheckOutcome:
    """The verdict and message of a check.

    Attributes:
        verdict: The verdict.
        sentence: The message.
        details: One line for each problem, if there are several.
        comparisons: Signals compared with their references.
        figures: Numbers by name, for programs.
        hint: What to do; replaces the hint of the check.
        clause: The clause that is violated; replaces the clause of the check.
        blocked: Whether the check applies, but could not run. Such an FMU does not pass.
        blocks: Whether checks that need this one cannot run if it fails.
        gaps: What the check could not judge, as sentences for the section *Not examined*.
        lines: Details before `terms.in_terms_of` writes them: messages, each with its clause if it has one.
    """

    verdict: Verdict
    sentence: str
    details: tuple[str, ...] = ()
    comparisons: tuple[Comparison, ...] = ()
    figures: dict[str, Any] = field(default_factory=dict)
    hint: str = ""
    clause: Clause | None = None
    blocked: bool = False
    blocks: bool = True
    gaps: tuple[str, ...] = ()
    lines: tuple[tuple[str, Clause | None], ...] = ()


def passed(sentence: str, **more: Any) -> CheckOutcome:
    """Return an outcome: the FMU passes the check."""
    return CheckOutcome(Verdict.PASSED, sentence, **more)


def failed(sentence: str, **more: Any) -> CheckOutcome:
    """Return an outcome: the FMU violates the standard or differs from a reference."""
    return CheckOutcome(Verdict.FAILED, sentence, **more)


def warned(sentence: str, **more: Any) -> CheckOutcome:
    """Return an outcome: allowed, but probably not intended."""
    return CheckOutcome(Verdict.WARNING, sentence, **more)


def noted(sentence: str, *, gaps: tuple[str, ...] = (), **more: Any) -> CheckOutcome:
    """Return an outcome: no sentence of the standard judges what was found, so that it passes with a note.

    `gaps` are further notes.
    """
    return CheckOutcome(Verdict.PASSED, sentence, gaps=(sentence, *gaps), **more)


def skipped(sentence: str, **more: Any) -> CheckOutcome:
    """Return an outcome: the check does not apply. `sentence` is the reason."""
    return CheckOutcome(Verdict.SKIPPED, sentence, **more)


def unjudged(sentence: str) -> CheckOutcome:
    """Return an outcome: the check does not apply, which the report lists under *Not examined*."""
    return skipped(sentence, gaps=(sentence,))


def blocked(sentence: str, **more: Any) -> CheckOutcome:
    """Return an outcome: the check applies, but cannot run. `sentence` is the reason."""
    return CheckOutcome(Verdict.SKIPPED, sentence, blocked=True, **more)
