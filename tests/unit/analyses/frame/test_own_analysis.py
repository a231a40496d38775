"""An analysis of its own in the frame: runs, record, table, pictures and page."""

import itertools
import json
from pathlib import Path

import pytest

import emla_cosim as ec
from docs.corners import corners

FACTORS = {"lift.plant.motor.R_s": "0.1:0.2", "lift.plant.motor.J_m": "0.01:0.02"}
METRIC = "lift.torque_peak_N_m"


def test_corners_are_those_of_a_loop_over_runs(tmp_path: Path) -> None:
    result = corners("lift", FACTORS, METRIC, output=tmp_path, report=True, stop_time=0.05)
    expected = {}
    with ec.load("lift", stop_time=0.05).prepare() as simulation:
        for R_s, J_m in itertools.product((0.1, 0.2), (0.01, 0.02)):
            run = simulation.run(set={"lift.plant.motor.R_s": R_s, "lift.plant.motor.J_m": J_m})
            expected[R_s, J_m] = run.metrics["joints"]["lift"]["torque_peak_N_m"]
    assert {tuple(corner.values.values()): corner.figure for corner in result.corners} == expected
    assert [corner.figure for corner in result.corners] == sorted(expected.values(), reverse=True)
    record = json.loads((tmp_path / "corners.json").read_text())
    assert [corner["figure"] for corner in record["corners"]] == [c.figure for c in result.corners]
    page = (tmp_path / "corners.html").read_text()
    assert "<h1>lift</h1>" in page and 'src="data:image/png' in page


def test_a_second_run_replaces_its_files_and_removes_pictures_that_it_does_not_draw(tmp_path: Path) -> None:
    corners("lift", FACTORS, METRIC, output=tmp_path, report=True, stop_time=0.01)
    corners("lift", FACTORS, METRIC, output=tmp_path, plots=False, stop_time=0.01)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["corners.json"]


def test_files_of_the_user_are_refused(tmp_path: Path) -> None:
    (tmp_path / "corners.png").write_text("mine")
    with pytest.raises(ec.CommandError, match=r"corners.png.*not written by emla"):
        corners("lift", FACTORS, METRIC, output=tmp_path, stop_time=0.01)
    assert (tmp_path / "corners.png").read_text() == "mine"
