"""Runs that leave the plant's ranges, or do not converge: said first, and never code 1 for that."""

import json
from pathlib import Path
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

import emla_cosim as ec
from emla_cosim.recorders.csv_file import read_csv
from emla_cosim.study.metrics import JointMetrics
from emla_fmu.parameters import EMLAS
from tests.support.commands import Emla
from tests.support.paths import FOREIGN_MAPPING

BELOW = ("--set", "tilt.plant.start.x_L=0.38", "--set", "tilt.observer.start.x_hat=0.38")
"""9 mm below the reference, whose approach needs more voltage than there is."""

NAMES = [f"j.{name}" for name in ("plant.x_L", "plant.v_L", "plant.i_q", "plant.i_d")]
NAMES += ["j.plant.tau_m", "j.reference.x_d", "j.reference.v_d"]
LIMITS = {
    "j.plant.screw.q_LB": -1.0,
    "j.plant.screw.q_UB": 1.0,
    "j.plant.screw.v_max": 2.0,
    "j.plant.motor.i_max": 3.0,
}


def tilt_of(folder: str) -> dict[str, Any]:
    text = Path(folder, "metrics.json").read_text()
    return json.loads(text, parse_constant=pytest.fail)["joints"]["tilt"]


def first_outside(folder: Path, limits: dict[str, tuple[float, float]]) -> tuple[str, float, float]:
    """Signal, time and value of the first row outside any range, by looking at the whole table."""
    table = read_csv(folder / "results.csv", ["time", *limits])
    found = []
    for place, (name, (low, high)) in enumerate(limits.items()):
        rows = np.flatnonzero((table[name] < low) | (table[name] > high))
        if len(rows):
            found.append((int(rows[0]), place, name))
    row, _, name = min(found)
    return name, float(table["time"][row]), float(table[name][row])


@pytest.mark.parametrize("flavour", ["native", "python"])
def test_a_run_that_leaves_its_ranges_says_so_first(
    emla: Emla, python_fmu_folder: Path, tmp_path: Path, flavour: str
) -> None:
    more = ("--flavour", "python", "--fmus", str(python_fmu_folder)) if flavour == "python" else ()
    stop = "0.5" if flavour == "native" else "0.31"
    result = emla(
        "run", "tilt", *BELOW, "--stop-time", stop, "--output-interval", "1e-4", "--no-plots", *more
    )
    assert result.exit_code == 0, result.output
    first, second = result.stdout.splitlines()[:2]
    assert first == (
        "tilt left its speed range at t = 0.0316 s: tilt.plant.v_L = 0.1002 m/s, not within -0.1 to 0.1 m/s."
    )
    assert second.startswith("tilt did not converge: its position error was 9 mm at the start and is ")
    tilt = EMLAS["tilt"]
    limits = {
        "tilt.plant.x_L": (tilt.q_LB, tilt.q_UB),
        "tilt.plant.v_L": (-tilt.v_max, tilt.v_max),
        "tilt.plant.i_q": (-tilt.i_range, tilt.i_range),
        "tilt.plant.i_d": (-tilt.i_range, tilt.i_range),
    }
    found = tilt_of("results/tilt")
    left = found["left_limits"]
    expected = first_outside(tmp_path / "results" / "tilt", limits)
    assert (left["signal"], left["time_s"], left["value"]) == expected
    assert (left["minimum"], left["maximum"]) == limits[left["signal"]]
    assert found["converged"] is False and found["convergence_time_s"] is None
    cells = [[cell.strip() for cell in line.split("│")] for line in result.stdout.splitlines()]
    rows = {row[1]: row[2] for row in cells if len(row) > 2}
    assert rows["converged"] == "no" and rows["convergence time"] == "none"


def test_limits_are_those_of_the_run(emla: Emla) -> None:
    """Wide ranges are not left; a stroke that ends before the start is left at once."""
    wide = [f"tilt.plant.{name}" for name in ("screw.v_max=1e9", "screw.q_UB=1e9", "motor.i_max=1e9")]
    run = ("run", "tilt", *BELOW, "--stop-time", "0.4", "--no-plots", "--output", "o")
    result = emla(*run, *(x for name in wide for x in ("--set", name)))
    assert result.stdout.startswith("tilt did not converge: ")
    assert tilt_of("o")["left_limits"] is None and tilt_of("o")["converged"] is False
    result = emla(*run, "--set", "tilt.plant.screw.q_UB=0.3")
    assert result.stdout.startswith(
        "tilt left its stroke range at t = 0 s: tilt.plant.x_L = 0.38 m, not within 0 to 0.3 m."
    )
    expected = {"signal": "tilt.plant.x_L", "time_s": 0.0, "value": 0.38, "minimum": 0.0, "maximum": 0.3}
    assert tilt_of("o")["left_limits"] == expected


def test_a_joint_that_left_its_range_and_came_back_has_not_converged(fmu_folder: Path) -> None:
    with ec.load("lift").prepare(fmus=fmu_folder, stop_time=0.5) as lift:
        well = lift.run()
        tight = lift.run(set={"lift.plant.screw.v_max": 0.05})
    assert well.metrics["joints"]["lift"]["converged"] is True and not well.remarks
    figures = tight.metrics["joints"]["lift"]
    assert figures["left_limits"]["signal"] == "lift.plant.v_L" and figures["converged"] is False
    assert [remark.partition(" at ")[0] for remark in tight.remarks] == ["lift left its speed range"]
    assert figures["position_error_m"] == well.metrics["joints"]["lift"]["position_error_m"]


def test_as_printed_nothing_converges_and_the_figures_can_be_read(emla: Emla) -> None:
    result = emla("run", "published", "--no-plots", "--output", "o")
    assert result.exit_code == 0
    joints = json.loads(Path("o/metrics.json").read_text())["joints"]
    for joint, found in joints.items():
        assert found["converged"] is False and found["left_limits"] is not None
        assert found["convergence_time_s"] is None
        assert f"{joint} did not converge" in result.stdout
    table = result.stdout[result.stdout.index("│") :]
    assert "2.654 m" in table and "e+" not in table


def test_what_was_left_survives_checkpoint_and_resume(emla: Emla) -> None:
    run = ("run", "tilt", *BELOW, "--no-plots")
    whole = emla(*run, "--stop-time", "0.4", "--output", "whole")
    for first in ("0.02", "0.35"):  # before it is left, and after
        begun = emla(*run, "--stop-time", first, "--checkpoint", "c", "--output", "parts")
        assert begun.exit_code == 0, begun.output
        went_on = emla(*run, "--stop-time", "0.4", "--resume", "c", "--output", "parts")
        assert went_on.stdout.splitlines()[:2] == whole.stdout.splitlines()[:2]
        assert tilt_of("parts") == tilt_of("whole")


def test_a_plant_without_such_parameters_has_no_ranges(emla: Emla, foreign_plant: Path) -> None:
    plant = ("--replace", f"lift.plant={foreign_plant}", "--mapping", f"lift.plant={FOREIGN_MAPPING}")
    result = emla("run", "lift", *plant, "--stop-time", "0.4", "--no-plots", "--output", "o")
    assert result.exit_code == 0, result.output
    assert json.loads(Path("o/metrics.json").read_text())["joints"]["lift"]["left_limits"] is None


@given(
    seed=st.integers(0, 10_000),
    size=st.floats(0.2, 2.0),
    cuts=st.lists(st.integers(1, 30), min_size=1, max_size=4),
)
def test_the_first_value_outside_is_found_however_rows_come(seed: int, size: float, cuts: list[int]) -> None:
    random = np.random.default_rng(seed)
    rows = np.column_stack([np.arange(60) * 0.01, random.normal(size=(60, 7)) * size])
    rows[random.integers(0, 60), random.integers(1, 5)] = np.nan
    bounds = [1.0, 2.0, 3.0, 3.0]
    outside = ~(np.abs(rows[:, 1:5]) <= bounds)
    row, place = np.argwhere(outside)[0]
    metrics, start = JointMetrics(NAMES, LIMITS), 0
    while start < len(rows):
        size_ = cuts[start % len(cuts)]
        metrics.write(rows[start : start + size_])
        start += size_
        again = JointMetrics(NAMES, LIMITS)
        again.remember(json.loads(json.dumps(metrics.memory())))
        metrics = again
    left = metrics.figures()["j"]["left_limits"]
    assert (left["signal"], left["time_s"]) == (NAMES[place], rows[row, 0])
    assert np.array_equal(left["value"], rows[row, 1 + place], equal_nan=True)
    assert left["maximum"] == -left["minimum"] == bounds[place]
    assert metrics.figures()["j"]["converged"] is False


def test_an_error_that_is_no_number_has_not_converged() -> None:
    rows = np.zeros((5, 8))
    rows[:, 0] = np.arange(5) * 0.1
    rows[-1, 1] = np.nan
    metrics = JointMetrics(NAMES)
    metrics.write(rows)
    assert metrics.figures()["j"]["converged"] is False
    metrics = JointMetrics(NAMES)
    metrics.write(rows[:-1])
    metrics.write(np.array([[0.4, *[0.0] * 7]]))
    assert metrics.figures()["j"]["converged"] is True
