"""Whether a joint is held, and its metrics, against the definitions and closed forms."""

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

import emla_cosim as ec
from emla_cosim.base.errors import CommandError
from emla_cosim.study.criteria import Criteria, resolve_criteria
from emla_cosim.study.metrics import JointMetrics
from tests.support.joint_data import EMLAS

SIGNALS = ("plant.x_L", "plant.v_L", "plant.tau_m", "reference.x_d", "reference.v_d")
NAMES = [*(f"j.{name}" for name in SIGNALS), "j.observer.x_hat", "j.controller.saturated"]

INERTIA, LIMIT = 35.0, 200.0
"""N m / (m/s^2), and N m."""
ALPHA = 2.0 * np.pi / 0.02
PARAMETERS = {
    "j.plant.motor.J_m": INERTIA / ALPHA,
    "j.plant.coupling.J_c": 0.0,
    "j.plant.gearbox.J_GB": 0.0,
    "j.plant.screw.M_BS": 0.0,
    "j.plant.gearbox.rho": 1.0,
    "j.plant.screw.lead": 0.02,
    "j.plant.motor.N_p": 4.0,
    "j.plant.motor.Phi_PM": LIMIT / (1.5 * 4.0 * 100.0),
    "j.plant.motor.i_max": 100.0,
}
"""A joint with this inertia and this torque limit."""


def evaluate(
    rows: np.ndarray, sizes: list[int] | None = None, is_restored: bool = False, **how: Any
) -> dict[str, Any]:
    """The figures of rows in blocks of these sizes, with what was remembered handed on between them."""
    metrics = JointMetrics(NAMES, **how)
    start = i = 0
    while start < len(rows):
        size = sizes[i % len(sizes)] if sizes else len(rows)
        metrics.write(rows[start : start + size])
        start, i = start + size, i + 1
        if is_restored:
            state = json.loads(json.dumps(metrics.state_dict()))
            metrics = JointMetrics(NAMES, **how)
            metrics.load_state_dict(state)
    return dict(metrics.figures()["j"])


def rows_of(
    time: np.ndarray, error: np.ndarray, speed_error: Any = 0.0, torque: Any = 0.0, **more: Any
) -> np.ndarray:
    """Rows of a joint whose reference is at 0 and rests, unless `x_d` and `v_d` say otherwise."""
    x_d, v_d, late = more.get("x_d", 0.0), more.get("v_d", 0.0), more.get("x_hat", 0.0)
    columns = [time, x_d + error, v_d + speed_error, torque, x_d, v_d, x_d + error + late, 0.0]
    return np.column_stack([np.broadcast_to(column, len(time)) for column in columns])


# ---- definitions -------------------------------------------------------------------------------------


def by_definition(rows: np.ndarray, window: float, dwell: float, multiple: int = 1) -> dict[str, Any]:
    """The definitions of docs/metrics.md, row by row; the observer estimates in each `multiple`-th."""
    t, x_L, v_L, tau, x_d, v_d, x_hat, saturated = rows.T
    error, n = np.abs(x_L - x_d), len(rows)
    entered, settled = None, None
    for i in range(n):
        if error[i] > window:
            entered = None
            continue
        entered = t[i] if entered is None else entered
        if t[i] - entered >= dwell - 1e-9:
            settled = entered
            break
    since = t[0] + 0.3 if settled is None else max(t[0] + 0.3, settled + dwell)
    counted = t >= since - 1e-9
    steps = np.diff(t, prepend=t[0])
    moving = np.abs(v_d) > 1e-6

    def largest(values: np.ndarray, where: np.ndarray = counted) -> float:
        return float(values[where].max()) if where.any() else np.nan

    def rms(where: np.ndarray) -> float:
        total = steps[where].sum()
        return float(np.sqrt((error[where] ** 2 * steps[where]).sum() / total)) if total else np.nan

    outside = counted & (error > window)
    entries = [i for i in np.flatnonzero(outside) if not counted[i - 1] or not outside[i - 1]]
    excursions = None
    if entries and settled is not None:
        worst = int(np.flatnonzero(counted)[error[counted].argmax()])
        excursions = {"count": len(entries), "largest_m": error[worst], "time_s": t[worst]}
    beyond = t[error > 0.05 * error[0]] if error[0] > 1e-6 else np.array([])
    within = error[-1] <= max(0.05 * error[0], 1e-6)
    return {
        "settling_time_s": np.nan if settled is None else settled - t[0],
        "evaluated_from_s": np.nan if settled is None else since,
        "position_error_m": largest(error),
        "velocity_error_m_s": largest(np.abs(v_L - v_d)),
        "torque_effort_N_m": largest(np.abs(tau)),
        "observer_position_error_m": largest(np.abs(x_L - x_hat), counted & (np.arange(n) % multiple == 0)),
        "following_error_m": largest(error, counted & moving),
        "standstill_error_m": largest(error, counted & ~moving),
        "following_error_rms_m": rms(counted & moving),
        "standstill_error_rms_m": rms(counted & ~moving),
        "torque_peak_N_m": float(np.abs(tau).max()),
        "saturated_fraction": float(np.mean(saturated > 0)),
        "saturated_after_settling": (
            float(np.mean(saturated[counted] > 0)) if counted.any() and settled is not None else np.nan
        ),
        "convergence_time_s": float((beyond[-1] if len(beyond) else t[0]) - t[0]) if within else np.nan,
        "excursions": excursions,
        "is_settled": settled is not None,
    }


@given(
    seed=st.integers(0, 10_000),
    start=st.sampled_from([0.0, 1.5, -0.25]),
    offset=st.sampled_from([0.0, 1e-7, 0.01, -0.3]),
    decay=st.floats(0.5, 30.0),
    noise=st.sampled_from([0.0, 1e-5, 4e-4, 1e-3]),
    count=st.integers(2, 120),
    sizes=st.lists(st.integers(1, 40), min_size=1, max_size=4),
    window=st.sampled_from([1e-3, 2.5e-4]),
    dwell=st.sampled_from([0.2, 0.05]),
    multiple=st.sampled_from([1, 7]),
    is_restored=st.booleans(),
)
def test_metrics_match_their_definitions_for_any_blocks(
    seed: int, start: float, offset: float, decay: float, noise: float, count: int, sizes: list[int],
    window: float, dwell: float, multiple: int, is_restored: bool,
) -> None:  # fmt: skip
    random = np.random.default_rng(seed)
    t = np.arange(count) * 0.01
    error = offset * np.exp(-decay * t) + noise * random.normal(size=count)
    v_d = np.where(random.random(count) < 0.3, 0.0, random.normal(size=count) * 1e-2)
    rows = rows_of(
        start + t, error, random.normal(size=count), random.normal(size=count), v_d=v_d, x_hat=noise
    )
    rows[:, 6] += noise * random.normal(size=count)
    rows[:, 7] = random.integers(0, 2, size=count)
    how: dict[str, Any] = {"criteria": {"j.position_window": window, "*.window_time": dwell}}
    if multiple > 1:
        how |= {"sample_times": {"j.observer": multiple * 0.01}, "start": start}
    actual = evaluate(rows, sizes, is_restored, **how)
    expected = by_definition(rows, window * (1 + 1e-9), dwell, multiple)
    is_settled = expected.pop("is_settled")
    assert actual.pop("excursions") == pytest.approx(expected.pop("excursions"))
    numbers = {name: actual[name] for name in expected}
    assert numbers == pytest.approx(expected, rel=1e-9, abs=1e-15, nan_ok=True)
    assert (actual["reason"] is None) == actual["held"]
    if actual["held"]:
        assert is_settled and actual["position_error_m"] <= window * (1 + 1e-9) and rows[-1, 0] > start + 0.3


def test_estimates_are_compared_at_the_times_of_the_observer() -> None:
    """Its model is the plant's, so it hardly errs; the plant moves on while an estimate is held."""
    result = ec.load("prototype", stop_time=0.7).prepare().run(output_interval=1e-4)
    figures = result.metrics["joints"]["prototype"]
    error = np.abs(result["prototype.plant.x_L"] - result["prototype.observer.x_hat"])
    counted = result.time >= figures["evaluated_from_s"] - 1e-9
    at_estimates = np.arange(len(error)) % 10 == 0
    assert figures["observer_position_error_m"] == error[counted & at_estimates].max()
    assert error[counted].max() > 100.0 * figures["observer_position_error_m"]
    few = ec.load("prototype", stop_time=0.7).prepare().run(output_interval=7e-4)
    error_of_few = few.metrics["joints"]["prototype"]["observer_position_error_m"]
    assert error_of_few == figures["observer_position_error_m"]


@given(
    start_error=st.floats(2e-3, 60e-3), steady=st.sampled_from([0.0, 3e-6, 2e-4]), longer=st.floats(0.0, 5.0)
)
def test_maxima_depend_neither_on_the_start_error_nor_on_the_stop_time(
    start_error: float, steady: float, longer: float
) -> None:
    """An approach of 60 1/s, then an error of `steady`; only an excursion makes a maximum larger."""
    t = np.arange(0.0, 2.0 + longer, 2e-3)
    error = start_error * np.exp(-60.0 * t) + steady * np.cos(3.0 * t)
    actual = evaluate(rows_of(t, error))
    assert actual["position_error_m"] == pytest.approx(steady, rel=1e-2, abs=2e-6)
    assert actual["settling_time_s"] == pytest.approx(np.log(start_error / 1e-3) / 60.0, abs=0.01)
    excursion = np.where(np.abs(t - 1.5) < 0.05, 3.5e-3, 0.0)
    later = evaluate(rows_of(t, error + excursion))
    assert actual["held"] is True and later["held"] is False
    assert later["position_error_m"] == pytest.approx(3.5e-3, abs=2.1e-4)
    assert later["settling_time_s"] == actual["settling_time_s"]
    assert later["excursions"]["count"] == 1 and 1.45 < later["excursions"]["time_s"] < 1.55


@pytest.mark.parametrize("start", [0.0, 0.1, -0.25, 10.0])
@pytest.mark.parametrize("step", [1e-4, 1e-2])
def test_run_longer_than_the_minimum_is_judged(start: float, step: float) -> None:
    count = round(0.3 / step)
    for steps, is_judged in ((count - 1, False), (count, False), (count + 1, True)):
        actual = evaluate(rows_of(start + step * np.arange(steps + 1), np.zeros(steps + 1)))
        assert actual["held"] == is_judged, steps
        assert (actual["reason"] or "").startswith("too short to judge") != is_judged


def test_short_stay_in_the_window_is_not_settled() -> None:
    """An error that swings through the window is inside for less than the window time."""
    t = np.arange(0.0, 2.0, 1e-3)
    rows = rows_of(t, 4e-3 * np.sin(8.0 * t))
    assert "has not settled" in evaluate(rows)["reason"]
    stay = evaluate(rows, criteria={"*.window_time": 0.05})
    assert stay["settling_time_s"] == pytest.approx((np.pi - np.arcsin(0.25)) / 8.0, abs=1e-3)
    assert stay["held"] is False and "left its position window" in stay["reason"]


@given(
    seed=st.integers(0, 2**32 - 1),
    sizes=st.lists(st.integers(1, 400), min_size=1, max_size=5),
    is_restored=st.booleans(),
)
@settings(max_examples=15)
def test_means_do_not_depend_on_interruptions(seed: int, sizes: list[int], is_restored: bool) -> None:
    """To the last bit, while the reference moves and while it rests."""
    random = np.random.default_rng(seed)
    t = np.arange(0.0, 1.0, 1e-3)
    rows = rows_of(t, 1e-5 * random.normal(size=len(t)), v_d=0.1 * (np.sin(20.0 * t) > 0.3))
    uninterrupted, parts = evaluate(rows), evaluate(rows, sizes, is_restored=is_restored)
    for name in ("following_error_rms_m", "standstill_error_rms_m"):
        assert uninterrupted[name] > 0.0 and parts[name] == uninterrupted[name]


def test_run_that_ends_early_is_not_held() -> None:
    metrics = JointMetrics(NAMES)
    t = np.arange(0.0, 2.0, 1e-3)
    metrics.write(rows_of(t, 0.0 * t))
    assert metrics.figures()["j"]["held"] is True
    metrics.ended_early("the run ended at t = 2 s: the FMU is gone.")
    assert metrics.figures()["j"]["held"] is False
    assert metrics.figures()["j"]["reason"] == "the run ended at t = 2 s: the FMU is gone."


# ---- quiet -------------------------------------------------------------------------------------------

T = np.arange(0.0, 2.0, 1e-4)


def driven(torque: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Rows of a mass that torque and outer forces (both in N m) accelerate, without its slow drift."""
    speed = np.cumsum((torque + force) / INERTIA) * 1e-4
    error = np.cumsum(speed) * 1e-4
    drift = np.polynomial.Polynomial.fit(T, error, 9)
    return rows_of(T, error - drift(T), speed - drift.deriv()(T), torque)


def limit_cycle(hertz: float, swing: float) -> np.ndarray:
    return driven(0.5 * swing * np.sign(np.sin(2 * np.pi * hertz * T + 0.1)), 0.0 * T)


@pytest.mark.parametrize(("hertz", "swing"), [(287.0, 356.0), (15.0, 400.0), (1000.0, 100.0)])
def test_limit_cycle_with_frequency_and_swing(hertz: float, swing: float) -> None:
    for sizes in ([2000], [333, 1]):
        actual = evaluate(limit_cycle(hertz, swing), sizes, parameters=PARAMETERS)
        assert actual["held"] is False
        assert actual["oscillation"]["frequency_Hz"] == pytest.approx(hertz, rel=0.02)
        # of the fundamental: 4 / pi of a square wave
        assert actual["oscillation"]["torque_swing_N_m"] == pytest.approx(4.0 / np.pi * swing, rel=0.1)
        assert actual["oscillation"]["kind"] == "lasting" and "j oscillates at" in actual["reason"]


def test_only_large_noise_is_an_oscillation() -> None:
    noise = np.random.default_rng(5).normal(size=len(T))
    for part, quiet in ((0.5, False), (0.3, False), (0.06, True), (0.0, True)):
        actual = evaluate(driven(part * LIMIT * noise, 0.0 * T), parameters=PARAMETERS)
        assert (actual["oscillation"] is None) == quiet, part
        if not quiet:
            assert actual["oscillation"]["torque_ripple"] == pytest.approx(part, rel=0.1)


def rejected(hertz: float, remainder: float) -> np.ndarray:
    """The torque takes a sine of 90 % of the limit off, but for this part."""
    force = 0.9 * LIMIT * np.sin(2 * np.pi * hertz * T)
    return driven(-(1.0 - remainder) * force, force)


QUIET: dict[str, Callable[[], np.ndarray]] = {
    "slow sine": lambda: rejected(3.0, 0.05),
    "sine of 20 Hz": lambda: rejected(20.0, 0.05),
    "sine of 20 Hz, a little too much taken off": lambda: rejected(20.0, -0.1),
    "sine of 60 Hz": lambda: rejected(60.0, 0.1),
    "random force from outside": lambda: driven(
        0.0 * T, 0.3 * LIMIT * np.random.default_rng(1).normal(size=len(T))
    ),
    "friction that reverses": lambda: driven(
        0.3 * LIMIT * np.sign(np.sin(2 * np.pi * T)), -0.3 * LIMIT * np.sign(np.sin(2 * np.pi * (T - 2e-3)))
    ),
    "an end stop that is hit": lambda: driven(
        np.where(np.abs(T - 1.0) < 0.01, LIMIT, 0.0), np.where(np.abs(T - 1.01) < 0.01, -LIMIT, 0.0)
    ),
    "a transient that rings down": lambda: driven(
        LIMIT * np.exp(-15.0 * np.maximum(T - 0.8, 0.0)) * (T > 0.8) * np.sin(2 * np.pi * 50 * T), 0.0 * T
    ),
}


@pytest.mark.parametrize("name", QUIET)
def test_other_torques_are_not_oscillations(name: str) -> None:
    actual = evaluate(QUIET[name](), parameters=PARAMETERS)
    assert actual["oscillation"] is None and actual["held"] is True, actual["reason"]


def test_unknown_inertia_needs_similar_torque_and_acceleration() -> None:
    parameters = {name: value for name, value in PARAMETERS.items() if "J_m" not in name}
    assert evaluate(limit_cycle(287.0, 356.0), parameters=parameters)["held"] is False
    assert evaluate(QUIET["random force from outside"](), parameters=parameters)["held"] is True


def test_oscillations_count_from_when_a_joint_is_evaluated() -> None:
    rows = limit_cycle(120.0, 300.0)
    actual = evaluate(rows, parameters=PARAMETERS)
    assert actual["oscillation"]["time_s"] == pytest.approx(0.3, abs=0.02)
    rows[:, 0] += 7.0
    assert evaluate(rows, parameters=PARAMETERS)["oscillation"]["time_s"] == pytest.approx(7.3, abs=0.02)
    before = np.where(T[:, np.newaxis] < 0.3, rows, limit_cycle(120.0, 0.0))
    before[:, 0] = T
    assert evaluate(before, parameters=PARAMETERS)["held"] is True


# ---- criteria ----------------------------------------------------------------------------------------


def test_criteria_with_units_and_joints() -> None:
    windows = {"a.position_window": "0.2 mm", "*.position_window": 5e-4}
    actual = resolve_criteria(["a", "b"], {**windows, "*.over_speed": "10 %", "b.window_time": 1})
    assert (actual["a"].position_window, actual["b"].position_window) == (2e-4, 5e-4)
    assert actual["a"].over_speed == pytest.approx(0.1) and actual["b"].window_time == 1.0
    assert asdict(resolve_criteria(["a"], {})["a"]) == asdict(Criteria())


@pytest.mark.parametrize(
    ("criteria", "words"),
    [
        ({"lift.window": 1.0}, "'lift.window' does not exist; write JOINT.CRITERION, with one of"),
        ({"position_window": 1.0}, "the criterion 'position_window' does not exist"),
        ({"crane.window_time": 1.0}, "the criterion 'crane.window_time' names 'crane', which is not a joint"),
        ({"lift.window_time": "2 mm"}, "the criterion 'lift.window_time' has"),
        ({"lift.window_time": 0.0}, "'lift.window_time' is 0.0; it must be a positive, finite number."),
        ({"lift.over_speed": -0.1}, "it must be a positive, finite number."),
        ({"lift.over_speed": "much"}, "the criterion 'lift.over_speed' is 'much'"),
        ({"lift.window_time": float("nan")}, "it must be a positive, finite number."),
    ],
)
def test_wrong_criteria_are_refused(criteria: dict[str, Any], words: str) -> None:
    with pytest.raises(CommandError, match=words):
        resolve_criteria(["lift"], criteria)


# ---- runs --------------------------------------------------------------------------------------------


def halved(joint: str) -> dict[str, float]:
    emla = EMLAS[joint]
    return {f"{joint}.plant.motor.J_m": 0.5 * emla.J_m, f"{joint}.plant.screw.M_BS": 0.5 * emla.M_BS}


@pytest.fixture(scope="module")
def drive(fmu_folder: Path) -> Any:
    with ec.load("study-drive", gains="compensated", fmus=fmu_folder).prepare() as simulation:
        yield simulation


def test_half_the_inertia_is_a_limit_cycle(drive: ec.Simulation) -> None:
    result = drive.run(stop_time=2.0, set=halved("lift"), output_interval=1e-4)
    figures = result.metrics["joints"]["lift"]
    torque = result["lift.plant.tau_m"][result.time >= 1.0]
    spectrum = np.abs(np.fft.rfft(torque - torque.mean()))
    hertz = np.fft.rfftfreq(len(torque), 1e-4)[spectrum.argmax()]
    assert figures["held"] is False and figures["position_error_m"] < 1e-5  # small, and yet not held
    assert figures["oscillation"]["frequency_Hz"] == pytest.approx(hertz, rel=0.03)
    assert figures["oscillation"]["torque_swing_N_m"] == pytest.approx(np.ptp(torque), rel=0.1)
    assert result.metrics["joints"]["telescope"]["held"] is True


def test_metrics_do_not_depend_on_output_interval_or_checkpoint(drive: ec.Simulation, tmp_path: Path) -> None:
    how = {"stop_time": 0.8, "set": {"lift.plant.sensor.sigma": 1e-6}, "recorders": []}
    uninterrupted = drive.run(**how).metrics["joints"]
    rare = drive.run(**how, output_interval=0.05).metrics["joints"]
    drive.run(**{**how, "stop_time": 0.45}, checkpoint=tmp_path / "c")
    resumed = drive.run(**how, resume=tmp_path / "c").metrics["joints"]
    for joint, figures in uninterrupted.items():
        numbers = {name: x for name, x in figures.items() if isinstance(x, (bool, float))}
        for joint_figures in (rare[joint], resumed[joint]):
            # sums of blocks end elsewhere, and round otherwise
            actual = {name: joint_figures[name] for name in numbers}
            assert actual == pytest.approx(numbers, rel=1e-12, nan_ok=True)
            assert joint_figures["reason"] == figures["reason"]
