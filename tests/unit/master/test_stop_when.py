"""Conditions on signals end a run where a run without them first meets them."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import emla_cosim as ec
from tests.support.commands import Emla

SIGNAL, LIMIT = "lift.plant.tau_m", 150.0
CONDITION = f"{SIGNAL} > {LIMIT}"
STOP = 0.02


def lift(folder: Path, **options: Any) -> ec.Scenario:
    return ec.load("lift", fmus=folder, stop_time=STOP, **{"output_interval": 1e-4, **options})


def run(scenario: ec.Scenario) -> ec.Result:
    with scenario.prepare() as simulation:
        return simulation.run()


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"algorithm": "strong", "output_interval": 1e-3},
        pytest.param({"isolate": ["*.observer"]}, marks=pytest.mark.slow),
    ],
    ids=str,
)
def test_a_run_ends_at_the_first_point_that_meets_the_condition(
    fmu_folder: Path, options: dict[str, Any]
) -> None:
    full_run = run(lift(fmu_folder, **{**options, "output_interval": 1e-4, "isolate": []}))
    row = int(np.argmax(full_run[SIGNAL] > LIMIT))
    assert 0 < row < len(full_run.time) - 1
    ended = run(lift(fmu_folder, stop_when=[CONDITION], **options))
    assert ended.problem is None and not ended.interrupted
    assert ended.stopped_when == "lift.plant.tau_m > 150"
    assert ended.end_s == ended.time[-1] == full_run.time[row] and ended.steps == row
    steps_per_row = round(options.get("output_interval", 1e-4) / 1e-4)
    rows = [*range(0, row, steps_per_row), row]
    for name in ("time", SIGNAL, "lift.observer.x_hat"):
        np.testing.assert_array_equal(ended[name], full_run[name][rows])
    assert ended.record["status"] == "completed"
    assert ended.record["stopped_when"] == {
        "condition": "lift.plant.tau_m > 150",
        "time_s": full_run.time[row],
    }
    assert any("because lift.plant.tau_m > 150 (--stop-when)" in remark for remark in ended.remarks)
    assert not ended.metrics["joints"]["lift"]["held"]


def test_error_control_ends_at_the_condition(fmu_folder: Path) -> None:
    condition = f"{SIGNAL} > 0,15 kN.m"  # the limit in another unit
    ended = run(lift(fmu_folder, stop_when=[condition], error_tolerance=1e-3, output_interval=1e-5))
    above = ended[SIGNAL] > LIMIT
    assert above[-1] and not above[:-1].any() and ended.end_s < STOP


def test_the_first_of_several_conditions_counts_and_others_change_nothing(fmu_folder: Path) -> None:
    with lift(fmu_folder).prepare() as simulation:
        full_run = simulation.run()
        never = simulation.run(stop_when=["lift.plant.x_L > 99"])
        first = simulation.run(stop_when=["lift.plant.x_L > 99", "lift.plant.x_L < 99", CONDITION])
        after = simulation.run()
    assert never.stopped_when is None and "stopped_when" not in never.record
    np.testing.assert_array_equal(full_run["lift.plant.x_L"], never["lift.plant.x_L"])
    assert (first.steps, first.end_s, first.stopped_when) == (0, 0.0, "lift.plant.x_L < 99")
    np.testing.assert_array_equal(full_run["lift.plant.x_L"], after["lift.plant.x_L"])


def test_run_in_single_steps_stays_at_its_end(fmu_folder: Path) -> None:
    with lift(fmu_folder, stop_when=[CONDITION]).prepare() as simulation:
        simulation.advance(0.01)
        reached, torque = simulation.time, simulation[SIGNAL]
        simulation.advance(reached)
        with pytest.raises(ec.CommandError, match=r"\(--stop-when\)\. It cannot continue; call `finish`"):
            simulation.advance(0.015)
        assert simulation.time == reached < 0.01 and simulation[SIGNAL] == torque > LIMIT
        assert simulation.finish().end_s == reached


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("lift.plant.x > 1", "there is no signal 'lift.plant.x' to stop at"),
        ("lift.plant.x_L", "the condition 'lift.plant.x_L' of stop_when is invalid"),
        ("lift.plant.x_L > nan", "stop_when is invalid"),
        ("1 < 2 < 3", "stop_when is invalid"),
        ("lift.plant.x_L > 3 s", "the condition on lift.plant.x_L has the units s and m"),
    ],
)
def test_wrong_conditions_are_refused(text: str, sentence: str, fmu_folder: Path) -> None:
    with (
        lift(fmu_folder, stop_when=[text]).prepare() as simulation,
        pytest.raises(ec.CommandError, match=sentence),
    ):
        simulation.run()


def test_command_and_record_show_the_condition(emla: Emla) -> None:
    process = emla(
        "run", "lift", "--no-plots", "--stop-time", "0.02", "--stop-when", CONDITION, "--output", "out"
    )
    assert process.exit_code == 0 and "because lift.plant.tau_m > 150" in process.output
    record = json.loads(Path("out/run.json").read_text())
    assert record["stopped_when"]["condition"] == "lift.plant.tau_m > 150"
    assert record["settings"]["stop_when"] == [CONDITION]
    rerun = emla("rerun", "out", "--no-plots")
    assert "to the last bit" in rerun.output


def test_variants_of_a_sweep_end_each_at_its_own_time(
    fmu_folder: Path, tmp_path: Path, on_one_cluster: None
) -> None:
    starts, condition = [0.2395, 0.24], "lift.plant.x_L > 0.2402"
    options = {"stop_time": STOP, "stop_when": [condition], "fmus": fmu_folder}
    swept = ec.sweep("lift", {"lift.plant.start.x_L": starts}, **options, output=tmp_path / "sweep")
    for start, end, problem in zip(starts, swept.variants["end_s"], swept.variants["problem"], strict=True):
        single_run = run(lift(fmu_folder, stop_when=[condition], set={"lift.plant.start.x_L": start}))
        assert end == single_run.end_s
        assert (f"because {condition}" in problem) == (single_run.stopped_when is not None)
    assert len(set(swept.variants["end_s"])) == 2


@pytest.mark.parametrize(
    "command",
    [
        ("linearize", "mine.toml", "--open", "lift.controller.u_q"),
        (
            "tune",
            "mine.toml",
            "--vary",
            "lift.controller.beta[1]=9:90",
            "--objective",
            "lift.position_error_m",
        ),
        ("size", "mine.toml"),
    ],
    ids=lambda command: command[0],
)
def test_commands_that_need_the_whole_run_refuse_a_condition(emla: Emla, command: tuple[str, ...]) -> None:
    text = f'system = "lift"\nstop_time = 0.5\nstop_when = ["{CONDITION}"]\n'
    Path("mine.toml").write_text(text, encoding="utf-8")
    result = emla(*command, "--output", "out")
    assert result.exit_code == 2, result.output
    assert f"emla {command[0]} needs the whole run; remove stop_when" in " ".join(result.stderr.split())
    assert not Path("out").exists()
