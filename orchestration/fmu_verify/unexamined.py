"""List what an examination could not judge: the section *Not examined* of a report."""

from collections.abc import Callable, Iterable, Iterator, Mapping

import fmpy

from .confinement import list_gaps
from .declarations import DeclaredVariable
from .findings import Finding
from .libraries import list_platforms
from .messages import join_few_names
from .subject import Subject
from .verdict import Verdict

_NOT_COMPARED = (
    "Whether the values of outputs are right, and follow the inputs as intended: there is no reference to "
    "compare with (--reference)."
)


def list_unexamined(subject: Subject, findings: Mapping[str, Finding]) -> tuple[str, ...]:
    """Return what was not judged, as sentences, by all findings, also those that the report leaves out."""
    return (
        *_find_uncompared_values(findings),
        *_find_not_run(findings.values()),
        *(f"{f.check}: {gap}" for f in findings.values() for gap in f.outcome.gaps),
        *_find_other_platforms(subject),
        *_find_parts_of_version_3(subject),
        *(list_gaps() if "run.completes" in findings else ()),
    )


def _find_uncompared_values(findings: Mapping[str, Finding]) -> Iterator[str]:
    """Yield that nothing was compared with a reference, if the FMU runs."""
    ran, compared = findings.get("run.completes"), findings.get("reference.agrees")
    was_compared = compared is not None and compared.verdict in (Verdict.PASSED, Verdict.FAILED)
    was_compared = was_compared or any(f.outcome.figures.get("compared") for f in findings.values())
    if ran is not None and ran.verdict in (Verdict.PASSED, Verdict.WARNING) and not was_compared:
        yield _NOT_COMPARED


def _find_not_run(findings: Iterable[Finding]) -> Iterator[str]:
    """Yield the checks that apply, but could not run, by reason."""
    reasons: dict[str, list[str]] = {}
    for f in findings:
        if f.outcome.blocked and not f.outcome.gaps:
            reasons.setdefault(f.sentence, []).append(f.check)
    for reason, names in reasons.items():
        yield f"{join_few_names(names)}: {reason}"


def _find_parts_of_version_3(subject: Subject) -> Iterator[str]:
    """Yield what FMI 3.0 has and no check that calls the FMU uses."""
    if subject.known_version != 3 or "declared" not in vars(subject):
        return
    predicates: dict[str, Callable[[DeclaredVariable], bool]] = {
        "Values of Binary variables": lambda v: v.type == "Binary",
        "Values of arrays of Strings": lambda v: v.type == "String" and bool(v.dimensions),
        "Other values of structural parameters": lambda v: v.causality == "structuralParameter",
        "Values during intermediate updates": lambda v: (
            v.own_attributes.get("intermediateUpdate") in ("true", "1")
        ),
    }
    for label, is_unexamined in predicates.items():
        if names := [v.name for v in subject.declared.variables if is_unexamined(v)]:
            yield f"{label} were not examined: {join_few_names(names)}."


def _find_other_platforms(subject: Subject) -> Iterator[str]:
    """Yield the platforms whose binaries were only read."""
    this_platform = (fmpy.platform, fmpy.platform_tuple)
    if platforms := [p.name for p in list_platforms(subject) if p.name not in this_platform]:
        names = join_few_names(platforms)
        yield f"Binaries for {names} were read, but not run on this {fmpy.platform} machine."
