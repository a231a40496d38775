"""What a run was and how it ended, in words."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ..result import Result


@dataclass(frozen=True)
class Heading:
    """`verdict` is passed, warning or failed, and `sentences` say why.

    `changed` is what was said beside the scenario, by what it is called; `span` the time that was simulated.
    """

    title: str
    verdict: str
    sentences: tuple[str, ...]
    changed: tuple[tuple[str, str], ...]
    span: str


def heading(result: Result) -> Heading:
    """The heading of the page."""
    verdict, sentences = _ending(result)
    return Heading(
        result.name,
        verdict,
        tuple(sentences),
        tuple(_changed(result.record.get("changed") or {})),
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
    found = [figures for kind in result.metrics.values() for figures in kind.values()]
    settled = [figures["converged"] for figures in found if "converged" in figures]
    more = " and converged" if settled and all(settled) else ""
    return "passed", [f"Ran to its end{more}."]


def _changed(changed: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Each change as the name of an option, or of what it sets, and the value."""
    found = []
    for name, value in changed.items():
        if isinstance(value, Mapping):
            found += [(f"{name} {inner}", text(v)) for inner, v in value.items()]
        else:
            found.append((name, text(value)))
    return found


def text(value: Any) -> str:
    """A value of run.json as a person reads it."""
    if isinstance(value, str):
        return value
    if value is None or value in ({}, []):
        return "–"
    if isinstance(value, list) and all(isinstance(v, str) for v in value):
        return ", ".join(value)
    return json.dumps(value, ensure_ascii=False)
