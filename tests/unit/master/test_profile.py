"""Where the time of a run goes: `--profile`."""

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import emla_cosim as ec
from tests.support.tiers import mostly_slow

NAP = 2e-3
SAME = {"stop_time": 0.05, "step_size": 1e-4}


@pytest.mark.parametrize(
    "options",
    [{"algorithm": "jacobi"}, {"algorithm": "strong"}, {"threads": 2}],
    ids=str,
)
def test_time_is_that_of_the_fmu_that_takes_it(options: dict[str, Any], reluctant: Path) -> None:
    """Two FMUs read each other; the steps of one take 2 ms."""
    system = ec.System.of({"slow": reluctant, "fast": reluctant}, ["slow.x -> fast.u", "fast.x -> slow.u"])
    values = {"slow.slow_from": 0.0, "slow.pause": NAP, "fast.x": 1.0}
    with ec.load(system, step_size=0.05, stop_time=0.5, set=values, **options).prepare() as simulation:
        plain, result = simulation.run(), simulation.run(profile=True)
    assert result.table is not None and plain.table is not None and result.profile is not None
    assert result.table.rows.tobytes() == plain.table.rows.tobytes()
    slow, fast = (result.profile["fmus"][name] for name in ("slow", "fast"))
    steps = slow["calls"]["steps"]
    assert steps["count"] == fast["calls"]["steps"]["count"] >= 10
    assert slow["calls"]["inputs"]["count"] >= 10 and slow["calls"]["outputs"]["count"] >= 10
    # other algorithms save a state now and then, in case that an FMU discards a step
    assert (slow["calls"]["states"]["count"] >= 10) == (options.get("algorithm") == "strong")
    assert 0.99 * NAP * steps["count"] < steps["seconds"] <= result.profile["total_s"]
    assert fast["seconds"] < slow["seconds"]


WAYS = {
    "jacobi": {"algorithm": "jacobi"},
    "gauss-seidel": {"algorithm": "gauss-seidel"},
    "strong": {"algorithm": "strong"},
    "threads": {"threads": 2},
    "error": {"error_tolerance": 1e-2, "stop_time": 0.005},
}


@pytest.fixture(scope="module")
def lift(fmu_folder: Path) -> Any:
    with ec.load("lift").prepare(fmus=fmu_folder) as simulation:
        yield simulation


@pytest.mark.parametrize("way", mostly_slow(list(WAYS), ["gauss-seidel", "strong", "threads", "error"]))
def test_profiled_run_has_the_same_bits_and_complete_shares(way: str, lift: ec.Simulation) -> None:
    """Same bits, shares that add up, and as many steps as the run has; the next run measures nothing."""
    options = {**SAME, **WAYS[way]}
    plain = lift.run(**options)
    result = lift.run(profile=True, **options)
    assert result.table is not None and plain.table is not None
    assert result.table.rows.tobytes() == plain.table.rows.tobytes()
    assert str(result.metrics) == str(plain.metrics)
    profile = result.profile
    assert profile is not None and result.record["profile"] == profile
    assert plain.profile is None and "profile" not in plain.record
    steps = {n: row["calls"]["steps"]["count"] for n, row in profile["fmus"].items()}
    if "error_tolerance" in options:
        tried_steps = result.steps + result.stepping["rejected_steps"]
        assert set(steps.values()) == {3 * tried_steps}  # a step, and two halves
    elif options.get("algorithm") == "strong":
        loops = result.stepping["sweeps_over_loops"]
        assert steps["lift.plant"] == steps["lift.controller"] == loops
        assert steps["lift.reference"] == result.steps
    else:
        assert set(steps.values()) == {result.steps}
        inputs = {n: row["calls"].get("inputs", {"count": 0})["count"] for n, row in profile["fmus"].items()}
        assert inputs["lift.reference"] == 0 and inputs["lift.plant"] == result.steps
    parts = [
        *profile["fmus"].values(),
        profile["master"],
        profile["profiler"],
        *profile["recorders"].values(),
    ]
    assert sum(part["share"] for part in parts) == pytest.approx(1.0, abs=1e-6)
    assert profile["total_s"] >= result.wall_s > 0.0
    assert {"metrics", "table"} <= set(profile["recorders"])
    assert lift.run(**options).profile is None


@pytest.mark.slow
def test_fmu_in_its_own_process_is_measured_there(fmu_folder: Path) -> None:
    options = {**SAME, "stop_time": 0.01}
    with ec.load("lift").prepare(isolate=["lift.plant"], fmus=fmu_folder) as simulation:
        plain, result = simulation.run(**options), simulation.run(profile=True, **options)
        second_run = simulation.run(profile=True, **options)
    assert result.table.rows.tobytes() == plain.table.rows.tobytes()  # type: ignore[union-attr]
    for profile in (result.profile, second_run.profile):
        assert profile is not None
        plant, observer = profile["fmus"]["lift.plant"], profile["fmus"]["lift.observer"]
        assert plant["separate_process"] and not observer["separate_process"]
        assert plant["calls"]["steps"]["count"] == result.steps
        assert 0.0 < plant["seconds"] < plant["waited_s"] == profile["separate_processes"]["seconds"]
        assert profile["separate_processes"]["seconds"] < profile["total_s"]


class Slow(ec.Recorder):
    """Sleeps for each block of rows."""

    def write(self, rows: np.ndarray) -> None:
        time.sleep(0.05)


def test_each_recorder_is_measured(lift: ec.Simulation, tmp_path: Path) -> None:
    table = ec.CsvFile(tmp_path / "rows.csv")
    result = lift.run(profile=True, recorders=[table, Slow()], **SAME)
    assert result.profile is not None
    recorders = result.profile["recorders"]
    assert 0.05 <= recorders["Slow"]["seconds"] < result.profile["total_s"]
    assert 0.0 < recorders["table"]["seconds"] < 0.05 + recorders["Slow"]["seconds"]
    assert "write" not in vars(table)


def test_failed_run_has_a_profile(lift: ec.Simulation) -> None:
    class Failing(ec.Recorder):
        def write(self, rows: np.ndarray) -> None:
            raise OSError(5, "broken")

    failing = Failing()
    failed = lift.attempt(profile=True, recorders=[failing], **SAME)
    assert failed.problem is not None and failed.profile is not None
    assert not vars(failing)
    with pytest.raises(ec.CommandError):
        lift.run(profile=True, order="nobody", **SAME)
    assert lift.run(**SAME).profile is None


def test_terminal_record_and_report_show_the_profile(lift: ec.Simulation, tmp_path: Path) -> None:
    result = lift.run(profile=True, **SAME)
    assert result.profile is not None
    lines = str(result).splitlines()
    row = next(line for line in lines if "lift.plant" in line)
    assert str(result.steps) in row
    assert any("master" in line for line in lines)
    result.save(tmp_path, plots=False, report=True)
    assert json.loads((tmp_path / "run.json").read_text())["profile"] == result.profile
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Where the time went" in page and "lift.controller" in page
    assert "Where the time went" not in str(lift.run(**SAME))
