"""Measures all tools in rounds: in each round every tool once, each in a process of its own."""

import json
import random
import subprocess
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from .environments import python_for
from .errors import BenchmarkError
from .job import Job
from .registry import Tool
from .tools.c_loop import run_loop

ROOT = Path(__file__).parents[1]
TIME_LIMIT = 600
"""How long one measurement may take, in s."""


@dataclass
class Result:
    """What was measured: s per step in every round; or the problem that prevented it."""

    tool: Tool
    step_times: list[float] = field(default_factory=list)
    version: str = ""
    problem: str = ""


def measured(
    job: Job, tools: Sequence[Tool], rounds: int, steps: int, report: Callable[[str], None]
) -> list[Result]:
    """Measure the tools, in another order in each round.

    A tool that cannot be run has a problem and is left out of later rounds. Raises BenchmarkError
    where a tool computes anything else than the C loop does.
    """
    results = [Result(tool) for tool in tools]
    shuffled = random.Random(1)

    @cache
    def expected(clock: str, count: int) -> Sequence[float]:
        return run_loop(job.with_steps(count), clock=clock).signals

    for i in range(rounds):
        for result in shuffled.sample(results, len(results)):
            if result.problem:
                continue
            tool = result.tool
            count = max(round(tool.share * steps / job.every), 1) * job.every
            found = run_once(job.with_steps(count), tool)
            if "problem" in found:
                result.problem = found["problem"]
                result.step_times.clear()
                report(f"{tool.title}: not measured, {result.problem}")
                continue
            check_signals(tool.title, job, found["signals"], expected(tool.clock, count))
            result.version = found.get("version", "")
            result.step_times.append(found["seconds"] / found["steps"])
            report(f"round {i + 1}: {tool.title}, {1.0 / result.step_times[-1]:.0f} steps/s")
    return results


def check_signals(title: str, job: Job, signals: Sequence[float], expected: Sequence[float]) -> None:
    """Raise BenchmarkError unless all signals at the end are exactly those of the C loop."""
    for (c, output), value, right in zip(job.signals, signals, expected, strict=True):
        if value != right:
            raise BenchmarkError(
                f"{title} computes something else than the C loop: at the end {c.name}.{output.name} "
                f"is {value!r} instead of {right!r}."
            )


def run_once(job: Job, tool: Tool) -> dict[str, Any]:
    """The content of the tool's result file; a problem where there is none."""
    paths = [Path(job.scratch, name) for name in ("job.json", "result.json")]
    job.save(paths[0])
    paths[1].unlink(missing_ok=True)
    try:
        python = python_for(tool.requirement)
        command = [python, "-m", f"benchmarks.tools.{tool.module}", *paths, *["one-core"] * tool.one_core]
        run = subprocess.run(
            command,
            cwd=ROOT,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=TIME_LIMIT,
            check=False,
        )
    except BenchmarkError as error:
        return {"problem": str(error)}
    except subprocess.TimeoutExpired:
        return {"problem": f"it took longer than {TIME_LIMIT} s"}
    if paths[1].exists():
        return json.loads(paths[1].read_text(encoding="utf-8"))
    errors = run.stderr.strip().splitlines() or ["nothing"]
    return {"problem": f"its process ended with {run.returncode} and said: {errors[-1]}"}
