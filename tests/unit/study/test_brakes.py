"""Holding brakes of joints: hold phases without current, no wind-up, metrics, and messages."""

import json
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import emla_cosim as ec

LIFT = (files("emla_cosim.study") / "joints" / "lift.toml").read_text(encoding="utf-8")
QUIET = {"arm.disturbance.d_2.amplitude[*]": 0.0}
START, END, ENGAGE, RELEASE = 0.7, 1.1, 0.05, 0.1
PHASE = f"[brake]\ntorque = '60 N m'\nphases = [['{START} s', '{END} s']]\n"


@pytest.fixture
def arm(tmp_path: Path) -> Callable[..., ec.Scenario]:
    """Return a function that loads a joint with a brake; its move ends at 0.803 s, or sooner."""

    def load(brake: str = PHASE, duration: str = "0.6 s", **options: Any) -> ec.Scenario:
        path = tmp_path / "arm.toml"
        text = LIFT.replace("v_peak = 0.0607  # m/s, Table II, v_E", f"duration = '{duration}'")
        path.write_text(f"{text}\n{brake}", encoding="utf-8")
        return ec.load(str(path), **{"stop_time": 1.3, "set": QUIET, **options})

    return load


def run(scenario: ec.Scenario, folder: Path, names: tuple[str, ...]) -> tuple[dict[str, Any], Any]:
    with scenario.prepare(fmus=folder, output_interval=1e-3) as simulation:
        result = simulation.run()
        return {n: np.asarray(x) for n, x in result.read(["time", *names]).items()}, result


SIGNALS = ("arm.plant.x_L", "arm.plant.i_q", "arm.plant.P_el", "arm.plant.brake.tau", "arm.plant.brake.slip")


@pytest.mark.parametrize("controller", ["rsba", "foc", "cac", "anatc"])
def test_joint_is_held_without_current(
    controller: str, arm: Callable[..., ec.Scenario], fmu_folder: Path
) -> None:
    """The brake takes the load, and gives it back to the drive before it opens."""
    signals, result = run(arm(controller=controller), fmu_folder, SIGNALS)
    t, x_L, i_q, P_el, tau, slip = (signals[name] for name in ("time", *SIGNALS))
    off = (t > START + ENGAGE + 0.2) & (t < END - RELEASE)
    assert np.abs(i_q[off]).max() < 1e-3 and not P_el[off].any()
    static = 57e3 / (0.9 * 2.0 * np.pi * 7.0 / 0.02)
    assert np.abs(tau[off]) == pytest.approx(static, rel=0.1)  # the load has a ripple
    assert not slip.any()
    assert np.abs(x_L[t > START] - 0.27).max() < 2e-5
    figures = result.metrics["brakes"]["arm"]
    assert figures["release_error_m"] < 1e-5
    assert figures["hold_time_s"] == pytest.approx(END - START, abs=1e-3)
    holding_currents = i_q[(t > 1.2) & (t < 1.3)]
    assert figures["hold_copper_loss_J"] < 0.5 * 1.5 * 0.14 * np.mean(holding_currents**2) * (END - START)


def test_weak_brake_slips_and_moving_reference_is_reported(
    arm: Callable[..., ec.Scenario], fmu_folder: Path
) -> None:
    weak = PHASE.replace("60 N m", "20 N m")
    _, result = run(arm(weak, duration="1.2 s", stop_time=1.0), fmu_folder, ())
    figures = result.metrics["brakes"]["arm"]
    assert figures["brake_slip_m"] > 1e-4 and np.isnan(figures["release_error_m"])
    remarks = " ".join(result.remarks)
    assert "arm: its brake slipped by" in remarks and "its reference moves while the brake holds" in remarks


def test_joint_without_phase_is_that_without_brake(arm: Callable[..., ec.Scenario], fmu_folder: Path) -> None:
    """The bits of the joint do not change before the first phase."""
    late = PHASE.replace(f"'{START} s', '{END} s'", "'5 s', '6 s'")
    names = ("arm.plant.x_L", "arm.plant.i_q", "arm.controller.u_q")
    with_brake, _ = run(arm(late, stop_time=0.2), fmu_folder, names)
    without, result = run(arm("", stop_time=0.2), fmu_folder, names)
    assert all(np.array_equal(with_brake[name], without[name]) for name in names)
    assert "brakes" not in result.metrics


@pytest.mark.parametrize(
    ("brake", "message"),
    [
        ("[brake]\ntorque = 60.0\nphases = []\n", "1 to 8"),
        (
            "[brake]\ntorque = 60.0\nphases = [[1.0, 1.1]]\n",
            "longer than engage_delay and release_delay together, 0.15 s",
        ),
        (
            "[brake]\ntorque = 60.0\nphases = [[2.0, 3.0], [1.0, 1.5]]\n",
            "before the previous one ends at 3 s",
        ),
        ("[brake]\ntorque = 0.0\nphases = [[2.0, 3.0]]\n", "torque"),
        ("[brake]\ntorque = 60.0\n", "phases"),
    ],
)
def test_wrong_tables(brake: str, message: str, arm: Callable[..., ec.Scenario]) -> None:
    with pytest.raises(ec.CommandError, match=message):
        arm(brake)


def test_metrics_continue_from_their_memory() -> None:
    """Figures of a run in two parts are those of one run."""
    from emla_cosim.study.brakes import BrakeMetrics

    def metrics() -> BrakeMetrics:
        return BrakeMetrics(["arm"], [[1, 2, 3, 4, 5, 6, 7]], [60.0], [0.1])

    text = "0 0 0 .5 .5 2 0 0; .1 1 0 .5 .5 2 1 0; .2 1 1 .5 .4 2 1 1e-3; .3 0 0 .5 .4 3 0 2e-3"
    rows = np.array([row.split() for row in text.split(";")], dtype=float)
    uninterrupted, first, second = metrics(), metrics(), metrics()
    uninterrupted.write(rows)
    first.write(rows[:2])
    second.load_state_dict(json.loads(json.dumps(first.state_dict())))
    second.write(rows[2:])
    assert second.figures() == uninterrupted.figures() and second.remarks() == uninterrupted.remarks()
    (figures,) = uninterrupted.figures().values()
    expected = {"hold_time_s": 0.2, "hold_copper_loss_J": 0.15 * 0.1 * (5.0 + 9.0), "brake_slip_m": 2e-3}
    assert figures == pytest.approx({**expected, "release_error_m": 0.1})
