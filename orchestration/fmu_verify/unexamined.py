"""List what an examination could not judge: the section *Not examined* of a report."""

from collections.abc import Iterable, Iterator, Mapping

import fmpy

from .confinement import list_gaps
from .findings import Finding
from .libraries import list_platforms
from .messages import join_few_names
from .subject import Subject
from .verdict import Verdict

_VALUES = (
    "Whether the values of outputs are right, and follow the inputs as intended: there is no reference to "
    "compare with (--reference)."
)


def list_unexamined(subject: Subject, findings: Mapping[str, Finding]) -> tuple[str, ...]:
    """Return what was not judged, as sentences, by all findings, also those that the report leaves out."""
    return (
        *_values(findings),
        *_not_run(findings.values()),
        *(f"{f.check}: {gap}" for f in findings.values() for gap in f.outcome.gaps),
        *_other_platforms(subject),
        *_of_version_3(subject),
        *(list_gaps() if "run.completes" in findings else ()),
    )


def _values(findings: Mapping[str, Finding]) -> Iterator[str]:
    """Yield that nothing was compared with a reference, if the FMU runs."""
    ran, compared = findings.get("run.completes"), findings.get("reference.agrees")
    judged = compared is not None and compared.verdict in (Verdict.PASSED, Verdict.FAILED)
    judged = judged or any(f.outcome.figures.get("compared") for f in findings.values())
    if ran is not None and ran.verdict in (Verdict.PASSED, Verdict.WARNING) and not judged:
        yield _VALUES


def _not_run(found: Iterable[Finding]) -> Iterator[str]:
    """Yield the checks that apply, but could not run, by reason."""
    reasons: dict[str, list[str]] = {}
    for f in found:
        if f.outcome.blocked and not f.outcome.gaps:
            reasons.setdefault(f.sentence, []).append(f.check)
    for reason, names in reasons.items():
        yield f"{join_few_names(names)}: {reason}"


def _of_version_3(subject: Subject) -> Iterator[str]:
    """Yield what FMI 3.0 has and no check that calls the FMU uses."""
    if subject.known_version != 3 or "declared" not in vars(subject):
        return
    variables = subject.declared.variables
    found = {
        "Values of Binary variables": [v for v in variables if v.type == "Binary"],
        "Values of arrays of Strings": [v for v in variables if v.type == "String" and v.dimensions],
        "Other values of structural parameters": [
            v for v in variables if v.causality == "structuralParameter"
        ],
        "Values during intermediate updates": [
            v for v in variables if v.own.get("intermediateUpdate") in ("true", "1")
        ],
    }
    for what, some in found.items():
        if some:
            yield f"{what} were not examined: {join_few_names([v.name for v in some])}."


def _other_platforms(subject: Subject) -> Iterator[str]:
    """Yield the platforms whose binaries were only read."""
    others = [p.name for p in list_platforms(subject) if p.name not in (fmpy.platform, fmpy.platform_tuple)]
    if others:
        yield f"Binaries for {join_few_names(others)} were read, but not run on this {fmpy.platform} machine."
