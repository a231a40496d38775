"""The process of a run that is killed at any instant: its parent has every completed row."""

import json
import os
import signal
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import polars
import psutil
import pytest

import emla_cosim as ec
from tests.support.commands import Emla, sentence
from tests.support.processes import start
from tests.support.waiting import wait_for
from tests.support.whole_files import assert_whole, names

STEP, STOP = 1e-4, 40.0
DRAWS = 3
"""Number of kills for each kind of table."""

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not hasattr(os, "fork"), reason="Windows has no `fork`, so no supervision."),
]


@pytest.fixture(scope="module")
def undisturbed(fmu_folder: Path) -> np.ndarray:
    """All rows of an undisturbed run."""
    with ec.load("lift", stop_time=STOP, output_interval=STEP, fmus=fmu_folder).prepare() as simulation:
        return simulation.run().to_polars().to_numpy()


@pytest.mark.parametrize("form", ["csv", "parquet"])
@pytest.mark.parametrize("steps_per_row", [1, 10, 999])
def test_every_completed_row_survives(
    form: str, steps_per_row: int, undisturbed: np.ndarray, fmu_folder: Path, tmp_path: Path
) -> None:
    random = np.random.default_rng(steps_per_row)
    options = ("--stop-time", STOP, "--output-interval", f"{steps_per_row * STEP:g}", "--output-format", form)
    killed_count = 0
    for out in (tmp_path / f"out{draw}" for draw in range(DRAWS)):
        table = out / f"results.{form}"
        command = ("run", "lift", "--fmus", fmu_folder, "--no-plots", *options, "--output", out.name)
        process = start(tmp_path, *command)
        begun = table if form == "csv" else table.with_name(f"{table.name}.parts")
        wait_for(lambda begun=begun, process=process: begun.exists() or process.poll() is not None, 300.0)
        time.sleep(random.uniform(0.0, 1.0))
        for child in psutil.Process(process.pid).children():
            child.send_signal(signal.SIGKILL)
        _, errors = process.communicate(timeout=300.0)
        if not process.returncode:  # it was faster
            continue
        assert process.returncode == 1 and errors.count("Error:") == 1, errors
        assert_whole(out)
        if "before its first step" in errors or "complete" in errors:
            continue
        killed_count += 1
        assert names(out) == {table.name, "metrics.json", "run.json"}
        rows = polars.read_csv(table) if form == "csv" else polars.read_parquet(table)
        steps = json.loads((out / "metrics.json").read_text())["run"]["steps"]
        due = sorted({*range(0, steps + 1, steps_per_row), steps})
        assert np.array_equal(rows.to_numpy(), undisturbed[due])
        assert f"the run ended at t = {rows['time'][-1]:.6g} s: the process was killed" in errors
    assert killed_count


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_folder_of_a_run_whose_processes_were_all_killed(
    form: str, emla: Emla, fmu_folder: Path, tmp_path: Path
) -> None:
    command = ("run", "lift", "--no-plots", "--output-format", form, "--output", "out")
    table = "results.csv" if form == "csv" else "results.parquet.parts/*.parquet"
    for pattern, least in (("run.json", 40), (table, 10_000)):  # more bytes than the header of results.csv
        process = start(tmp_path, *command, "--stop-time", STOP, "--fmus", fmu_folder)
        out = tmp_path / "out"
        wait_for(lambda p=pattern, n=least, o=out: any(f.stat().st_size > n for f in o.glob(p)), 300.0)
        parent = psutil.Process(process.pid)
        for member in (parent, *parent.children(recursive=True)):
            with suppress(psutil.NoSuchProcess):  # it ends with its parent
                member.kill()
        process.communicate(timeout=300.0)
    assert json.loads((tmp_path / "out/run.json").read_text()) == {"scenario": "lift", "status": "unfinished"}
    assert "the run of 'out/run.json' has not finished" in sentence(emla("rerun", "out"), 2)
    if form == "csv":
        assert "rows so far of a run that has not finished" in emla("plot", "out").output
    assert emla(*command, "--stop-time", "0.01").exit_code == 0
    assert names(tmp_path / "out") == {f"results.{form}", "metrics.json", "run.json"}
