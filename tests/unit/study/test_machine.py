"""Three joints on one machine: Table VI holds, and motion and forces agree."""

import hashlib
import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

import emla_cosim as ec
from emla_cosim.run.simulation import Simulation
from emla_cosim.study.figures import JOINT_FIGURES
from emla_cosim.study.joints.schema import load_joint
from emla_cosim.study.loading import load
from emla_cosim.study.paper import TABLE_VI
from emla_cosim.study.roles import find_tracked_joints, find_variable
from machine_fmu.spline import DEFAULT_FILE, default_spline
from tests.support.commands import Emla
from tests.support.coupled_machine import column, positions
from tests.support.hdrm_runs import JOINTS
from tests.support.reference_manipulator import LAGRANGIAN
from tests.support.tiers import mostly_slow


@pytest.fixture(scope="module")
def prepared(fmu_folder: Path) -> Iterator[Callable[[str], Simulation]]:
    """The systems of the machine, each prepared once."""
    with ExitStack() as stack:
        yield cache(lambda name: stack.enter_context(load(name).prepare(fmus=fmu_folder)))


@pytest.fixture(scope="module")
def coupled(prepared: Callable[[str], Simulation]) -> Simulation:
    return prepared("hdrm-coupled")


@pytest.fixture(scope="module")
def merged(prepared: Callable[[str], Simulation]) -> Simulation:
    return prepared("hdrm-merged")


# ---- Table VI ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("scenario", "stop_time"),
    mostly_slow(
        [("hdrm-replay", 1.0), ("hdrm-coupled", 1.0), ("hdrm-replay", 37.7), ("hdrm-coupled", 37.7)],
        [("hdrm-replay", 1.0), ("hdrm-coupled", 1.0)],
    ),
)
def test_table_vi_holds(scenario: str, stop_time: float, prepared: Callable[[str], Simulation]) -> None:
    """The whole trajectory ends with 0.21 m/s, the limit of the telescope: no joint trips on it."""
    result = prepared(scenario).run(stop_time=stop_time)
    check_table_vi(result)
    check_forces(scenario, result)


@pytest.mark.slow
def test_robust_gains_keep_table_vi(fmu_folder: Path) -> None:
    with load("hdrm-coupled", gains="robust").prepare(fmus=fmu_folder, stop_time=3.0) as robust:
        check_table_vi(robust.run())


def check_table_vi(result: ec.Result) -> None:
    for joint in JOINTS:
        printed, actual = TABLE_VI.cells["study", joint]["rsba"], result.metrics["joints"][joint]
        for name, limit in msgspec.structs.asdict(printed).items():
            assert 0.0 < actual[name] < limit, (joint, name)
        assert actual["held"] and actual["saturated_after_settling"] == 0.0


# ---- forces and wiring -------------------------------------------------------------------------


def check_forces(scenario: str, result: ec.Result) -> None:
    """Load forces are those of the trajectory in replay, of the plants' own motion where they are coupled."""
    rows = np.linspace(0, len(result.time) - 1, 40).astype(int)
    forces = column(result, "F_L")[rows]
    if scenario == "hdrm-replay":
        spline = default_spline()
        motion = [spline.evaluated(result.time[rows], order) for order in range(3)]
        assert column(result, "x_d")[rows] == pytest.approx(motion[0], abs=1e-12)
    else:
        motion = [column(result, role)[rows] for role in ("x_L", "v_L", "a_L")]
    expected = [LAGRANGIAN.forces(q, v, a, 470.0) for q, v, a in zip(*motion, strict=True)]
    # coupled: the signals of one row agree to this; plants see a disturbance later than others
    error = np.abs(forces - np.array(expected)) / np.abs(forces).max(axis=0)
    assert error.max() < (1e-9 if scenario == "hdrm-replay" else 1e-6)


def test_three_values_close_the_loop(coupled: Simulation) -> None:
    result = coupled.run(stop_time=1e-3)
    (loop,) = result.record["stepping"]["loops"]
    assert sorted(loop) == sorted([*(f"{joint}.plant" for joint in JOINTS), "machine.manipulator"])


# ---- agreement with the merged plant -----------------------------------------------------------


@pytest.mark.parametrize(
    ("extrapolation", "quiet", "order"), [("none", False, 1.0), ("fmu", False, 1.0), ("fmu", True, 2.0)]
)
def test_coupled_converges_to_merged(
    coupled: Simulation, merged: Simulation, extrapolation: str, quiet: bool, order: float
) -> None:
    """To the second order where inputs are followed and no disturbance makes accelerations jump."""
    reference = positions(merged, 64, extrapolation, quiet)
    errors = [
        np.abs(positions(coupled, parts, extrapolation, quiet) - reference).max(axis=0) for parts in (1, 2, 4)
    ]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.abs(orders - order).max() < 0.35, orders
    assert (errors[-1] < 0.02 * np.ptp(reference, axis=0)).all()


@pytest.mark.parametrize("algorithm", ["jacobi", "gauss-seidel"])
def test_divergence_of_late_forces_is_explained(coupled: Simulation, algorithm: str) -> None:
    for step in (1e-4, 2.5e-5):
        result = coupled.attempt(algorithm=algorithm, step_size=step, stop_time=0.1)
        assert result.end_s < 0.01
        message = str(result.problem)
        assert "telescope.plant.a_L" in message and "machine.manipulator.F_L[3]" in message
        assert "controller" not in message
        assert "spectral radius" in message and "Use the algorithm strong" in message


# ---- roles -------------------------------------------------------------------------------------


def test_pictures_and_metrics_of_the_merged_system(merged: Simulation) -> None:
    result = merged.run(stop_time=0.5, output_interval=1e-4)
    assert set(result.metrics["joints"]) == set(JOINTS)
    for picture in JOINT_FIGURES.values():
        signals = {name for panel in picture.panels for curve in panel.curves for name in curve.names}
        for signal in signals - {"P_L", "x_load", "v_load"}:  # the motor alone has no load
            for i, joint in enumerate(JOINTS, 1):
                name = find_variable(joint, signal, result.names, result.roles)
                assert name is not None and (name.startswith(f"{joint}.") or name.endswith(f"[{i}]"))
    errors = {joint: result.metrics["joints"][joint]["position_error_m"] for joint in JOINTS}
    late = result.time >= 0.3
    actual = np.abs(column(result, "x_L") - column(result, "x_d"))[late].max(axis=0)
    assert actual == pytest.approx(list(errors.values()), rel=1e-9)
    assert find_variable("tilt", "tau_m", result.names) == "tilt.motor.tau_m"
    tracked = find_tracked_joints(result.names, result.roles)["tilt"]
    assert tracked == ("machine.plant.x_L[2]", "machine.trajectory.x_d[2]")


def test_merged_plant_trips(merged: Simulation) -> None:
    result = merged.run(stop_time=0.05, set={"machine.plant.screw.v_max[2]": 0.01})
    trip = result.metrics["joints"]["tilt"]["trip"]
    assert trip["signal"] == "machine.plant.v_L[2]" and abs(trip["limit"]) == 0.01
    (remark,) = (text for text in result.remarks if text.startswith("tilt tripped on its speed"))
    assert "machine.plant.v_L[2]" in remark
    assert result.metrics["joints"]["lift"]["trip"] is None


# ---- trajectories from files -------------------------------------------------------------------


def shifted(by: float) -> dict[str, Any]:
    content = json.loads(DEFAULT_FILE.read_text())
    content["coefficients"]["lift"] = [x + by for x in content["coefficients"]["lift"]]
    return content


def test_trajectory_of_a_file_and_its_hash(emla: Emla, tmp_path: Path) -> None:
    path = tmp_path / "mine.json"
    path.write_text(json.dumps(shifted(0.01)))
    result = emla("run", "hdrm-replay", "--trajectory", "mine.json", "--stop-time", "0.01", "--no-plots")
    assert result.exit_code == 0, result.output
    record = json.loads(Path("results/hdrm-replay/run.json").read_text())
    digest = hashlib.sha256(path.read_bytes()).hexdigest()
    assert record["settings"]["trajectory"] == {"file": "mine.json", "sha256": digest}
    parameters = record["components"]["machine.trajectory"]["parameters"]
    assert parameters["coefficient.lift[1]"] == pytest.approx(0.254)
    assert record["components"]["lift.plant"]["parameters"]["start.x_L"] == pytest.approx(0.25)


def test_trajectory_path_is_relative_to_the_scenario_file(tmp_path: Path) -> None:
    folder = tmp_path / "deep"
    folder.mkdir()
    (folder / "t.json").write_text(json.dumps(shifted(0.02)))
    scenario = folder / "mine.toml"
    scenario.write_text('system = "hdrm-merged"\ntrajectory = "t.json"\n')
    start = load(scenario).system.component("machine.plant").parameters["start.x_L[1]"]
    assert start == pytest.approx(load_joint("lift").start.x_L + 0.02)


KNOTS = [0.0, *np.linspace(0.0, 1.0, 60).tolist(), 1.0]
LONG = json.dumps({"degree": 1, "knots": KNOTS, "coefficients": dict.fromkeys(JOINTS, 60 * [0.3])})
"""A trajectory with more knots than the FMU has room for."""


@pytest.mark.parametrize(
    ("scenario", "text", "sentence"),
    [
        ("hdrm-replay", None, "the trajectory 't.json' cannot be read: No such file or directory."),
        ("hdrm-merged", "{", "the trajectory 't.json' is not JSON: "),
        ("hdrm-coupled", '{"degree": 5}', "the trajectory 't.json' cannot be used: it lacks 'knots'; "),
        ("hdrm-replay", LONG, "the trajectory 't.json' "),
        ("study", "{}", "'study' does not follow a trajectory; --trajectory is for machine files, and for"),
    ],
)
def test_invalid_trajectory(scenario: str, text: str | None, sentence: str, tmp_path: Path) -> None:
    path = tmp_path / "t.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(ec.CommandError) as caught:
        load(scenario, trajectory=path)
    assert str(caught.value).replace(f"{tmp_path}/", "").startswith(sentence)


# ---- faults ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "fault", "payload"),
    [("coupled", "manipulator.payload.m=constant:0", 0.0), ("merged", "plant.payload.m=gain:2", 940.0)],
)
def test_dropped_or_doubled_payload_is_held(name: str, fault: str, payload: float, fmu_folder: Path) -> None:
    scenario = load(f"hdrm-{name}", fault=[f"machine.{fault}@0.6"])
    with scenario.prepare(fmus=fmu_folder, stop_time=1.0) as simulation:
        result = simulation.run()
    assert result.metrics["joints"]["telescope"]["position_error_m"] < 2.5e-4
    static = LAGRANGIAN.forces(column(result, "x_d")[-1], [0.0] * 3, [0.0] * 3, payload)
    mean = column(result, "F_L")[result.time > 0.7].mean(axis=0)
    assert mean == pytest.approx(static, rel=0.05, abs=300.0)
