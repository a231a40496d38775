"""A check: its name, clause and function, its outcome, and the terms of the FMU's version."""

import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cache
from importlib import import_module
from importlib.resources import files
from typing import Any

import msgspec

from emla_cosim.base.tolerances import Comparison
from emla_cosim.fmu.python_exceptions import describe_left_exception


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
        lines: Details before `translate_outcome` writes them: messages, each with its clause if it has one.
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


# functions of FMI 2.0 that have another name in FMI 3.0; others differ in the first letters only
_FUNCTIONS = {
    "CallbackFunctions": "LogMessageCallback",
    "DeSerializeFMUstate": "DeserializeFMUState",
    "FreeFMUstate": "FreeFMUState",
    "GetFMUstate": "GetFMUState",
    "GetReal": "GetFloat64",
    "GetRealOutputDerivatives": "GetOutputDerivatives",
    "NewDiscreteStates": "UpdateDiscreteStates",
    "SerializeFMUstate": "SerializeFMUState",
    "SerializedFMUstateSize": "SerializedFMUStateSize",
    "SetFMUstate": "SetFMUState",
    "SetReal": "SetFloat64",
    "SetXXX": "Set{VariableType}",
}

FLAGS = {
    "canGetAndSetFMUstate": "canGetAndSetFMUState",
    "canSerializeFMUstate": "canSerializeFMUState",
    "providesDirectionalDerivative": "providesDirectionalDerivatives",
}
"""Capability flags of FMI 2.0 that have another name in FMI 3.0."""

_NAMES = {"GUID": "instantiation token", **FLAGS}
"""Names in messages of checks."""

_IN_CATALOGUE = {
    "fmuGUID": "instantiationToken",
    "SimpleTypes": "type definitions",
    "SimpleType": "type definition",
    "ScalarVariables": "variables",
    "SourceFiles": "buildDescription.xml",
    "FMI 2.0": "FMI 3.0",
    "2.2.7": "2.4.7",
}
"""More names, in titles and hints of checks."""


def translate_message(text: str, version: int) -> str:
    """Return a message of a check in the terms of a version of FMI, 2 or 3."""
    if version == 2:
        return text
    text = re.sub(r"\bfmi2([A-Z]\w*)", lambda m: f"fmi3{_FUNCTIONS.get(m[1], m[1])}", text)
    return _replace_names(text, _NAMES)


def translate_catalogue_text(text: str, version: int) -> str:
    """Return a title, hint or description of a check in the terms of a version of FMI."""
    return text if version == 2 else translate_message(_replace_names(text, _IN_CATALOGUE), version)


def _replace_names(text: str, names: Mapping[str, str]) -> str:
    return re.sub("|".join(rf"\b{re.escape(name)}\b" for name in names), lambda m: names[m[0]], text)


def translate_outcome(version: int, outcome: CheckOutcome) -> CheckOutcome:
    """Return an outcome with the names and clauses of a version of FMI, and with its details written."""
    quoted, details = outcome.clause, [translate_message(line, version) for line in outcome.details]
    for line, clause in outcome.lines:
        own_clause = None if clause is None or clause == quoted else clause.of(version)
        details.append(
            translate_message(line, version)
            + (f" ({own_clause}: “{own_clause.sentence}”)" if own_clause is not None else "")
        )
    return replace(
        outcome,
        sentence=translate_message(outcome.sentence, version),
        details=tuple(details),
        hint=translate_catalogue_text(outcome.hint, version),
        clause=None if quoted is None else quoted.of(version),
        gaps=tuple(translate_message(gap, version) for gap in outcome.gaps),
        lines=(),
    )


TEXTS = msgspec.json.decode(
    (files(__package__ or "") / "checks.json").read_bytes(), type=dict[str, dict[str, tuple[str, str]]]
)
"""Title and hint of each check by its name, by group."""

Examine = Callable[[Any], CheckOutcome]
"""The function of a check. Takes a `Subject` or a `WholeSystem`."""


@dataclass(frozen=True)
class Check:
    """One check of an FMU. It runs in a subprocess.

    Attributes:
        name: Stable name, `group.what`.
        title: Title in reports.
        clause: Clause of the standard that a failure violates.
        hint: What to do about a failure.
        examine: Function of the check.
        needs: Names of checks that must pass or warn first.
        time_factor: Multiplies the time limit.
        memory_factor: Multiplies the memory limit.
        advisory: Whether a failure only warns or, if the clause is a rule of this program, is only noted.
        only_for: Version of FMI that alone has what the check is about, 2 or 3; 0 for both.
    """

    name: str
    title: str
    clause: Clause
    hint: str
    examine: Examine
    needs: tuple[str, ...] = ()
    time_factor: float = 1.0
    memory_factor: float = 1.0
    advisory: bool = False
    only_for: int = 0

    def of(self, version: int) -> "Check":
        """Return the check with the texts for a version of FMI, 2 or 3."""
        title, hint = (translate_catalogue_text(text, version) for text in (self.title, self.hint))
        return replace(self, clause=self.clause.of(version), title=title, hint=hint)

    def __reduce__(self) -> Any:
        """Pickle the check by its module and name, for other processes."""
        return _load_check, (self.examine.__module__, self.examine.__name__)

    @property
    def group(self) -> str:
        """The first part of the name: `state`."""
        return self.name.partition(".")[0]

    @property
    def procedure(self) -> str:
        """What the check does, as one paragraph."""
        return " ".join(inspect.cleandoc(self.examine.__doc__ or "").partition("\n\n")[0].split())


def check(
    name: str, title: str = "", clause: Clause | None = None, hint: str = "", **more: Any
) -> Callable[[Examine], Check]:
    """Decorate a function as a check. `Check` describes the arguments.

    By default, title and hint are those in checks.json, and the clause is that in quotations.json.
    """
    if not title:
        title, hint = next(texts[name] for texts in TEXTS.values() if name in texts)
    clause = clause or quote(name)
    return lambda examine: Check(name, title, clause, hint, examine, **more)


def _load_check(module: str, name: str) -> Check:
    return getattr(import_module(module), name)
