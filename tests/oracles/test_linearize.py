"""Frequency responses and margins equal closed forms."""

import re
from pathlib import Path

import numpy as np
import pytest

import emla_cosim as ec
from emla_cosim.analyses.linearize.response import compute_margins
from emla_cosim.fmu.file import FmuFile
from fmublock import DiscreteState
from tests.support.state_feedback import STEP, WIRES, MatrixCart, MatrixGain


class LinearizedCart(MatrixCart):
    """The mass for co-simulation."""


class LinearizedGain(MatrixGain):
    """The state feedback for co-simulation, which a discrete state makes the only kind."""

    before = DiscreteState(0.0)

    def update(self, v):
        return {"before": v.position}


def closed() -> ec.System:
    return ec.System.of({"cart": LinearizedCart, "gain": LinearizedGain}, WIRES)


def loop_gain(frequency: np.ndarray, step: float = STEP) -> np.ndarray:
    """L of the sampled double integrator with a zero-order hold, and state feedback."""
    z = np.exp(2j * np.pi * frequency * step)
    position = step**2 / 2.0 * (z + 1.0) / (z - 1.0) ** 2
    return 4.0 * position + 4.0 * step / (z - 1.0)


OPTIONS = {"stop_time": 20.0, "step_size": STEP, "at": 2.0, "duration": 15.0}


@pytest.mark.parametrize("opening", ["gain.force->cart.force", "gain.feed->gain.force"])
def test_loop_gain_equals_that_of_the_sampled_system(opening: str) -> None:
    result = ec.linearize(closed(), open=opening, **OPTIONS)
    (response,) = (m.response for m in result.responses.values())
    expected = loop_gain(response.frequency)
    assert np.abs(response.value / expected - 1.0).max() < 1e-2
    margins, right = next(iter(result.margins.values())), compute_margins(response.frequency, expected)
    assert margins.phase_deg == pytest.approx(right.phase_deg, abs=0.1)
    assert margins.Ms == pytest.approx(right.Ms, rel=1e-2)
    assert result.rolled_back


def test_half_the_step_changes_margins_as_the_hold_does() -> None:
    """The hold costs a phase of half a step at the crossover; a remark suggests a step for 2 %."""
    step = 0.04
    options = {**OPTIONS, "open": "gain.force->cart.force", "step_size": step}
    system = ec.System.of({"cart": LinearizedCart, "gain": MatrixGain}, WIRES)
    result = ec.linearize(system, **options)
    (measured,) = result.responses.values()
    frequency = np.geomspace(0.05, 5.0, 5000)
    expected, expected_at_half = (
        compute_margins(frequency, loop_gain(frequency, h)) for h in (step, 0.5 * step)
    )
    margins, at_half_step = measured.margins, measured.margins_at_half_step
    assert margins is not None and at_half_step is not None and measured.step_change is not None
    assert at_half_step.phase_deg - margins.phase_deg == pytest.approx(
        expected_at_half.phase_deg - expected.phase_deg, rel=0.05
    )
    assert at_half_step.phase_at - margins.phase_at == pytest.approx(
        expected_at_half.phase_at - expected.phase_at, abs=2e-3
    )
    assert at_half_step.phase_deg - margins.phase_deg > 2.0
    (remark,) = result.remarks
    assert "half the step changes the phase margin by +2." in remark and "--extrapolation fmu" in remark
    suggested = re.search(r"--step-size (\S+) ", remark)
    assert suggested is not None
    better = ec.linearize(system, **{**options, "step_size": float(suggested[1])})
    assert better.remarks == ()


def test_digital_controller_keeps_its_margins(fmu_folder: Path) -> None:
    """All that its loop exchanges is sampled; so does a controller that a step multiple makes slower."""
    options = {"open": "lift", "at": 0.2, "duration": 0.1, "stop_time": 0.4, "fmus": fmu_folder}
    (response,) = ec.linearize("lift", **options).responses.values()
    assert response.margins == response.margins_at_half_step and response.step_change == 0.0
    multiples = {f"lift.{name}": 2 for name in ("disturbance", "observer", "controller")}
    finer = ec.linearize("lift", step_size=5e-5, step_multiples=multiples, **options)
    (same,) = finer.responses.values()
    assert same.margins == response.margins and finer.step == 1e-4


@pytest.mark.slow
def test_step_is_not_judged_with_a_reason() -> None:
    options = {**OPTIONS, "open": "gain.force->cart.force"}
    (unknown,) = ec.linearize(closed(), **options).remarks
    assert "whether gain, which has discrete variables, samples" in unknown
    assert ec.linearize(closed(), step_multiples={"gain": 1}, **options).remarks == ()
    (remark,) = ec.linearize(
        "lift", open="lift", stop_time=0.4, duration=0.15, set={"lift.plant.sensor.sigma": 1e-9}
    ).remarks
    assert remark.startswith("The step is not judged: lift.plant draws random numbers in each step")


def test_response_to_a_free_input_has_two_integrators() -> None:
    system = ec.System.of({"cart": LinearizedCart})
    result = ec.linearize(system, perturb="cart.force", read="cart.position", **OPTIONS)
    response = result["cart.force to cart.position"]
    z = np.exp(2j * np.pi * response.frequency * STEP)
    expected = STEP**2 / 2.0 * (z + 1.0) / (z - 1.0) ** 2
    below = response.frequency < 49.0  # a zero at half the sample rate
    assert np.abs(response.value / expected - 1.0)[below].max() < 1e-6
    assert response.unit == "m/N"


def test_margins_of_a_delayed_double_integrator() -> None:
    """L = (k_p + k_d s) exp(-s T) / s^2: crossing and phase in closed form."""
    k_p, k_d, T = 4.0, 4.0, 0.05
    f = np.geomspace(0.01, 20.0, 20000)
    s = 2j * np.pi * f
    margins = compute_margins(f, (k_p + k_d * s) * np.exp(-s * T) / s**2)
    w = np.sqrt((k_d**2 + np.sqrt(k_d**4 + 4.0 * k_p**2)) / 2.0)
    phase = np.arctan2(k_d * w, k_p) - w * T
    assert margins.phase_deg == pytest.approx(np.degrees(phase), abs=1e-3)
    assert margins.delay_s == pytest.approx(phase / w, rel=1e-4)
    assert margins.gain_up_dB > 0.0 > margins.gain_down_dB


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"open": "cart.position->gain.speed"}, "there is no connection"),
        ({"open": "nonsense"}, "write a.output->b.input"),
        ({"open": "gain.force->card.force"}, "card"),
        ({"open": "gain.force->cart.forse"}, "did you mean gain.force->cart.force"),
        ({"open": "gain.force->cart.nothing"}, "there is no connection"),
        ({"open": "cart.force->cart.position"}, "without delay"),
        ({"perturb": "cart.force"}, "set both"),
        ({}, "nothing to compute"),
        ({"perturb": "cart.position", "read": "cart.speed"}, "is not an input"),
        ({"perturb": "cart.force", "read": "cart.nothing"}, "not a Real output"),
        ({"open": "gain.force->cart.force", "at": 19.0}, "not within the run, 0 s to 20 s"),
        ({"open": "gain.force->cart.force", "duration": 0.05}, "at least 20"),
    ],
)
def test_invalid_input_gives_one_message(options: dict, message: str) -> None:
    with pytest.raises(ec.CommandError, match=message):
        ec.linearize(closed(), **{**OPTIONS, **options})


def test_unstable_operating_point_is_refused() -> None:
    class LinearizedRunaway(LinearizedGain):
        def outputs(self, v):
            return {"force": 4.0 * v.position + 4.0 * v.speed}

    system = ec.System.of({"cart": LinearizedCart, "gain": LinearizedRunaway}, WIRES)
    with pytest.raises(ec.RunError, match="unstable"):
        ec.linearize(system, open="gain.force->cart.force", stop_time=6.0, step_size=STEP, duration=3.0)


def test_runs_are_repeated_where_states_cannot_be_restored(monkeypatch: pytest.MonkeyPatch) -> None:
    has_capability = FmuFile.has_capability
    monkeypatch.setattr(
        FmuFile, "has_capability", lambda f, c: c != "canGetAndSetFMUstate" and has_capability(f, c)
    )
    result = ec.linearize(closed(), open="gain.force->cart.force", **OPTIONS)
    assert not result.rolled_back
    (response,) = (m.response for m in result.responses.values())
    assert np.abs(response.value / loop_gain(response.frequency) - 1.0).max() < 1e-2
