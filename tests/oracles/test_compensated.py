"""What the compensated RSBA promises: the study, drives as they are, 1 kHz, and what it has to bear."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

import emla_cosim as ec
from emla_cosim.study.paper import TABLE_VI, TABLE_VIII
from emla_cosim.study.systems import STUDY
from tests.support.joint_data import EMLAS

JOINTS = tuple(STUDY)
POSITION = {"lift": 0.5e-6, "tilt": 2.5e-6, "telescope": 1.0e-6}
"""Largest position errors on the study in m."""
SLOWER = {"telescope.reference.move.duration[1]": 1.4156}
"""0.20 m/s: the study's 0.21 m/s are the telescope's limit, which whatever disturbs it crosses."""


@pytest.fixture(scope="module")
def study(fmu_folder: Path) -> Iterator[ec.Simulation]:
    with ec.load("study", gains="compensated", fmus=fmu_folder).prepare() as simulation:
        yield simulation


def test_the_study_is_within_its_marks_and_beats_every_cell_of_the_paper(study: ec.Simulation) -> None:
    figures = study.run(stop_time=10.0, recorders=[]).metrics["joints"]
    for joint in JOINTS:
        found, printed = figures[joint], TABLE_VI.cells["study", joint]["rsba"]
        assert found["held"]
        assert found["position_error_m"] <= POSITION[joint]
        for name, value in printed._asdict().items():
            assert found[name] < value, (joint, name)


def test_drives_as_they_are_stay_within_their_torque_and_away_from_limits(fmu_folder: Path) -> None:
    with ec.load("study-drive", gains="compensated", fmus=fmu_folder).prepare() as simulation:
        figures = simulation.run(recorders=[]).metrics["joints"]
    for joint in JOINTS:
        assert figures[joint]["held"]
        assert figures[joint]["position_error_m"] < 2.2e-6
        assert figures[joint]["torque_peak_N_m"] <= EMLAS[joint].tau_max
        assert figures[joint]["saturated_after_settling"] < 0.02


def scaled(attribute: str, name: str, factor: float) -> dict[str, float]:
    return {f"{joint}.{name}": factor * getattr(EMLAS[joint], attribute) for joint in JOINTS}


def of_all(name: str, value: float) -> dict[str, float]:
    return {f"{joint}.{name}": value for joint in JOINTS}


def started(error: float) -> dict[str, float]:
    places = ("plant.start.x_L", "observer.start.x_hat")
    return {f"{joint}.{place}": STUDY[joint].reference.q_S + error for joint in JOINTS for place in places}


def stepping() -> dict[str, float]:
    found = {}
    for joint in JOINTS:
        load, force = f"{joint}.disturbance.load", STUDY[joint].load.largest
        found |= {
            f"{load}.level[1]": -force,
            f"{load}.level[2]": force,
        }
        found |= {f"{load}.start[2]": 0.6, f"{load}.ramp": 1e-4}
    return found


BORNE: dict[str, Mapping[str, float]] = {
    "20 mm behind": started(-0.02),
    "20 mm ahead": started(0.02),
    "L -50 %": scaled("L_d", "plant.motor.L_d", 0.5) | scaled("L_q", "plant.motor.L_q", 0.5),
    "L +50 %": scaled("L_d", "plant.motor.L_d", 1.5) | scaled("L_q", "plant.motor.L_q", 1.5),
    "R -50 %": scaled("R_s", "plant.motor.R_s", 0.5),
    "R +50 %": scaled("R_s", "plant.motor.R_s", 1.5),
    "friction -50 %": scaled("B_m", "plant.motor.B_m", 0.5),
    "friction +50 %": scaled("B_m", "plant.motor.B_m", 1.5),
    "u_max -30 %": scaled("u_max", "plant.inverter.u_max", 0.7),
    "0.3 ms late": of_all("plant.inverter.delay", 3e-4),
    "load from -F to F": stepping(),
}


@pytest.mark.parametrize("name", BORNE)
def test_every_joint_holds(name: str, study: ec.Simulation) -> None:
    figures: Any = study.run(stop_time=2.0, set={**SLOWER, **BORNE[name]}, recorders=[]).metrics["joints"]
    for joint in JOINTS:
        assert figures[joint]["trip"] is None
        assert figures[joint]["held"]


def test_noise_of_1_µm_makes_lift_and_tilt_chatter(study: ec.Simulation) -> None:
    """Errors stay small, but torque is a tenth of the time at a limit. Tilt's is just below what is loud."""
    set_ = {**SLOWER, **of_all("plant.sensor.sigma", 1e-6)}
    figures: Any = study.run(stop_time=2.0, set=set_, recorders=[]).metrics["joints"]
    for joint in JOINTS:
        assert figures[joint]["trip"] is None and figures[joint]["position_error_m"] < 1e-5
    assert figures["lift"]["held"] is False and figures["telescope"]["held"] is True
    assert 0.2 < figures["lift"]["oscillation"]["torque_ripple"] < 0.4
    for joint in ("lift", "tilt"):
        assert 0.05 < figures[joint]["saturated_after_settling"] < 0.2


def test_what_physics_forbids_is_said_to_be_lost(study: ec.Simulation) -> None:
    """With half the flux tilt's motor makes 64 N m, where its disturbance alone takes 124.

    The lift's is enough, but its loop is a limit cycle at full torque.
    """
    result = study.run(stop_time=2.0, set=scaled("Phi_PM", "plant.motor.Phi_PM", 0.5), recorders=[])
    figures = result.metrics["joints"]
    assert [figures[joint]["held"] for joint in JOINTS] == [False, False, True]
    assert figures["tilt"]["trip"]["signal"] == "tilt.plant.v_L"
    assert figures["lift"]["trip"] is None and figures["lift"]["oscillation"]["torque_swing_N_m"] > 180.0
    assert any(remark.startswith("tilt tripped on its speed at t = ") for remark in result.remarks)


@pytest.mark.parametrize("scenario", ["experiment-1", "experiment-2"])
def test_at_1_kHz_with_a_sample_of_delay_the_paper_is_beaten(scenario: str, fmu_folder: Path) -> None:
    """Over the first cycle and the first step of the load, of eight cycles in all."""
    with ec.load(scenario, fmus=fmu_folder).prepare() as simulation:
        found = simulation.run(stop_time=48.0, recorders=[]).metrics["joints"]["prototype"]
    printed = TABLE_VIII.cells[scenario, "prototype"]["rsba"]
    assert found["held"]
    assert found["position_error_m"] < printed.position_error_m / 10.0
    assert found["velocity_error_m_s"] < printed.velocity_error_m_s
    assert found["convergence_time_s"] < printed.convergence_time_s
