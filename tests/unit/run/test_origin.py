"""The source of a run in run.json: the scenario by its name, and the options that override it."""

import hashlib
import json
import shutil
from pathlib import Path
from typing import Any

import pytest

import emla_cosim as ec
from emla_cosim.fmu.models import fmu_path
from tests.support.cart import Cart
from tests.support.commands import Emla


def origin(folder: Path) -> tuple[Any, Any, Any]:
    record = json.loads((folder / "run.json").read_text())
    return record["source"], record["source_sha256"], record["changed"]


def test_named_scenario_and_options(emla: Emla, tmp_path: Path) -> None:
    given = ("--stop-time", "0.001", "--set", "lift.plant.motor.R_s=0.2", "--no-plots", "--output", "out")
    assert emla("run", "lift", *given).exit_code == 0
    assert origin(tmp_path / "out") == (
        "lift",
        None,
        {"set": {"lift.plant.motor.R_s": "0.2"}, "stop_time": 0.001},
    )


def test_scenario_file_with_its_hash(emla: Emla, tmp_path: Path) -> None:
    text = 'system = "lift"\nstop_time = 0.001\n[set]\n"lift.plant.motor.R_s" = 0.2\n'
    Path("mine.toml").write_text(text)
    assert emla("run", "mine.toml", "--no-plots", "--output", "out").exit_code == 0
    place = str(tmp_path / "mine.toml")
    assert origin(tmp_path / "out") == (place, hashlib.sha256(text.encode()).hexdigest(), {})


def test_later_options_are_merged(fmu_folder: Path) -> None:
    loaded = ec.load("lift", stop_time=0.5, set={"lift.plant.motor.R_s": 0.1})
    with loaded.prepare(fmus=fmu_folder, set={"lift.plant.motor.L_q": 1e-3}) as simulation:
        first = simulation.run(stop_time=0.001, set={"lift.plant.motor.R_s": 0.2})
        second = simulation.run(stop_time=0.002)
    assert first.record["changed"] == {
        "set": {"lift.plant.motor.R_s": 0.2, "lift.plant.motor.L_q": 1e-3},
        "stop_time": 0.001,
    }
    assert second.record["changed"]["set"]["lift.plant.motor.R_s"] == 0.1


def test_python_objects_are_marked_and_paths_are_absolute(
    fmu_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(fmu_path("FocController", "native", fmu_folder), tmp_path / "drive.fmu")
    replaced = ec.load("lift", replace={"lift.controller": "drive.fmu"}, controller="drive.fmu").origin
    assert replaced.overrides["controller"] == str(tmp_path / "drive.fmu")
    assert replaced.overrides["replace"]["lift.controller"].fmu == tmp_path / "drive.fmu"
    with ec.load("lift").prepare(fmus=fmu_folder, algorithm=ec.Jacobi()) as simulation:
        assert simulation.run(stop_time=0.001).record["changed"] == {
            "algorithm": {"python": "emla_cosim.master.algorithms.jacobi.Jacobi"},
            "stop_time": 0.001,
        }
    system = ec.System.of({"cart": Cart})
    with ec.load(system, stop_time=0.01, step_size=0.01).prepare() as simulation:
        record = simulation.run().record
    assert record["source"] is None
    assert record["changed"] == {"stop_time": 0.01, "step_size": 0.01}
