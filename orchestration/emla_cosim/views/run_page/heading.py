"""Heading of a run's page: what was run and how it ended."""

from dataclasses import dataclass

from ...recorders.metrics import list_figures
from ...run.result import Result
from ..formatting import format_short, list_overrides


@dataclass(frozen=True)
class Heading:
    """`verdict` is passed, warning or failed; `sentences` give the reasons.

    `changed` has the overrides of the scenario by name; `span` is the simulated time.
    """

    title: str
    verdict: str
    sentences: tuple[str, ...]
    changed: tuple[tuple[str, str], ...]
    span: str


def build_heading(result: Result) -> Heading:
    """Return the heading of a result."""
    verdict, sentences = _ending(result)
    return Heading(
        result.name,
        verdict,
        tuple(sentences),
        tuple((name, format_short(value)) for name, value in list_overrides(result)),
        f"{result.times.start:g} s to {result.end_s:g} s",
    )


def _ending(result: Result) -> tuple[str, list[str]]:
    if result.interrupted:
        said = result.problem or f"interrupted at t = {result.end_s:.6g} s."
        return "warning", [f"{said[:1].upper()}{said[1:]}", *result.remarks]
    if result.problem is not None:
        return "failed", [f"Failed: {result.problem}", *result.remarks]
    if result.remarks:
        return "warning", list(result.remarks)
    verdicts = [figure.value for figure in list_figures(result.metrics).values() if figure.is_verdict]
    more = "; all joints held" if verdicts and all(verdicts) else ""
    return "passed", [f"Completed{more}."]
