"""Explain a finding in a report that has only text."""

from .findings import Examined, Finding
from .repetition import format_command


def explain_finding(examined: Examined, finding: Finding, most: int | None = None) -> str:
    """Return message, details, clause, what was done, hint and the command to repeat it, as paragraphs.

    Args:
        examined: The FMU.
        finding: What was found.
        most: Most details; all if None.
    """
    details = list(finding.outcome.details[:most])
    if more := len(finding.outcome.details) - len(details):
        details.append(f"and {more} more")
    clause = f"{finding.clause}: \u201c{finding.clause.sentence}\u201d"
    done = f"What was done: {finding.done}" if finding.done else ""
    repeat = f"Repeat it: {format_command(examined, finding)}"
    parts = (finding.sentence, "\n".join(details), clause, done, finding.hint, repeat)
    return "\n\n".join(part for part in parts if part)
