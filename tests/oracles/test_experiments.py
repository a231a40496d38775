"""Experiments of the prototype have the published motion and load, and errors below Table VIII."""

from pathlib import Path

import numpy as np
import pytest

import emla_cosim as ec
from tests.support.scenario_runs import run_scenario

# Table VIII, column RSBA: position error m, speed error m/s, torque effort N m
TABLE_VIII = {"experiment-1": (8e-4, 2e-3, 35.0), "experiment-2": (8e-4, 2.5e-3, 35.0)}
# Section V
WAY_POINTS = (0.05, 0.1333, 0.2167, 0.30, 0.2375, 0.175, 0.1125, 0.05)
PEAK_SPEED = {"experiment-1": 0.026, "experiment-2": 0.030}
LEVELS = {
    "experiment-1": {(0, 40): 7e3, (40, 100): 20e3, (100, 200): 40e3, (200, 280): 60e3, (280, 320): 70e3},
    "experiment-2": {(0, 320): 70e3},
}
names = pytest.mark.parametrize("name", TABLE_VIII)


def simulate_sources(name: str, fmus: Path, stop_time: float, step_size: float) -> ec.Result:
    """What reference and disturbance of an experiment give by themselves."""
    joint = ec.load(name).system
    components = {
        f"prototype.{role}": model
        for role, model in (("reference", "Reference"), ("disturbance", "Disturbance"))
    }
    values = {f"{c}.{n}": x for c in components for n, x in joint.component(c).parameters.items()}
    system = ec.System.of(components, set=values)
    with ec.load(system, stop_time=stop_time, step_size=step_size, fmus=fmus).prepare() as simulation:
        return simulation.run(output_interval=step_size)


@names
def test_current_sensor_has_twelve_bits_over_its_range(name: str) -> None:
    """Its noise is a thousandth of the range, which extends to both sides."""
    plant = ec.load(name).system.component("prototype.plant").parameters
    assert plant["sensor.current.resolution"] == pytest.approx(2e3 * plant["sensor.current.sigma"] / 2**12)


@names
def test_reference_stops_at_way_points_and_repeats_after_40_s(name: str, fmu_folder: Path) -> None:
    result = simulate_sources(name, fmu_folder, 80.0, 0.01)
    x, v = (result[f"prototype.reference.{n}"] for n in ("x_d", "v_d"))
    rests = x[np.flatnonzero(v == 0.0)]
    stops = rests[np.flatnonzero(np.diff(rests, prepend=-1.0))]
    assert stops == pytest.approx([*WAY_POINTS, *WAY_POINTS[1:]])
    assert np.abs(v).max() == pytest.approx(PEAK_SPEED[name], rel=1e-4)
    assert x[4000:8000] == pytest.approx(x[:4000], abs=1e-9)


@names
def test_load_has_published_levels_and_a_ripple(name: str, fmu_folder: Path) -> None:
    result = simulate_sources(name, fmu_folder, 320.0, 1e-3)
    t, force = result["time"], result["prototype.disturbance.F_L"]
    for (begin, end), level in LEVELS[name].items():
        within = force[(t > begin + 0.5) & (t < end)]
        assert within.mean() == pytest.approx(level, rel=1e-3)
        assert np.ptp(within) == pytest.approx(5e3, rel=0.06)  # ten samples per period miss the peaks


@names
def test_errors_are_below_those_of_table_viii(name: str, fmu_folder: Path, tmp_path: Path) -> None:
    """The first moves; the heaviest load of experiment 1 comes with its own run."""
    loads = {"prototype.disturbance.load.level[1]": 70e3}
    result = run_scenario(ec.load(name), tmp_path, fmus=fmu_folder, stop_time=8.0, set=loads)
    figures = result.metrics["joints"]["prototype"]
    assert figures["held"]
    keys = ("position_error_m", "velocity_error_m_s", "torque_effort_N_m")
    assert all(0.0 < figures[key] < printed for key, printed in zip(keys, TABLE_VIII[name], strict=True))


def test_observer_and_controller_sample_at_1_khz_beside_a_plant_at_10_khz(fmu_folder: Path) -> None:
    with ec.load("experiment-2", fmus=fmu_folder, stop_time=0.0505).prepare() as simulation:
        result = simulation.run(output_interval=1e-4)
    for signal, rate in (("observer.x_hat", 10), ("controller.u_q", 10), ("plant.x_L", 1)):
        changed = np.flatnonzero(np.diff(result[f"prototype.{signal}"])) + 1
        assert changed.tolist() == list(range(rate, 506, rate))


def test_sampled_controller_uses_the_values_of_its_sample(fmu_folder: Path) -> None:
    """RSBA's reference of the current, (31) with all repairs, from the values of the same row."""
    with ec.load("prototype", gains="robust", fmus=fmu_folder, stop_time=2.0).prepare() as simulation:
        result = simulation.run(output_interval=1e-3)
    row = {n: result[f"prototype.{n}"][1500:] for n in ("reference.x_d", "observer.x_hat", "observer.v_hat")}
    late = {n: result[f"prototype.{n}"][1499:-1] for n in row}
    i_q_ref = result["prototype.controller.i_q_ref"][1500:]

    def unexplained(of: dict[str, np.ndarray]) -> float:
        """What is left of i_q* after a linear law of these values and of the reference's motion."""
        motion = [result[f"prototype.reference.{n}"][1500:] for n in ("v_d", "a_d")]
        columns = np.column_stack([of["observer.x_hat"] - of["reference.x_d"], of["observer.v_hat"], *motion])
        columns = np.column_stack([columns, np.ones(len(columns))])
        return float(np.abs(i_q_ref - columns @ np.linalg.lstsq(columns, i_q_ref, rcond=None)[0]).max())

    assert unexplained(row) < 1e-9 and unexplained(late) > 1e-3
