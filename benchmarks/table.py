"""The table of results: as text, as Markdown, in the README, as JSON."""

import json
import platform
from collections.abc import Sequence
from pathlib import Path
from statistics import median
from typing import Any

from .errors import BenchmarkError
from .registry import C_LOOP, FMU_CALLS
from .rounds import Result

_HEAD = ("Tool", "steps/s", "range", "of the C loop", "µs per step beyond the FMUs")


def rows(results: Sequence[Result]) -> list[tuple[str, ...]]:
    """The cells of the table: median, least and largest steps/s, ratio of medians, difference of medians."""
    medians = {r.tool: median(r.step_times) for r in results if r.step_times}
    loop, calls = medians.get(C_LOOP), medians.get(FMU_CALLS)
    cells = []
    for result in results:
        tool = result.tool
        title = f"{tool.title} ({result.version})" if result.version else tool.title
        if tool not in medians:
            cells.append((title, "not measured", "-", "-", "-"))
            continue
        least, largest = 1.0 / max(result.step_times), 1.0 / min(result.step_times)
        ratio = "-" if loop is None else f"{loop / medians[tool]:.3g}"
        beyond = "-" if calls is None or tool == FMU_CALLS else _microseconds(medians[tool] - calls)
        cells.append(
            (
                title,
                three_digits(1.0 / medians[tool]),
                f"{three_digits(least)} - {three_digits(largest)}",
                ratio,
                beyond,
            )
        )
    return cells


def three_digits(rate: float) -> str:
    """Three digits of a rate."""
    digits = len(f"{rate:.0f}")
    return f"{round(rate, 3 - digits):.0f}"


def _microseconds(seconds: float) -> str:
    """One digit after the point, which is as exact as rounds agree; never minus zero."""
    return f"{round(1e6 * seconds, 1) + 0.0:.1f}"


def text(results: Sequence[Result]) -> str:
    """The table in columns for a terminal, and why tools were not measured."""
    table = [_HEAD, *rows(results)]
    widths = [max(len(row[i]) for row in table) for i in range(len(_HEAD))]
    lines = [
        "  ".join([row[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=True))])
        for row in table
    ]
    problems = [f"{r.tool.title} was not measured: {r.problem}" for r in results if r.problem]
    return "\n".join([*lines, *problems])


def markdown(results: Sequence[Result], rounds: int) -> str:
    """The table in Markdown, and what it was measured on."""
    lines = ["| " + " | ".join(cells) + " |" for cells in [_HEAD, *rows(results)]]
    lines.insert(1, "|---|" + "---:|" * (len(_HEAD) - 1))
    machine = (
        f"{_processor()}, {platform.system()}, {platform.python_implementation()} {platform.python_version()}"
    )
    rounds_text = f"Medians of {rounds} rounds" if rounds > 1 else "One round"
    return "\n".join([*lines, "", f"{rounds_text} on {machine}."])


def _processor() -> str:
    """The processor's name and number of logical cores, as far as the system tells."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.machine()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return f"{names[0]} ({len(names)} logical cores)" if names else platform.machine()


def in_readme(readme: str, table: str, name: str = "benchmark") -> str:
    """The README's text with a table between its markers. Raises BenchmarkError where it has none."""
    begins, ends = f"<!-- {name} begins -->", f"<!-- {name} ends -->"
    before, begin, rest = readme.partition(begins)
    _, end, after = rest.partition(ends)
    if not begin or not end:
        raise BenchmarkError(
            f"benchmarks/README.md has no place for the table: it needs the lines {begins} and {ends}."
        )
    return f"{before}{begins}\n{table}\n{ends}{after}"


def as_json(results: Sequence[Result]) -> str:
    """All measurements: s per step in every round."""
    content: dict[str, Any] = {
        "processor": _processor(),
        "tools": [
            {
                "title": r.tool.title,
                "version": r.version,
                "problem": r.problem,
                "step_times_s": r.step_times,
            }
            for r in results
        ],
    }
    return json.dumps(content, indent=2) + "\n"
