"""Runs that trip or do not settle: this is reported first, and the exit code is 0."""

import json
import math
from pathlib import Path
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

import emla_cosim as ec
from emla_cosim.inputs.stored_runs import open_stored_run
from emla_cosim.study.metrics import JointMetrics
from tests.support.commands import Emla
from tests.support.joint_data import EMLAS

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


def test_trip_is_reported_first(emla: Emla, tmp_path: Path) -> None:
    every_row = ("--output-interval", "1e-4")
    result = emla("run", "tilt", *BELOW, "--stop-time", "0.5", *every_row, "--no-plots")
    assert result.exit_code == 0, result.output
    first, second = result.stdout.splitlines()[:2]
    assert first.startswith("tilt tripped on its speed at t = 0.03")
    assert first.endswith(" m/s, beyond 0.105 m/s (limit 0.1 m/s).")
    assert second.startswith("tilt has not settled: its position error was 9 mm at the start and was ")
    actual = tilt_of("results/tilt")
    trip, limit = actual["trip"], EMLAS["tilt"].v_max
    table = open_stored_run(tmp_path / "results/tilt/results.csv").read(["time", "tilt.plant.v_L"])
    row = np.flatnonzero(np.abs(table["tilt.plant.v_L"]) > 1.05 * limit)[0]
    assert (trip["signal"], trip["time_s"]) == ("tilt.plant.v_L", table["time"][row])
    assert trip["value"] == table["tilt.plant.v_L"][row]
    assert trip["threshold"] == pytest.approx(1.05 * limit) and trip["limit"] == limit
    assert actual["held"] is False and actual["settling_time_s"] is None
    cells = [[cell.strip() for cell in line.split("│")] for line in result.stdout.splitlines()]
    rows = {row[1]: row[2] for row in cells if len(row) > 2}
    assert rows["held"] == "no" and rows["settling time"] == "none"


def test_limits_are_those_of_the_run(emla: Emla) -> None:
    """A stroke that ends before the start is left at once."""
    run = ("run", "tilt", *BELOW, "--stop-time", "0.05", "--no-plots", "--output", "o")
    result = emla(*run, "--set", "tilt.plant.screw.q_UB=0.3")
    assert result.stdout.startswith("tilt tripped on its stroke at t = 0 s: tilt.plant.x_L = 0.38 m, beyond")
    trip = tilt_of("o")["trip"]
    assert (trip["signal"], trip["time_s"], trip["value"]) == ("tilt.plant.x_L", 0.0, 0.38)
    late = emla(*run, "--criterion", "tilt.over_speed=0.2")
    assert "beyond 0.12 m/s (limit 0.1 m/s)" in late.stdout


def test_touched_limit_is_reported_and_metrics_end_at_a_trip(fmu_folder: Path) -> None:
    """A speed 3 % beyond its limit, and one 7 % beyond, where drives trip at 5 %."""
    with ec.load("lift").prepare(fmus=fmu_folder, stop_time=1.0) as lift:
        # on the reference, as the approach is faster
        on = dict.fromkeys(["lift.plant.start.x_L", "lift.observer.start.x_hat"], lift["lift.reference.x_d"])
        well = lift.run(set=on, output_interval=1e-4)
        fastest = np.abs(well["lift.plant.v_L"]).max()
        touched = lift.run(set={**on, "lift.plant.screw.v_max": fastest / 1.03})
        tripped = lift.run(set={**on, "lift.plant.screw.v_max": fastest / 1.07})
    assert well.metrics["joints"]["lift"]["held"] is True and not well.remarks
    figures = touched.metrics["joints"]["lift"]
    (touch,) = figures["limits_touched"]
    assert figures["held"] is True and figures["trip"] is None
    assert abs(touch["value"]) == fastest and abs(touch["limit"]) == pytest.approx(fastest / 1.03)
    assert [remark.partition(",")[0] for remark in touched.remarks] == ["lift touched its speed limit"]
    after_trip = tripped.metrics["joints"]["lift"]
    time = after_trip["trip"]["time_s"]
    assert after_trip["held"] is False and after_trip["trip"]["signal"] == "lift.plant.v_L"
    assert [remark.partition(" at ")[0] for remark in tripped.remarks] == ["lift tripped on its speed"]
    assert after_trip["reason"] == tripped.remarks[0]
    # figures end at the trip
    error = np.abs(well["lift.plant.x_L"] - well["lift.reference.x_d"])
    counted = (well.time >= after_trip["evaluated_from_s"] - 1e-9) & (well.time <= time)
    assert after_trip["position_error_m"] == error[counted].max()
    assert after_trip["position_error_m"] < well.metrics["joints"]["lift"]["position_error_m"]
    torque = np.abs(well["lift.plant.tau_m"])
    assert after_trip["torque_peak_N_m"] == torque[well.time <= time].max()
    assert math.isnan(after_trip["following_error_rms_m"]) and math.isnan(after_trip["saturated_fraction"])


def test_published_gains_trip_every_joint(emla: Emla) -> None:
    result = emla("run", "published", "--stop-time", "2", "--no-plots", "--output", "o")
    assert result.exit_code == 0
    joints = json.loads(Path("o/metrics.json").read_text())["joints"]
    for joint, actual in joints.items():
        assert actual["held"] is False and actual["trip"] is not None
        assert actual["convergence_time_s"] is None
        assert f"{joint} tripped on its " in result.stdout
    table = result.stdout[result.stdout.index("│") :]
    assert " m " in table and "e+" not in table


@given(
    seed=st.integers(0, 10_000),
    size=st.floats(0.2, 2.0),
    cuts=st.lists(st.integers(1, 30), min_size=1, max_size=4),
)
def test_first_trip_does_not_depend_on_blocks_of_rows(seed: int, size: float, cuts: list[int]) -> None:
    random = np.random.default_rng(seed)
    rows = np.column_stack([np.arange(60) * 0.01, random.normal(size=(60, 7)) * size])
    rows[random.integers(0, 60), random.integers(1, 5)] = np.nan
    bounds, thresholds = np.array([1.0, 2.0, 3.0, 3.0]), np.array([1.001, 2.1, 3.3, 3.3])
    tripping = ~(np.abs(rows[:, 1:5]) <= thresholds)
    row, column_number = np.argwhere(tripping)[0]
    metrics, start = JointMetrics(NAMES, LIMITS), 0
    while start < len(rows):
        size_ = cuts[start % len(cuts)]
        metrics.write(rows[start : start + size_])
        start += size_
        restored = JointMetrics(NAMES, LIMITS)
        restored.load_state_dict(json.loads(json.dumps(metrics.state_dict())))
        metrics = restored
    figures = metrics.figures()["j"]
    trip = figures["trip"]
    assert (trip["signal"], trip["time_s"]) == (NAMES[column_number], rows[row, 0])
    assert np.array_equal(trip["value"], rows[row, 1 + column_number], equal_nan=True)
    assert abs(trip["limit"]) == bounds[column_number]
    before = np.abs(rows[:row, 1:5])
    expected = {NAMES[i]: before[:, i].max() for i in range(4) if (before[:, i] > bounds[i]).any()}
    assert {t["signal"]: abs(t["value"]) for t in figures["limits_touched"]} == expected
    assert figures["held"] is False


def test_nan_error_is_not_held() -> None:
    rows = np.zeros((5, 8))
    rows[:, 0] = np.arange(5) * 0.1
    rows[-1, 1] = np.nan
    metrics = JointMetrics(NAMES)
    metrics.write(rows)
    assert metrics.figures()["j"]["held"] is False
    assert metrics.figures()["j"]["reason"] == "j has no finite position error from t = 0.4 s on."


MOTOR = LIMITS | {
    "j.plant.motor.N_p": 4,
    "j.plant.motor.Phi_PM": 0.05,
    "j.plant.gearbox.rho": 0.5,
    "j.plant.gearbox.eta_GB": 0.8,
    "j.plant.screw.lead": 0.01,
}
"""A motor of 1.5 * 4 * 0.05 * 3 = 0.9 N m, and 0.5 * 0.01 / 2 pi / 0.8 m of torque per force."""

HOLDS = 0.9 * 2.0 * math.pi * 0.8 / (0.5 * 0.01)
"""The load in N that it can hold."""


def evaluate(load: float, speed: float, torque: float, **parameters: float) -> JointMetrics:
    """Metrics of a joint at rest, whose last row has another speed and torque."""
    rows = np.zeros((5, 9))
    rows[:, 0] = np.arange(5) * 0.1
    rows[:, 8] = load
    rows[-1, 2], rows[-1, 5] = speed, torque
    values = MOTOR | {f"j.plant.{name.replace('__', '.')}": value for name, value in parameters.items()}
    metrics = JointMetrics([*NAMES, "j.disturbance.F_L"], values)
    metrics.write(rows)
    return metrics


@pytest.mark.parametrize(
    ("factor", "directional", "is_cause"),
    [(0.99, 0.0, False), (1.01, 0.0, True), (-1.01, 0.0, True), (1.01, 1.0, False), (1.26, 1.0, True)],
)
def test_trip_names_a_load_beyond_the_motor(factor: float, directional: float, is_cause: bool) -> None:
    """With losses that oppose the motion there are none at rest, so the motor holds a quarter more."""
    metrics = evaluate(factor * HOLDS, 5.0, 0.0, gearbox__directional=directional)
    actual = metrics.figures()["j"]
    assert actual["trip"]["signal"] == "j.plant.v_L"
    assert bool(actual["trip"]["cause"]) is is_cause
    assert ("which makes 0.9 N m at the most." in actual["reason"]) is is_cause
    if is_cause:
        torque = abs(factor) * 0.9 * (0.8 if directional else 1.0)
        assert f"takes {torque:.4g} N m of the motor at rest" in actual["reason"]
    assert evaluate(factor * HOLDS, 0.0, 0.0).figures()["j"]["trip"] is None  # a load alone is not a trip


def test_ideal_drives_trip_on_the_demanded_torque() -> None:
    """Their currents say nothing; with a drive, the torque follows from currents, which trip."""
    for torque, trips in ((0.98, False), (1.0, True), (-1.0, True)):
        ideal = evaluate(0.0, 0.0, torque, use_commanded_current=1.0).figures()["j"]
        assert (ideal["trip"] is not None) is trips
        assert evaluate(0.0, 0.0, torque).figures()["j"]["trip"] is None
        if trips:
            assert ideal["trip"]["what"] == "demanded torque"
            assert ideal["trip"]["limit"] == pytest.approx(math.copysign(0.9, torque))
            assert ideal["reason"].startswith("j tripped on its demanded torque at t = 0.4 s")
        else:
            assert [touch["what"] for touch in ideal["limits_touched"]] == ["demanded torque"]
