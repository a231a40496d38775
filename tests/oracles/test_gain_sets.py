"""RSBA's gains `damped` and `compensated` keep what they promise on the study, drives and machines.

The paper's errors are never exceeded, and joints are held with other parameters, noise and delay.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec
import pytest

import emla_cosim as ec
from emla_cosim.study.joints.schema import load_joint
from emla_cosim.study.paper import TABLE_VI, TABLE_VIII
from emla_cosim.study.systems import STUDY
from tests.support.joint_data import EMLAS
from tests.support.tiers import mostly_slow

JOINTS = STUDY
ERRORS = {
    ("study", "damped"): (0.4e-6, 2.3e-6, 0.2e-6),
    ("study", "compensated"): (0.06e-6, 2.1e-6, 1.0e-6),
    ("study-drive", "damped"): (0.45e-6, 2.3e-6, 0.4e-6),
    ("study-drive", "compensated"): (0.08e-6, 2.0e-6, 1.8e-6),
}
"""Largest position errors of lift, tilt and telescope in m, by scenario and gains."""
SLOWER = {"telescope.reference.move.duration[1]": 1.4156}
"""0.20 m/s: the study's 0.21 m/s are the telescope's limit, which any disturbance exceeds."""


@pytest.fixture(scope="module")
def compensated(fmu_folder: Path) -> Iterator[ec.Simulation]:
    """The study with the gains `compensated`."""
    with ec.load("study", gains="compensated", fmus=fmu_folder).prepare() as simulation:
        yield simulation


@pytest.fixture(scope="module")
def damped(fmu_folder: Path) -> Iterator[ec.Simulation]:
    """Realistic drives with the gains `damped`, which are the default."""
    with ec.load("study-drive", fmus=fmu_folder).prepare() as simulation:
        yield simulation


def joint_figures(simulation: ec.Simulation, **options: Any) -> Any:
    return simulation.run(recorders=[], **options).metrics["joints"]


def check_table_vi(figures: Mapping[str, Any]) -> None:
    for joint in JOINTS:
        assert figures[joint]["held"], figures[joint]["reason"]
        for name, value in msgspec.structs.asdict(TABLE_VI.cells["study", joint]["rsba"]).items():
            assert figures[joint][name] < value, (joint, name)


@pytest.mark.parametrize(("scenario", "gains"), ERRORS)
def test_errors_are_small(scenario: str, gains: str, fmu_folder: Path) -> None:
    with ec.load(scenario, gains=gains, fmus=fmu_folder).prepare() as simulation:
        figures = joint_figures(simulation, stop_time=5.0)
    for joint, most in zip(JOINTS, ERRORS[scenario, gains], strict=True):
        assert figures[joint]["held"], figures[joint]["reason"]
        assert figures[joint]["torque_peak_N_m"] <= EMLAS[joint].tau_max
        assert 0.5 * most < figures[joint]["position_error_m"] <= most
        assert figures[joint]["saturated_after_settling"] == 0.0
    if scenario == "study" or gains == "damped":
        check_table_vi(figures)


def scaled(factor: float, *names: str) -> dict[str, float]:
    """Return start values of all plants that are `factor` times those of the data sheets."""
    values = {}
    for path in names:
        table, _, name = path.rpartition(".")
        for joint in JOINTS:
            values[f"{joint}.plant.{table}.{name}"] = factor * getattr(EMLAS[joint], name)
    return values


def of_all(name: str, value: float) -> dict[str, float]:
    return {f"{joint}.{name}": value for joint in JOINTS}


def started(error: float) -> dict[str, float]:
    names = ("plant.start.x_L", "observer.start.x_hat")
    return {f"{joint}.{name}": load_joint(joint).reference.q_S + error for joint in JOINTS for name in names}


def stepping() -> dict[str, float]:
    """Return loads that step from -F to F."""
    values = of_all("disturbance.load.start[2]", 0.6) | of_all("disturbance.load.ramp", 1e-4)
    for joint in JOINTS:
        force = load_joint(joint).load.largest
        values |= {f"{joint}.disturbance.load.level[{i}]": f for i, f in ((1, -force), (2, force))}
    return values


INDUCTANCE = ("motor.L_d", "motor.L_q")
OF_COMPENSATED: dict[str, Mapping[str, float]] = {
    "20 mm behind": started(-0.02),
    "20 mm ahead": started(0.02),
    "L -50 %": scaled(0.5, *INDUCTANCE),
    "L +50 %": scaled(1.5, *INDUCTANCE),
    "R -50 %": scaled(0.5, "motor.R_s"),
    "R +50 %": scaled(1.5, "motor.R_s"),
    "friction -50 %": scaled(0.5, "motor.B_m"),
    "friction +50 %": scaled(1.5, "motor.B_m"),
    "u_max -30 %": scaled(0.7, "inverter.u_max"),
    "0.3 ms late": of_all("plant.inverter.delay", 3e-4),
    "load from -F to F": stepping(),
}


@pytest.mark.parametrize("name", OF_COMPENSATED)
def test_compensated_gains_hold_every_joint(name: str, compensated: ec.Simulation) -> None:
    figures = joint_figures(compensated, stop_time=2.0, set={**SLOWER, **OF_COMPENSATED[name]})
    for joint in JOINTS:
        assert figures[joint]["trip"] is None
        assert figures[joint]["held"]


def test_noise_of_1_um_makes_lift_and_tilt_chatter(compensated: ec.Simulation) -> None:
    """Errors stay small, but torque is a tenth of the time at a limit; tilt is just below the threshold."""
    figures = joint_figures(compensated, stop_time=2.0, set={**SLOWER, **of_all("plant.sensor.sigma", 1e-6)})
    for joint in JOINTS:
        assert figures[joint]["trip"] is None and figures[joint]["position_error_m"] < 1e-5
    assert figures["lift"]["held"] is False and figures["telescope"]["held"] is True
    assert 0.2 < figures["lift"]["oscillation"]["torque_ripple"] < 0.4
    for joint in ("lift", "tilt"):
        assert 0.05 < figures[joint]["saturated_after_settling"] < 0.2


def test_joints_without_enough_torque_trip(compensated: ec.Simulation) -> None:
    """With half the flux tilt's motor makes 64 N m, where its disturbance alone takes 124.

    The lift's is enough, but its loop is a limit cycle at full torque.
    """
    result = compensated.run(stop_time=2.0, set=scaled(0.5, "motor.Phi_PM"), recorders=[])
    figures = result.metrics["joints"]
    assert [figures[joint]["held"] for joint in JOINTS] == [False, False, True]
    assert figures["tilt"]["trip"]["signal"] == "tilt.plant.v_L"
    assert figures["lift"]["trip"] is None and figures["lift"]["oscillation"]["torque_swing_N_m"] > 150.0
    assert any(remark.startswith("tilt tripped on its speed at t = ") for remark in result.remarks)


OF_DAMPED: dict[str, Mapping[str, float]] = {
    "inertia -50 %": scaled(0.5, "motor.J_m", "screw.M_BS"),
    "inertia +50 %": scaled(1.5, "motor.J_m", "screw.M_BS"),
    "inductance -50 %": scaled(0.5, *INDUCTANCE),
    "inductance +50 %": scaled(1.5, *INDUCTANCE),
    "noise of 1 µm": of_all("plant.sensor.sigma", 1e-6),
    "delay of 0.3 ms": of_all("plant.inverter.delay", 3e-4),
}


@pytest.mark.parametrize("case", OF_DAMPED)
def test_damped_gains_hold_every_joint(case: str, damped: ec.Simulation) -> None:
    figures = joint_figures(damped, stop_time=2.0, set=OF_DAMPED[case])
    for joint in JOINTS:
        assert figures[joint]["held"], figures[joint]["reason"]
        torque_is_missing = (case, joint) == ("inertia +50 %", "tilt")  # d_2 alone needs more than tau_max
        if not torque_is_missing:
            assert figures[joint]["saturated_after_settling"] < 0.05
            assert figures[joint]["position_error_m"] < 15e-6


@pytest.mark.slow
@pytest.mark.parametrize("controller", ["rsba", "foc", "cac", "anatc"])
def test_noise_causes_no_drift(controller: str, fmu_folder: Path) -> None:
    """With a leakage of 1e-6, ANATC's weights make the telescope oscillate after 14 s."""
    with ec.load("study-drive", controller=controller, gains="damped", fmus=fmu_folder).prepare() as drive:
        figures = joint_figures(drive, stop_time=20.0, set=OF_DAMPED["noise of 1 µm"])
    for joint in JOINTS:
        assert figures[joint]["held"], figures[joint]["reason"]
        assert figures[joint]["oscillation"] is None


TRAJECTORY_LENGTH = 37.7  # s, the trajectory
MACHINES = [
    ("hdrm-coupled", 1.0),
    *((f"hdrm-{kind}", TRAJECTORY_LENGTH) for kind in ("replay", "coupled", "merged")),
]


@pytest.mark.parametrize(("scenario", "stop_time"), mostly_slow(MACHINES, MACHINES[:1]))
def test_joints_on_the_machine_beat_table_vi(scenario: str, stop_time: float, fmu_folder: Path) -> None:
    """With the gains of a joint alone, the telescope would oscillate: the machine adds inertia."""
    with ec.load(scenario, gains="damped", fmus=fmu_folder).prepare() as simulation:
        check_table_vi(joint_figures(simulation, stop_time=stop_time))


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["experiment-1", "experiment-2"])
def test_experiments_at_1_kHz_beat_table_viii(scenario: str, fmu_folder: Path) -> None:
    """Over the first cycle and the first step of the load, of eight cycles in all."""
    with ec.load(scenario, fmus=fmu_folder).prepare() as simulation:
        figures = joint_figures(simulation, stop_time=48.0)["prototype"]
    printed = TABLE_VIII.cells[scenario, "prototype"]["rsba"]
    assert figures["held"]
    assert figures["position_error_m"] < printed.position_error_m / 10.0
    assert figures["velocity_error_m_s"] < printed.velocity_error_m_s
    assert figures["convergence_time_s"] < printed.convergence_time_s
