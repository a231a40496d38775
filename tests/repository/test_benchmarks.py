"""The benchmarks compare runs of the same numbers, and write the table that they measured."""

import re
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.errors import BenchmarkError
from benchmarks.job import Job, load_job
from benchmarks.registry import C_LOOP, FMU_CALLS, Tool
from benchmarks.rounds import Result, check_signals, measured
from benchmarks.run import README
from benchmarks.study import study_job
from benchmarks.table import in_readme, rows
from benchmarks.tools import emla
from benchmarks.tools.c_loop import run_loop

pytestmark = pytest.mark.skipif(
    sys.platform == "win32", reason="loop.c loads libraries as POSIX does, not as Windows."
)

STEPS = 300
OURS = Tool("ours", "emla")
MISSING = Tool("another", "not_there")
RESULTS = [
    Result(FMU_CALLS, [4e-6, 5e-6, 3e-6]),
    Result(C_LOOP, [5e-6, 5e-6, 10e-6]),
    Result(OURS, [20e-6, 25e-6, 16e-6], "ours 1.2"),
    Result(MISSING, [], "", "it is not installed"),
]


@pytest.fixture(scope="module")
def job(fmu_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Job:
    return study_job(fmu_folder, tmp_path_factory.mktemp("benchmark")).with_steps(STEPS)


def test_c_loop_gives_the_bits_of_our_master(job: Job) -> None:
    expected = emla.measure(job)
    for options in ([], ["replay"]):
        result = run_loop(job, *options)
        assert result.signals == expected.signals
        assert result.steps == expected.steps == STEPS


def test_job_survives_its_file(job: Job, tmp_path: Path) -> None:
    initialized = replace(job, initial=tuple(run_loop(job.with_steps(0)).signals))
    initialized.save(tmp_path / "job.json")
    assert load_job(tmp_path / "job.json") == initialized


@pytest.mark.slow
def test_missing_tool_is_reported(job: Job) -> None:
    lines: list[str] = []
    ours, missing = measured(job, [OURS, MISSING], 2, 20, lines.append)
    assert len(ours.step_times) == 2
    assert (missing.step_times, ours.problem) == ([], "")
    assert "not_there" in missing.problem
    assert len(lines) == 3


def test_different_numbers_end_the_benchmark(job: Job) -> None:
    signals = [0.0] * len(job.signals)
    check_signals("ours", job, signals, signals)
    component, output = job.signals[-1]
    with pytest.raises(BenchmarkError, match=re.escape(f"{component.name}.{output.name} is 1.0 instead")):
        check_signals("ours", job, [*signals[:-1], 1.0], signals)


def test_rows_of_the_benchmark_table() -> None:
    assert rows(RESULTS) == [
        (FMU_CALLS.title, "250000", "200000 - 333000", "1.25", "-"),
        (C_LOOP.title, "200000", "100000 - 200000", "1", "1.0"),
        ("ours (ours 1.2)", "50000", "40000 - 62500", "0.25", "16.0"),
        ("another", "not measured", "-", "-", "-"),
    ]


def test_readme_gets_the_table_between_its_markers() -> None:
    readme = "# Title\n<!-- benchmark begins -->\nold\n<!-- benchmark ends -->\nmore\n"
    readme += "<!-- size begins -->\nolder\n<!-- size ends -->\n"
    assert in_readme(readme, "| new |") == readme.replace("old\n", "| new |\n")
    assert in_readme(readme, "| new |", "size") == readme.replace("older", "| new |")
    for wrong in ("# Title\n", readme.replace("ends", "end"), readme.replace("begins", "ends")):
        with pytest.raises(BenchmarkError, match="no place for the table"):
            in_readme(wrong, "| new |")


@pytest.mark.parametrize("name", ["benchmark", "size"])
def test_readme_has_markers_for_each_table(name: str) -> None:
    assert "| new |" in in_readme(README.read_text(encoding="utf-8"), "| new |", name)
