"""FMUs that lose start values, keep their state in fmi2Reset, or use the tolerance of the experiment."""

import json
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest

import emla_cosim as ec
from emla_cosim.analyses.sweep.report import status_line
from emla_cosim.base.errors import CommandError, RunError
from emla_cosim.base.units import LinearTransformation
from emla_cosim.system.model import Alias, Component, Connection, System
from tests.support.commands import Emla
from tests.support.hand_written_fmus import build_reluctant_fmu
from tests.support.tiers import mostly_slow

VALUES = {
    "u": 3.0,
    "gain": 2.0,
    "share": 0.75,
    "angle": 0.3,
    "x": 1.5,
    "guess": 5.0,
    "count": 7,
    "mode": "heat",
    "label": "north",
}


def _options(values: dict[str, Any], **options: Any) -> dict[str, Any]:
    times = {"start_time": 0.5, "stop_time": 1.5, "step_size": 0.125, "output_interval": 0.125}
    return {"set": {f"Reluctant.{n}": v for n, v in values.items()}, **times, **options}


def _not_taken(result: ec.Result) -> dict[str, Any]:
    return result.record["components"]["Reluctant"]["not_taken"]


@pytest.mark.parametrize("isolate", mostly_slow([False, True], [False]))
def test_start_values_survive_the_setup_of_the_experiment(reluctant: Path, isolate: bool) -> None:
    fmpy_result = fmpy.simulate_fmu(
        str(reluctant),
        start_time=0.5,
        stop_time=1.5,
        output_interval=0.125,
        start_values={**VALUES, "mode": 2},
        fmi_type="CoSimulation",
    )
    with ec.load(str(reluctant), **_options(VALUES, isolate=isolate)).prepare() as simulation:
        for _ in range(3):  # the second run after fmi2Reset, which keeps x
            ours = simulation.run()
            assert np.abs(ours["Reluctant.x"] - fmpy_result["x"]).max() <= 1e-12
            assert ours["Reluctant.x"][[0, -1]].tolist() == [1.5, 7.5]
            assert _not_taken(ours) == {}
            assert ours.remarks == []
        second_run = simulation.run(set={"Reluctant.x": 0.0, "Reluctant.gain": 0.0})
        assert second_run["Reluctant.x"][-1] == 0.0  # values that are 0 are set, too


@pytest.mark.parametrize("isolate", mostly_slow([False, True], [False]))
def test_ignored_start_values_are_reported(reluctant: Path, isolate: bool) -> None:
    options = _options({**VALUES, "stubborn": True}, isolate=isolate)
    with ec.load(str(reluctant), **options).prepare() as simulation:
        result = simulation.run()
        assert _not_taken(result) == {
            "u": {"set": 3.0, "read": 1.0, "unit": None},
            "gain": {"set": 2.0, "read": 1.0, "unit": None},
            "share": {"set": 0.75, "read": 0.5, "unit": None},
            "angle": {"set": 0.3, "read": 0.0, "unit": None},
            "x": {"set": 1.5, "read": 0.0, "unit": None},
            "count": {"set": 7, "read": 1, "unit": None},
            "mode": {"set": "heat", "read": "off", "unit": None},
            "label": {"set": "north", "read": "none", "unit": None},
        }
        assert result.remarks == [
            "The FMU of Reluctant did not take 8 start values: u is 1.0 instead of 3.0; gain is 1.0 instead "
            "of 2.0; share is 0.5 instead of 0.75; and 5 more."
        ]
        assert _not_taken(simulation.run(set={"Reluctant.stubborn": False})) == {}
        assert len(_not_taken(simulation.run(fresh=True))) == 8


def test_limited_value_is_reported_in_units_of_the_system(reluctant: Path) -> None:
    percent = Alias("share", transformation=LinearTransformation(0.01, 0.0))
    parts = (
        Component("a", fmu=reluctant, parameters={"level": 150.0}, aliases={"level": percent}),
        Component("b", fmu=reluctant, parameters={"share": 1.0, "gain": 0.0}),
    )
    system = System(parts, (Connection("a", "x", "b", "u"),))
    result = ec.load(system, stop_time=0.5, step_size=0.1).prepare().run()
    changed_values = {name: c["not_taken"] for name, c in result.record["components"].items()}
    assert changed_values == {"a": {"level": {"set": 150.0, "read": 100.0, "unit": None}}, "b": {}}


def test_resumed_run_reports_and_continues(reluctant: Path, tmp_path: Path) -> None:
    options = _options({**VALUES, "share": 3.0})
    with ec.load(str(reluctant), **options).prepare() as simulation:
        expected = simulation.run()
        half = simulation.run(stop_time=1.0, checkpoint=tmp_path / "kept")
        rest = simulation.run(resume=tmp_path / "kept")
        assert rest["Reluctant.x"][-1] == expected["Reluctant.x"][-1]
        for result in (expected, half, rest):
            assert _not_taken(result) == {"share": {"set": 3.0, "read": 1.0, "unit": None}}
        with pytest.raises(CommandError, match="FMI tolerance"):
            simulation.run(resume=tmp_path / "kept", fmi_tolerance=1e-3)


def test_terminal_and_record_show_changed_values(reluctant: Path, emla: Emla) -> None:
    process = emla("run", str(reluctant), "--set", "Reluctant.share=-1", "--no-plots", "--output", "o")
    assert process.exit_code == 0, process.output
    sentence = "The FMU of Reluctant did not take 1 start value: share is 0.0 instead of -1.0."
    assert sentence in " ".join(process.output.split())
    record = json.loads(Path("o", "run.json").read_text())
    assert record["components"]["Reluctant"]["not_taken"]["share"]["read"] == 0.0


def test_the_tolerance_of_the_experiment_is_passed(reluctant: Path) -> None:
    with ec.load(str(reluctant), **_options({})).prepare() as simulation:
        for tolerance, right in ((None, 1e-5), (1e-8, 1e-8), (None, 1e-5)):
            result = simulation.run(fmi_tolerance=tolerance)
            assert result["Reluctant.tolerance"].tolist() == [right] * 9
            assert result.record["components"]["Reluctant"]["tolerance"] == right
            assert result.record["settings"]["fmi_tolerance"] == tolerance
        for wrong in (0.0, -1.0, float("nan"), float("inf")):
            with pytest.raises(CommandError, match="the fmi tolerance"):
                simulation.run(fmi_tolerance=wrong)


@pytest.mark.parametrize("declared", ["0", "-1", "INF"])
def test_invalid_tolerance_of_the_description_is_left_out(declared: str, tmp_path: Path) -> None:
    fmu = build_reluctant_fmu(tmp_path / "Reluctant.fmu", declared)
    result = ec.load(str(fmu), **_options({})).prepare().run()
    assert result.record["components"]["Reluctant"]["tolerance"] is None
    assert set(result["Reluctant.tolerance"].tolist()) == {0.0}


@pytest.mark.parametrize("isolate", mostly_slow([False, True], [False]))
def test_first_rejected_value_is_named(reluctant: Path, isolate: bool) -> None:
    with ec.load(str(reluctant), **_options({**VALUES, "share": 1e250}, isolate=isolate)).prepare() as run:
        with pytest.raises(RunError, match=r"setting share = 1e\+250 with fmi2Error"):
            run.run()
        assert _not_taken(run.run(set={"Reluctant.share": 0.25})) == {}


def test_fmu_is_not_called_after_fatal(reluctant: Path) -> None:
    options = _options({**VALUES, "guess": 1e250}, isolate=True)  # an abort would end the test, too
    with ec.load(str(reluctant), **options).prepare() as run, pytest.raises(RunError, match="with fmi2Fatal"):
        run.run()


def test_sweep_reports_variants_that_lost_a_value(
    reluctant: Path, tmp_path: Path, on_one_cluster: None
) -> None:
    times = {"start_time": 0.5, "stop_time": 1.5, "step_size": 0.125}
    result = ec.sweep(
        str(reluctant),
        **times,
        vary={"Reluctant.share": [0.25, 1.5, 0.0]},
        metrics=["y = last(Reluctant.x)"],
        output=tmp_path / "out",
    )
    assert result.variants["problem"].to_list() == [
        None,
        "The FMU of Reluctant did not take 1 start value: share is 1.0 instead of 1.5.",
        None,
    ]
    assert "In 1 of them, FMUs did not take start values" in status_line(result)
    result = ec.sweep(
        str(reluctant),
        stop_time=1.0,
        step_size=0.125,
        require=["run.steps < 8"],
        vary={"Reluctant.share": [2.0]},
        output=tmp_path / "failed",
    )
    (problem,), (status,) = result.variants["problem"].to_list(), result.variants["status"].to_list()
    assert status == "failed" and "run.steps" in problem
    assert "did not take 1 start value: share is 1.0 instead of 2.0." in problem
