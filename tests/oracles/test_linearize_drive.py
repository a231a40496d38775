"""Margins of a joint equal those of its equations, and frequency responses those of an injected sine."""

from pathlib import Path

import numpy as np
import pytest

import emla_cosim as ec
from emla_cosim.analyses.linearize.perturbation import choose_openings
from emla_cosim.analyses.linearize.response import compute_margins
from tests.support.linear_drive import CURRENT, POSITION, STEP, LinearDrive
from tests.support.tiers import mostly_slow

AT, DURATION = 0.35, 0.15
DELAY = {"lift.plant.inverter.delay": STEP}
GAINS = {"rsba": "compensated", "foc": "tuned", "cac": "tuned"}
OPENINGS = {
    POSITION: "lift.plant.x_measured -> lift.observer.y",
    CURRENT: "lift.controller.a_d -> lift.controller.i_q_ref",
}


def drive(controller: str, fmus: Path) -> LinearDrive:
    """Return the drive at its operating point."""
    options = {"gains": GAINS[controller], "set": DELAY, "stop_time": 0.5, "fmus": fmus}
    with ec.load("lift", controller=controller, **options).prepare() as simulation:
        simulation.advance(AT)
        v, i_q, i_d = (simulation[f"lift.plant.{n}"] for n in ("v_L", "i_q_measured", "i_d_measured"))
    return LinearDrive(controller, v, i_q, i_d)


@pytest.mark.parametrize("controller", mostly_slow(GAINS, ["rsba"]))
def test_loop_gain_of_a_joint_equals_its_equations(controller: str, fmu_folder: Path) -> None:
    openings = {k: v for k, v in OPENINGS.items() if controller != "cac" or k == POSITION}
    at = {"at": AT, "duration": DURATION, "stop_time": 0.5, "fmus": fmu_folder}
    options = {"controller": controller, "gains": GAINS[controller], "set": DELAY}
    result = ec.linearize("lift", open=list(openings.values()), **options, **at)
    expected = drive(controller, fmu_folder)
    for opened_at, name in openings.items():
        response, margins_of_tool = result[name], result.margins[name]
        right = expected.loop_gain(opened_at, response.frequency)
        assert np.abs(response.value / right - 1.0).max() < 0.02
        margins = compute_margins(response.frequency, right)
        assert margins_of_tool.phase_deg == pytest.approx(margins.phase_deg, abs=0.1)
        assert margins_of_tool.gain_up_dB == pytest.approx(margins.gain_up_dB, abs=0.05)
        assert margins_of_tool.gain_down_dB == pytest.approx(margins.gain_down_dB, abs=0.05)
        assert margins_of_tool.Ms == pytest.approx(margins.Ms, rel=0.01)
        if opened_at == POSITION:  # a pulse of metres saturates everything, and is linear only in itself
            assert result.responses[name].amplitude < 1e-5  # m


@pytest.mark.parametrize("controller", GAINS)
def test_gain_margins_at_the_measured_position_match_the_inertia(controller: str) -> None:
    """The viscous friction and the back-EMF, which do not change with the inertia, are small."""
    frequency = np.geomspace(20.0, 4999.0, 2000)
    loop = LinearDrive(controller, 0.05, 33.0, 0.0)
    margins = compute_margins(frequency, loop.loop_gain(POSITION, frequency))
    for margin in (margins.gain_up_dB, margins.gain_down_dB):
        limit = 10.0 ** (-margin / 20.0)
        assert LinearDrive(controller, 0.05, 33.0, 0.0, limit**0.9).is_stable()
        assert not LinearDrive(controller, 0.05, 33.0, 0.0, limit**1.1).is_stable()


@pytest.mark.parametrize("opened_at", OPENINGS)
def test_python_control_finds_the_same_margins(opened_at: str) -> None:
    control = pytest.importorskip("control", reason="python-control is not installed.")
    frequency = np.geomspace(20.0, 4999.0, 2000)
    L = LinearDrive("rsba", 0.05, 33.0, 0.0).loop_gain(opened_at, frequency)
    response = ec.FrequencyResponse(opened_at, frequency, L, np.zeros(len(L)), STEP, "1")
    gains, phases, distances, *_ = control.stability_margins(response.to_control(), returnall=True)
    margins = compute_margins(frequency, L)
    assert margins.phase_deg == pytest.approx(np.abs(phases).min(), abs=0.01)
    assert margins.gain_up_dB == pytest.approx(20.0 * np.log10(gains[gains > 1.0].min()), abs=0.01)
    down = gains[gains < 1.0]
    assert margins.gain_down_dB == pytest.approx(
        20.0 * np.log10(down.max()) if len(down) else -np.inf, abs=0.01
    )
    assert 1.0 / margins.Ms == pytest.approx(distances.min(), rel=1e-3)


PERIOD = 0.1  # s: whole periods of all frequencies
FREQUENCIES = (20.0, 50.0, 100.0, 190.0, 290.0, 500.0, 1000.0, 2000.0, 4000.0)
FORCE, POSITION_OUT = "lift.plant.F_L", "lift.plant.x_L"
OPTIONS = {"gains": "compensated", "set": DELAY}


@pytest.fixture(scope="module")
def compliance(fmu_folder: Path) -> ec.FrequencyResponse:
    """From the load to the position."""
    at = {"at": AT, "duration": DURATION, "stop_time": 0.5, "fmus": fmu_folder}
    result = ec.linearize("lift", perturb=FORCE, read=POSITION_OUT, **at, **OPTIONS)
    return result[f"{FORCE} to {POSITION_OUT}"]


@pytest.mark.parametrize("frequency", mostly_slow(FREQUENCIES, (50.0, 190.0, 1000.0)))
def test_injected_sine_has_the_same_gain_and_phase(
    compliance: ec.FrequencyResponse, frequency: float, fmu_folder: Path
) -> None:
    """Half the difference of two runs, whose sines have opposite signs; its transient ends before AT.

    A window keeps slow changes of the effect, with the joint's speed, from what is 1e-7 of them at high
    frequencies.
    """
    time = STEP * np.arange(round((AT + PERIOD) / STEP) + 1)
    wave = np.exp(2j * np.pi * frequency * time)
    height = 2e3  # N, of 57 kN
    up, down = (_move(time, 57e3 + part * height * wave.imag, fmu_folder) for part in (1.0, -1.0))
    periods = slice(round(AT / STEP), -1)
    effect, window = 0.5 * (up - down)[periods], 1.0 - np.cos(2.0 * np.pi * (time[periods] - AT) / PERIOD)
    gain = 2j * np.mean(effect * window * wave.conj()[periods]) / height
    expected = np.exp(np.interp(np.log(frequency), np.log(compliance.frequency), np.log(compliance.value)))
    assert abs(gain) == pytest.approx(abs(expected), rel=0.01)
    assert abs(np.degrees(np.angle(gain / expected))) < 1.0


def _move(time: np.ndarray, force: np.ndarray, fmus: Path) -> np.ndarray:
    """Return the position under a load force."""
    load = ec.Input(data={"time": time, "force": force}, signals={FORCE: "force"}, interpolation="held")
    scenario = ec.load("lift", stop_time=time[-1], input=[load], output_interval=STEP, fmus=fmus, **OPTIONS)
    return scenario.prepare().run()[POSITION_OUT]


@pytest.mark.slow
@pytest.mark.parametrize("joint", ["lift", "tilt", "telescope"])
def test_damped_gains_have_their_margins(joint: str, fmu_folder: Path) -> None:
    """Of the position loop and of the current loop, with one sample of computing delay."""
    loops = [joint, f"{joint}.controller.u_q -> {joint}.plant.u_q"]
    delay = {f"{joint}.plant.inverter.delay": STEP}
    at = {"at": 0.35, "duration": 0.15, "stop_time": 0.5, "fmus": fmu_folder}
    result = ec.linearize(joint, gains="damped", set=delay, open=loops, **at)
    assert len(result.margins) == 2
    for margins in result.margins.values():
        assert margins.phase_deg >= 30.0 and margins.Ms <= 2.2
        assert margins.gain_up_dB >= 6.0 and margins.gain_down_dB <= -6.0


SHORT_RUN = {"gains": "damped", "at": 0.3, "duration": 0.1, "stop_time": 0.4}


def test_joint_is_opened_at_its_current_reference_by_default(fmu_folder: Path) -> None:
    result = ec.linearize("lift", **SHORT_RUN, fmus=fmu_folder)
    assert list(result.margins) == [OPENINGS[CURRENT]]


def test_all_joints_are_opened_by_default() -> None:
    joints = ("lift", "tilt", "telescope")
    openings = choose_openings(ec.load("study").system)
    assert openings == [f"{j}.controller.a_d -> {j}.controller.i_q_ref" for j in joints]


def test_controller_without_current_reference_needs_a_place(fmu_folder: Path) -> None:
    with pytest.raises(ec.CommandError, match=r"without delay.*--open lift"):
        ec.linearize("lift", controller="cac", **SHORT_RUN, fmus=fmu_folder)
