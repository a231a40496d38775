"""Runs compared with stored runs: `emla run --reference`, and in Python."""

import json
import shutil
from pathlib import Path

import numpy as np
import polars
import pytest

import emla_cosim as ec
from emla_cosim.base.errors import CommandError, RunError
from tests.support.commands import Emla, sentence

SHORT_RUN = ("--stop-time", "0.05", "--no-plots")


@pytest.fixture(scope="module")
def simulation(fmu_folder: Path) -> ec.Simulation:
    return ec.load("lift", fmus=fmu_folder, stop_time=0.05).prepare()


@pytest.fixture(scope="module")
def reference_run(simulation: ec.Simulation, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("reference_run")
    simulation.run().save(folder, plots=False)
    return folder


def test_same_run_agrees(simulation: ec.Simulation, reference_run: Path) -> None:
    result = simulation.run(reference=reference_run, tolerance={"*": ec.Tolerance(0.0, time=0.0)})
    assert [c.signal for c in result.comparisons] == simulation.names
    assert all(c.inside and c.worst == 0.0 for c in result.comparisons)
    later = simulation.run(stop_time=0.02).compare(reference_run, {"*": 1e-9})
    assert [c.signal for c in later] == simulation.names and all(c.inside for c in later)
    assert later[0].time[-1] == pytest.approx(0.02)
    assert result.record["reference"] == {
        "run": str(reference_run / "results.csv"),
        "signals": len(simulation.names),
        "left": [],
    }


def test_other_run_reports_which_signal_left_its_tube_first(
    simulation: ec.Simulation, reference_run: Path
) -> None:
    with pytest.raises(RunError, match=r"signals do not agree with '.*results\.csv': lift\.") as raised:
        simulation.run(reference=reference_run, set={"lift.plant.motor.R_s": 0.2})
    result = raised.value.fields["result"]
    outside = result.record["reference"]["left"]
    assert [x["left_at_s"] for x in outside] == sorted(x["left_at_s"] for x in outside)
    assert f"{outside[0]['signal']} left its tube at t = {outside[0]['left_at_s']:.9g} s" in str(raised.value)
    worst = next(x for x in outside if x["signal"] == "lift.controller.u_q")
    before = polars.read_csv(reference_run / "results.csv")["lift.controller.u_q"].to_numpy()
    off = np.abs(result["lift.controller.u_q"] - before)
    # the tube's edges are up to half an interval away
    assert 0.0 < worst["worst"] <= off.max()
    assert {x["signal"] for x in outside} == {c.signal for c in result.comparisons if not c.inside}
    wide = {"*": ec.Tolerance(1e-9, time=0.0), "lift.*": 10.0}
    assert (
        simulation.run(reference=reference_run, tolerance=wide, set={"lift.plant.motor.R_s": 0.2}).problem
        is None
    )
    with pytest.raises(RunError, match=r"requirements not met: run\.steps < 3.*signals do not agree"):
        simulation.run(reference=reference_run, set={"lift.plant.motor.R_s": 0.2}, require=["run.steps < 3"])
    with pytest.raises(CommandError, match="needs a recorder that keeps a table"):
        simulation.run(reference=reference_run, recorders=[])


def test_reference_in_parquet(simulation: ec.Simulation, tmp_path: Path) -> None:
    run = simulation.run(output_format="parquet")
    run.save(tmp_path / "p", plots=False)
    assert simulation.run(reference=tmp_path / "p").problem is None
    assert simulation.run(reference=tmp_path / "p" / "results.parquet").problem is None


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "does not exist"),
        ("time\n0\n", "must have a column of times, and signals"),
        ("time,other.x\n0,1\n", "has none of the recorded signals; it has other.x and 0 more"),
    ],
)
def test_reference_that_cannot_be_compared(
    content: str | None, message: str, simulation: ec.Simulation, tmp_path: Path
) -> None:
    path = tmp_path / "results.csv"
    if content is not None:
        path.write_text(content)
    with pytest.raises(CommandError, match=message):
        simulation.run(reference=path)


def test_command_fails_with_a_table_and_a_message(emla: Emla, tmp_path: Path) -> None:
    assert emla("run", "lift", *SHORT_RUN, "--output", "a").exit_code == 0
    same = emla("run", "lift", *SHORT_RUN, "--output", "b", "--reference", "a")
    assert same.exit_code == 0
    assert f"50 of 50 signals agree with {Path('a', 'results.csv')}" in same.stdout
    changed = ("--set", "lift.plant.motor.R_s=0.2")
    differing = emla("run", "lift", *SHORT_RUN, "--output", "c", "--reference", "a", *changed)
    assert "signals do not agree with 'a/results.csv'" in sentence(differing, 1)
    assert "left tube at / s" in differing.stdout
    record = json.loads((tmp_path / "c" / "run.json").read_text())
    assert record["status"] != "completed" and record["reference"]["left"]
    wide = ("--output", "c", "--reference", "a", "--tolerance", "9")
    assert emla("run", "lift", *SHORT_RUN, *changed, *wide).exit_code == 0


def test_reference_of_a_run_that_has_not_finished_is_noted(emla: Emla, tmp_path: Path) -> None:
    assert emla("run", "lift", *SHORT_RUN, "--output", "a").exit_code == 0
    (tmp_path / "a" / "run.json").write_text('{"scenario": "lift", "status": "unfinished"}')
    compared = emla("run", "lift", *SHORT_RUN, "--reference", "a", "--output", "b")
    assert compared.exit_code == 0
    text = " ".join(compared.stdout.split())
    assert text.count("has only the rows so far of a run that has not finished.") == 1


def test_reference_is_not_overwritten(emla: Emla, tmp_path: Path) -> None:
    text = sentence(emla("run", "lift", *SHORT_RUN, "--reference", "nowhere"), 2)
    assert text == "Error: the run to compare with, 'nowhere', does not exist."
    assert not list(tmp_path.rglob("*.csv"))
    assert emla("run", "lift", *SHORT_RUN, "--output", "a").exit_code == 0
    before = (tmp_path / "a" / "results.csv").read_bytes()
    for reference in ("a", "a/results.csv"):
        message = sentence(emla("run", "lift", *SHORT_RUN, "--output", "a", "--reference", reference), 2)
        assert "the run to compare with" in message and "Choose another file" in message
    (tmp_path / "b").symlink_to(tmp_path / "a")
    assert "is also" in sentence(emla("run", "lift", *SHORT_RUN, "--output", "b", "--reference", "a"), 2)
    assert (tmp_path / "a" / "results.csv").read_bytes() == before


@pytest.mark.slow
def test_verify_compares_a_package_with_a_run(
    emla: Emla, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert emla("export", "lift", "lift.ssp", "--stop-time", "0.05").exit_code == 0
    assert emla("run", "lift.ssp", "--no-plots", "--output", "a").exit_code == 0
    good = ec.verify("lift.ssp", reference="a", only="description.readable")
    assert good.passed
    assert [e.label for e in good.examined][-1] == "lift.ssp"
    assert len(good["lift.ssp"]["system.agrees"].outcome.comparisons) == 50
    table = polars.read_csv(tmp_path / "a" / "results.csv")
    table = table.with_columns(polars.col("lift.plant.x_L") + 1e-3)
    shutil.copytree(tmp_path / "a", tmp_path / "b")
    table.write_csv(tmp_path / "b" / "results.csv")
    result = emla("verify", "lift.ssp", "--reference", "b", "--only", "description.readable")
    assert sentence(result, 1) == "Error: 1 check failed."
    assert "1 of 50 signals do not agree with" in result.stdout
    assert "lift.plant.x_L left its tube at t = 0 s; it is off by up to 0.001 m" in result.stdout
    monkeypatch.setenv("EMLA_COSIM_CACHE", str(tmp_path / "cache"))  # without a compiled stepper
    assert ec.verify("lift.ssp", reference="a", only="description.readable").passed
