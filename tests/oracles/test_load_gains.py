"""The gains `compliant` of all controllers have their margins and load errors, also with another load.

Margins in this file are those of the conditions of `emla tune`, at the middle of each move.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

import emla_cosim as ec
from emla_cosim.analyses.linearize.response import LARGEST_MS, LEAST_GAIN_DB, LEAST_PHASE_DEG
from emla_cosim.analyses.linearize.result import MeasuredResponse
from emla_cosim.analyses.linearize.runner import measure_loops
from emla_cosim.study.joints.schema import load_joint
from emla_cosim.study.systems import STUDY
from tests.support.tiers import mostly_slow

CONTROLLERS = ("rsba", "foc", "cac", "anatc")
LOAD_ERRORS: Mapping[str, tuple[float, float, float]] = {
    "rsba": (3.1e-6, 5.2e-6, 4.4e-6),
    "foc": (2.8e-6, 4.9e-6, 2.9e-6),
    "cac": (2.9e-6, 5.5e-6, 9.4e-6),
    "anatc": (2.7e-6, 13.2e-6, 9.9e-6),
}
"""Largest errors of the loads of lift, tilt and telescope in m, with the seeds of the scenario."""
MIDDLE = {"lift": 0.4, "tilt": 0.6, "telescope": 0.67}
"""Time of the operating point of margins, s."""
OTHER_LOADS = {
    "stiffness -30 %": (0.7, 1.0),
    "stiffness +30 %": (1.3, 1.0),
    "load mass -50 %": (1.0, 0.5),
    "load mass +50 %": (1.0, 1.5),
}


@pytest.fixture(scope="module", params=CONTROLLERS)
def simulation(request: Any, fmu_folder: Path) -> Iterator[tuple[str, ec.Simulation]]:
    with ec.load("study-compliant", controller=request.param, fmus=fmu_folder).prepare() as prepared:
        yield request.param, prepared


def other_load(stiffness: float, mass: float) -> dict[str, float]:
    """Return start values of loads at rest with other stiffnesses and masses, relative to the joint files."""
    values = dict[str, float]()
    for joint in STUDY:
        file = load_joint(joint)
        plant, deflection = f"{joint}.plant", file.load.level[0] / (stiffness * file.compliant_load.stiffness)
        half_play = 0.5 * file.compliant_load.backlash
        values |= {
            f"{plant}.transmission.stiffness": stiffness * file.compliant_load.stiffness,
            f"{plant}.load.m": mass * file.compliant_load.mass,
            f"{plant}.start.deflection": deflection + (half_play if deflection > 0.0 else -half_play),
        }
    return values


def test_errors_at_the_load_are_small(simulation: tuple[str, ec.Simulation]) -> None:
    controller, prepared = simulation
    metrics = prepared.run(stop_time=3.0, recorders=[]).metrics
    for joint, largest in zip(STUDY, LOAD_ERRORS[controller], strict=True):
        assert metrics["joints"][joint]["held"], metrics["joints"][joint]["reason"]
        assert 0.5 * largest < metrics["loads"][joint]["load_position_error_m"] <= largest


@pytest.mark.parametrize("load", OTHER_LOADS)
def test_joints_with_another_load_are_held(load: str, simulation: tuple[str, ec.Simulation]) -> None:
    figures = simulation[1].run(stop_time=1.5, set=other_load(*OTHER_LOADS[load]), recorders=[]).metrics
    for joint in STUDY:
        assert figures["joints"][joint]["held"], figures["joints"][joint]["reason"]


def test_joints_with_noise_are_held(simulation: tuple[str, ec.Simulation]) -> None:
    noise = {f"{joint}.plant.sensor.sigma": 1e-6 for joint in STUDY}
    slower = {"telescope.reference.move.duration[1]": 1.4156}  # 0.20 m/s: noise exceeds the limit of 0.21
    figures = simulation[1].run(stop_time=1.5, set=noise | slower, recorders=[]).metrics["joints"]
    for joint in STUDY:
        assert figures[joint]["held"], figures[joint]["reason"]
        assert figures[joint]["saturated_after_settling"] <= 0.05


LOADS = {"as in the file": (1.0, 1.0), **OTHER_LOADS}
CASES = [
    (controller, joint, load, control)
    for control in ("motor", "sensor")
    for load in LOADS
    for joint in STUDY
    for controller in CONTROLLERS
]
IN_SHORT = [("rsba", "telescope", "load mass +50 %", "motor")]
"""Loops with little margin."""


@pytest.mark.parametrize(("controller", "joint", "load", "control"), mostly_slow(CASES, IN_SHORT))
def test_loops_have_margins(controller: str, joint: str, load: str, control: str, fmu_folder: Path) -> None:
    scenario = ec.load("study-compliant", controller=controller, load_control=control, fmus=fmu_folder)
    loops = [joint, f"{joint}.controller.u_q->{joint}.plant.u_q"]
    measured = measure_loops(scenario, loops, MIDDLE[joint], 0.15, other_load(*LOADS[load]))
    for loop in loops:
        result = measured[loop]
        assert isinstance(result, MeasuredResponse) and result.margins is not None, result
        margins = result.margins
        assert margins.phase_deg >= LEAST_PHASE_DEG and margins.Ms <= LARGEST_MS
        assert margins.gain_up_dB >= LEAST_GAIN_DB and margins.gain_down_dB <= -LEAST_GAIN_DB


@pytest.mark.slow
def test_lift_with_a_load_sensor_is_held_with_another_mass_and_stiffness(fmu_folder: Path) -> None:
    # the least damped of all loads: with the default feedback, it oscillates at rest
    scenario = ec.load("study-compliant", load_control="sensor", fmus=fmu_folder)
    with scenario.prepare() as prepared:
        result = prepared.run(stop_time=10.0, set=other_load(1.3, 0.5), recorders=[])
    figures = result.metrics["joints"]["lift"]
    assert figures["held"], figures["reason"]
