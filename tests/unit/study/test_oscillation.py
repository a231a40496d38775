"""Tones that last, grow or decay, beside what known inputs cause, from rows with known rates."""

import json
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from scipy.signal import lfilter

import emla_cosim as ec
from emla_cosim.study.loads import LoadMetrics, WatchedLoad
from emla_cosim.study.metrics import JointMetrics

SIGNALS = ("plant.x_L", "plant.v_L", "plant.tau_m", "reference.x_d", "reference.v_d")
NAMES = [f"j.{name}" for name in (*SIGNALS, "disturbance.F_L", "disturbance.d_2", "plant.load.x")]
LIMIT, INERTIA = 200.0, 35.0  # N m, N m / (m/s^2)
MOTOR = {"N_p": 1.0, "Phi_PM": LIMIT / 1.5, "i_max": 1.0}
PARAMETERS = {f"j.plant.motor.{name}": value for name, value in MOTOR.items()}


def oscillation_of(
    stop: float = 4.0,
    step: float = 1e-4,
    block: int = 4000,
    is_restored: bool = False,
    seed: int = 1,
    sample_time: float | None = None,
    **signals: Any,
) -> dict[str, Any]:
    """Return the figures of a joint with these functions of time, beside noise and a forced motion."""
    t = np.arange(round(stop / step) + 1) * step
    random = np.random.default_rng(seed)
    values = {name: np.asarray(f(t)) for name, f in signals.items()}
    d_2 = values.get("d_2", 0.8 * np.sin(8.0 * t) + 0.7 * np.sin(20.0 * t))
    forced = -0.99 * INERTIA * d_2  # what is rejected of the disturbance, all but 1 %
    torque = values.get("torque", 0.0) + forced + 60.0 + 1e-3 * random.normal(size=len(t))
    error = values.get("error", 0.0) + 1e-8 * d_2 + 1e-11 * random.normal(size=len(t))
    load = values.get("load", 0.0) + error
    rest = np.zeros(len(t))
    rows = np.column_stack([t, error, rest, torque, rest, rest, rest + 57e3, d_2, load])

    def make() -> JointMetrics:
        loads = LoadMetrics([WatchedLoad("j", [8, 1, 4, 4])], {})
        sample_times = {} if sample_time is None else {"j.controller": sample_time}
        return JointMetrics(NAMES, PARAMETERS, sample_times=sample_times, loads=loads)

    metrics = make()
    for first in range(0, len(rows), block):
        metrics.write(np.array(rows[first : first + block], dtype=np.float64))
        if is_restored:
            state = json.loads(json.dumps(metrics.state_dict()))
            metrics = make()
            metrics.load_state_dict(state)
    return dict(metrics.figures()["j"])


def tone(hertz: float, growth: float, end: float, stop: float = 4.0) -> Any:
    """Return a sine whose amplitude is largest, `end`, at the end or at the start."""
    return lambda t: (
        end * np.exp(growth * (t - stop if growth > 0.0 else t)) * np.sin(2.0 * np.pi * hertz * t + 0.5)
    )


@given(
    hertz=st.sampled_from([5.0, 6.25, 14.0, 40.0, 100.0, 290.0]),
    growth=st.sampled_from([0.1, 0.3, 0.7, 2.0]),
    end=st.sampled_from([0.3, 3.0, 30.0]),
    seed=st.integers(0, 1000),
)
@settings(max_examples=12)
def test_growing_tone_is_an_oscillation_and_decaying_one_is_not(
    hertz: float, growth: float, end: float, seed: int
) -> None:
    """However small: 0.3 N m are 0.15 % of the limit; other frequencies need longer runs."""
    for sign in (1.0, -1.0):
        torque = tone(hertz, sign * growth, end)
        actual = oscillation_of(
            torque=torque, error=lambda t, f=torque: -f(t) / INERTIA / (2 * np.pi * hertz) ** 2
        )
        oscillation = actual["oscillation"]
        assert (oscillation is not None) == (sign > 0.0) == (not actual["held"]), (sign, oscillation)
        if oscillation is not None:
            assert oscillation["frequency_Hz"] == pytest.approx(hertz, rel=0.1)
            assert oscillation["kind"] in ("growing", "lasting")
            if oscillation["kind"] == "growing":
                assert oscillation["growth_1_s"] == pytest.approx(growth, rel=0.3, abs=0.05)


@pytest.mark.parametrize(("hertz", "stop"), [(0.6, 25.0), (2.2, 12.0), (4500.0, 1.0)])
def test_slow_and_fast_oscillations(hertz: float, stop: float) -> None:
    """From 0.5 Hz to half the sample rate; ten cycles are needed."""
    actual = oscillation_of(stop=stop, torque=tone(hertz, 0.0, 20.0, stop), block=9000)
    assert actual["oscillation"]["kind"] == "lasting" and actual["held"] is False
    assert actual["oscillation"]["frequency_Hz"] == pytest.approx(hertz, rel=0.1)


def test_slowest_oscillation_in_four_seconds() -> None:
    """Fourteen cycles, without a forced sine beside it."""
    actual = oscillation_of(d_2=np.zeros_like, torque=tone(3.7, 0.0, 20.0))
    assert actual["oscillation"]["frequency_Hz"] == pytest.approx(3.7, rel=0.1)


@pytest.mark.parametrize("stop", [1.6, 2.9, 4.0, 5.2, 9.6, 11.7])
def test_forced_sines_are_no_oscillation_after_any_time(stop: float) -> None:
    """Also with the fewest windows that the length of a run leaves."""
    assert oscillation_of(stop=stop)["held"] is True


def test_rows_one_by_one() -> None:
    """A run that is stepped by hand has blocks of one row, and its steps before events are short."""
    torque = tone(14.0, 0.0, 20.0, 2.0)
    assert oscillation_of(stop=2.0, step=1e-3, block=1, torque=torque)["oscillation"]["kind"] == "lasting"


def test_oscillation_before_steps_get_longer() -> None:
    t = np.concatenate([np.arange(3000) * 1e-3, 3.0 + np.arange(300) * 1e-2])
    load = np.where(t < 3.0, 3e-4 * np.sin(2 * np.pi * 14.0 * t), 0.0)
    rest = np.zeros(len(t))
    rows = np.column_stack([t, rest, rest, rest, rest, rest, rest, rest, load])
    metrics = JointMetrics(NAMES, PARAMETERS, loads=LoadMetrics([WatchedLoad("j", [8, 1, 4, 4])], {}))
    for part in np.array_split(rows, 11):
        metrics.write(part)
    assert metrics.figures()["j"]["oscillation"]["frequency_Hz"] == pytest.approx(14.0, rel=0.05)


def test_noise_with_long_steps() -> None:
    noise = np.random.default_rng(0)
    actual = oscillation_of(step=2e-3, torque=lambda t: 60.0 * noise.normal(size=len(t)))
    assert actual["oscillation"]["kind"] == "noise" and actual["held"] is False


@pytest.mark.filterwarnings("error")
def test_run_that_diverges_gives_no_warnings() -> None:
    actual = oscillation_of(stop=2.0, load=lambda t: 1e-4 * np.exp(np.minimum(200.0 * t, 600.0)))
    assert actual["held"] is False


def test_load_that_swings_within_its_window_is_an_oscillation() -> None:
    actual = oscillation_of(load=lambda t: 130e-6 * np.sin(2 * np.pi * 6.25 * t))
    assert actual["held"] is False and actual["judged"] == ["screw", "load"]
    assert actual["oscillation"]["signal"] == "load"
    assert actual["oscillation"]["load_swing_m"] == pytest.approx(260e-6, rel=0.1)
    assert "load by 2" in actual["reason"]


def test_swing_that_decays_is_held() -> None:
    """A load of 12 t on 20 kN/mm with a damping ratio of 0.02: 0.8 1/s."""
    assert oscillation_of(load=tone(6.25, -0.8, 0.9e-3))["held"] is True


def test_what_known_inputs_cause_is_no_oscillation() -> None:
    """The joint rejects sines of the disturbance at 1.3, 3.2 and 60 Hz with most of its torque."""
    for hertz in (1.3, 6.0, 60.0):
        actual = oscillation_of(stop=8.0, d_2=lambda t, f=hertz: 3.0 * np.sin(2 * np.pi * f * t))
        assert actual["oscillation"] is None and actual["held"] is True
    with_neighbour = oscillation_of(
        stop=8.0,
        d_2=lambda t: 3.0 * np.sin(2 * np.pi * 6.0 * t),
        torque=lambda t: 20.0 * np.sin(2 * np.pi * 14.0 * t),
    )
    assert with_neighbour["oscillation"]["frequency_Hz"] == pytest.approx(14.0, rel=0.02)


@pytest.mark.parametrize("hertz", [20.0, 300.0, 1000.0])
@pytest.mark.parametrize("seed", range(3))
def test_noise_in_a_narrow_band_is_no_oscillation(hertz: float, seed: int) -> None:
    """A mode with a damping ratio of 0.02 that noise excites: its amplitude comes and goes."""
    pole = np.exp((-0.02 + 1j) * 2.0 * np.pi * hertz * 1e-4)
    noise = np.random.default_rng(seed).normal(size=60_001)
    values = np.real(lfilter([1.0], [1.0, -pole], noise.astype(complex)))
    torque = 10.0 * values / values.std()
    assert oscillation_of(stop=6.0, torque=lambda _: torque)["oscillation"] is None


def test_any_blocks_and_checkpoints_give_the_same_oscillation() -> None:
    signals = {"torque": tone(290.0, 0.4, 50.0), "load": tone(6.0, 0.0, 1e-4)}
    uninterrupted = oscillation_of(block=50_000, **signals)["oscillation"]
    assert oscillation_of(block=777, **signals)["oscillation"] == pytest.approx(uninterrupted, nan_ok=True)
    assert oscillation_of(block=9001, is_restored=True, **signals)["oscillation"] == pytest.approx(
        uninterrupted, nan_ok=True
    )


@pytest.mark.parametrize("step", [1e-3, 5e-3, 2e-5])
def test_lasting_tone_is_found_and_decaying_one_is_not_at_other_steps(step: float) -> None:
    actual = oscillation_of(step=step, torque=tone(14.0, 0.0, 20.0))
    assert actual["oscillation"]["frequency_Hz"] == pytest.approx(14.0, rel=0.05)
    assert oscillation_of(step=step, torque=tone(14.0, -0.5, 20.0))["oscillation"] is None


def test_unequal_steps() -> None:
    """Error control changes the steps; rows are brought to equal ones."""
    random = np.random.default_rng(0)
    t = np.cumsum(random.uniform(5e-4, 1.5e-3, size=6000))
    rest = np.zeros(len(t))
    for growth, is_held in ((0.0, False), (-0.5, True)):
        load = 2e-4 * np.exp(growth * t) * np.sin(2 * np.pi * 8.0 * t)
        rows = np.column_stack([t, rest, rest, rest, rest, rest, rest, rest, load])
        metrics = JointMetrics(NAMES, PARAMETERS, loads=LoadMetrics([WatchedLoad("j", [8, 1, 4, 4])], {}))
        for part in np.array_split(rows, 7):
            metrics.write(part)
        assert metrics.figures()["j"]["held"] is is_held


def test_steps_of_a_sampled_controller_are_no_oscillation(fmu_folder: Any) -> None:
    """The torque of a controller at 1 kHz has steps, a tone of 1 kHz that grows with the speed."""
    change = {"prototype.plant.screw.lead": 0.016}
    with ec.load("prototype", stop_time=1.0, set=change, fmus=fmu_folder).prepare() as simulation:
        figures = simulation.run(recorders=[]).metrics["joints"]["prototype"]
    assert figures["oscillation"] is None and figures["held"] is True


@pytest.mark.parametrize("hertz", [30.8, 61.0, 252.0])
def test_sampling_hides_no_tone_where_its_lines_are_folded(hertz: float) -> None:
    """Lines of 1 kHz are at 31.25 and 62.5 Hz of the lowest rate, and at 250 Hz of the middle one."""
    torque = tone(hertz, 0.0, 42.0)
    figures = oscillation_of(sample_time=1e-3, torque=torque)
    assert figures["held"] is False
    assert figures["oscillation"]["frequency_Hz"] == pytest.approx(hertz, rel=0.02)


@pytest.mark.parametrize("sample_time", [3e-4, 5e-4, 8e-4, 1e-3, 2e-3])
def test_torque_of_any_sample_time_is_no_oscillation(sample_time: float) -> None:
    """It follows up to 160 of 200 N m at 1.5 Hz in steps that last or grow."""
    multiple = round(sample_time / 1e-4)
    for growth in (0.0, 0.5):
        torque = tone(1.5, growth, 160.0)
        figures = oscillation_of(
            sample_time=sample_time,
            torque=lambda t, f=torque: np.repeat(f(t[::multiple]), multiple)[: len(t)],
            d_2=lambda t, f=torque: -f(t) / INERTIA / 0.99,
            error=np.zeros_like,
        )
        assert figures["oscillation"] is None


# ---- runs --------------------------------------------------------------------------------------------


def soft(joint: str, mass: float, stiffness: float) -> dict[str, float]:
    """Return a load on a spring with a damping ratio of 0.02."""
    return {
        f"{joint}.plant.load.m": mass,
        f"{joint}.plant.transmission.stiffness": stiffness,
        f"{joint}.plant.transmission.damping": 2.0 * 0.02 * np.sqrt(stiffness * mass),
    }


@pytest.fixture(scope="module")
def compliant(fmu_folder: Any) -> Any:
    with ec.load("study-compliant", fmus=fmu_folder, load_control="none").prepare() as simulation:
        yield simulation


def test_torque_that_works_against_the_spring_is_a_limit_cycle(compliant: ec.Simulation) -> None:
    """The torque swings by 26 of 32 N m and the load by 1.6 mm within its window, which was held once."""
    gains = {"beta[1]": 100.0, "beta[2]": 600.0, "beta[3]": 4000.0, "beta[4]": 4000.0, "omega_u": 300.0}
    observer = {"alpha_1": 7800.0, "alpha_2": 20.28e6, "omega_d": 866.7}  # p = 2600
    change = {
        **soft("telescope", 2120.0, 25e6),
        **{f"telescope.controller.{name}": value for name, value in gains.items()},
        **{f"telescope.observer.{name}": value for name, value in observer.items()},
        "telescope.plant.start.deflection": -1.36e-4,
        "telescope.reference.move.duration[1]": 2.0,
    }
    result = compliant.run(stop_time=5.0, set=change, recorders=[])
    figures, load = result.metrics["joints"]["telescope"], result.metrics["loads"]["telescope"]
    assert load["load_within_window"] is True and figures["held"] is False
    assert figures["oscillation"]["frequency_Hz"] == pytest.approx(14.3, rel=0.05)
    assert figures["oscillation"]["load_swing_m"] == pytest.approx(1.6e-3, rel=0.15)
    assert any(text.startswith("telescope oscillates at") for text in result.remarks)
    assert result.metrics["joints"]["lift"]["held"] is True


@pytest.mark.parametrize(("damping", "is_held"), [(0.0, False), (0.02, True)])
def test_boom_that_swings_after_a_move(damping: float, is_held: bool, compliant: ec.Simulation) -> None:
    """12 t on 20 kN/mm swing at 6 Hz: it continues, or ends by 0.8 1/s."""
    change = {**soft("lift", 12e3, 20e6), "lift.disturbance.load.level[1]": 5e3}
    change["lift.plant.transmission.damping"] *= damping / 0.02
    change["lift.plant.start.deflection"] = 5e3 / 20e6
    criteria = {"lift.position_window": 5e-3}
    result = compliant.run(stop_time=6.0, set=change, criteria=criteria, recorders=[])
    figures, load = result.metrics["joints"]["lift"], result.metrics["loads"]["lift"]
    assert load["load_within_window"] is True and figures["held"] is is_held, figures["reason"]
    assert (figures["oscillation"] is None) is is_held
    if not is_held:
        assert figures["oscillation"]["signal"] == "load"
        assert figures["oscillation"]["frequency_Hz"] == pytest.approx(6.4, rel=0.1)


@pytest.mark.parametrize(("inertia", "is_held"), [(0.669, False), (0.671, True)])
def test_inertia_at_the_edge_of_stability(inertia: float, is_held: bool, fmu_folder: Any) -> None:
    """With 0.669 times the rotor's inertia the torque keeps swinging; with 0.671 it decays by 0.25 1/s."""
    change = {"lift.plant.motor.J_m": inertia * 0.016, "lift.plant.inverter.delay": 1e-4}
    simulation = ec.load("lift", gains="compensated", fmus=fmu_folder, stop_time=4.0, set=change)
    figures = simulation.prepare().run(recorders=[]).metrics["joints"]["lift"]
    assert figures["held"] is is_held and (figures["oscillation"] is None) is is_held
