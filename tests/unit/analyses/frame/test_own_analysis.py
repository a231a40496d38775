"""An analysis of its own in the frame: runs, record, table, pictures and page."""

import itertools
import json
from pathlib import Path

import pytest
from rich.console import Console

import emla_cosim as ec
from docs.corners import OUTPUTS, corners
from emla_cosim.analyses.frame.outputs import AnalysisFolder
from emla_cosim.analyses.frame.report import ReportTable
from emla_cosim.cli.commands.analysis import show_result

FACTORS = {"lift.plant.motor.R_s": "0.1:0.2", "lift.plant.motor.J_m": "0.01:0.02"}
METRIC = "lift.torque_peak_N_m"

pytestmark = pytest.mark.usefixtures("scheduler")


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


def test_pictures_and_pages_of_the_result_before_are_removed(tmp_path: Path) -> None:
    """By a result that is not final, and by a run without plots."""
    result = corners("lift", FACTORS, METRIC, output=tmp_path, report=True, stop_time=0.01)
    folder = AnalysisFolder(OUTPUTS, tmp_path, report=True)
    folder.keep(result, is_final=False)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["corners.json"]
    folder.keep(result)
    corners("lift", FACTORS, METRIC, output=tmp_path, plots=False, stop_time=0.01)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["corners.json"]


def test_files_of_the_user_are_refused(tmp_path: Path) -> None:
    (tmp_path / "corners.png").write_text("mine")
    with pytest.raises(ec.CommandError, match=r"corners.png.*not written by emla"):
        corners("lift", FACTORS, METRIC, output=tmp_path, stop_time=0.01)
    assert (tmp_path / "corners.png").read_text() == "mine"


def test_a_page_of_the_user_stays_and_is_not_listed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "corners.json").write_text('{"format": "emla-corners"}')
    (tmp_path / "corners.html").write_text("mine")
    result = corners("lift", FACTORS, METRIC, output=tmp_path, stop_time=0.01)
    show_result(OUTPUTS, result, tmp_path)
    assert (tmp_path / "corners.html").read_text() == "mine"
    assert capsys.readouterr().out.rstrip().endswith("corners.json, corners.png")


def test_names_in_tables_are_shown_as_they_are(capsys: pytest.CaptureFixture[str]) -> None:
    name = "[red]:warning:\\"
    Console(width=80).print(ReportTable(name, [name], [[name]]).rich())
    assert capsys.readouterr().out.count(name) == 3
