"""The observer's Lyapunov solution, its bound (25), and what its gains do."""

import math
from types import SimpleNamespace

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from emla_cosim.study.joint import start_values
from emla_fmu import EmlaObserver, observer_gains
from fmublock.instance import BlockError, Instance
from tests.support.in_process import started
from tests.support.joint_data import observers


@given(
    alpha_1=st.floats(0.1, 1e4),
    alpha_2=st.floats(0.1, 1e8),
    q=st.tuples(st.floats(0.1, 10.0), st.floats(-0.05, 0.05), st.floats(0.1, 10.0)),
)
def test_p_solves_the_lyapunov_equation(
    alpha_1: float, alpha_2: float, q: tuple[float, float, float]
) -> None:
    """To rounding, and positive definite; the solution of (18) is unique."""
    values = SimpleNamespace(alpha_1=alpha_1, alpha_2=alpha_2, Q_11=q[0], Q_12=q[1], Q_22=q[2])
    p_11, p_12, p_22 = EmlaObserver().lyapunov_solution(values)
    p = np.array([[p_11, p_12], [p_12, p_22]])
    A_bar, Q = np.array([[-alpha_1, 1.0], [-alpha_2, 0.0]]), np.array([[q[0], q[1]], [q[1], q[2]]])
    scale = (np.abs(p) @ np.abs(A_bar)).max()
    assert np.abs(p @ A_bar + A_bar.T @ p + Q).max() < 1e-12 * scale
    assert p_11 > 0 and p_11 * p_22 - p_12 * p_12 > 0


def test_the_published_p_follows_from_the_published_alpha_and_Q() -> None:
    """(85) prints p to four digits, and alpha and Q rounded."""
    p = EmlaObserver().lyapunov_solution(observers("published")["lift"])
    assert p == pytest.approx((1.4078, -0.1975, 4.4535), rel=3e-4)


@given(
    y_bar=st.floats(-1.0, 1.0),
    eta_hat=st.floats(0.0, 100.0),
    y=st.floats(-1.0, 1.0),
    time=st.floats(0.0, 100.0),
)
def test_the_robust_term_keeps_its_bound(y_bar: float, eta_hat: float, y: float, time: float) -> None:
    """(25): |f| <= eta_hat H, and f has the innovation's sign."""
    gains = observers("robust")["lift"]
    point = {"y": y, "x_hat": y - y_bar, "eta_hat": eta_hat, "time": time, "h_before": 0.0}
    values = SimpleNamespace(**vars(gains) | point)
    f = EmlaObserver().robust_term(values, y)
    assert abs(f) <= eta_hat * EmlaObserver().H(values, y) * (1 + 1e-12)
    assert f * (values.y - values.x_hat) >= 0.0


def _errors(gains: observer_gains.ObserverGains, stop: float, step: float, H_0: float) -> tuple[float, float]:
    """Position and speed error at `stop` under an acceleration of 2 m/s2 that the observer does not know."""
    parameters = start_values(EmlaObserver, gains, {"x_hat_start": 0.0, "use_model": False, "H_0": H_0})
    instance = started(EmlaObserver, parameters)
    for k in range(round(stop / step)):
        # the position at the middle of the step: a held input is late by half a step otherwise
        instance["y"] = ((k + 0.5) * step) ** 2
        instance.do_step(k * step, step)
    return stop**2 - instance["x_hat"], 2.0 * stop - instance["v_hat"]


def test_repaired_gains_leave_the_error_that_theory_predicts() -> None:
    """Without f an acceleration a leaves a / alpha_2 in position and a alpha_1 / alpha_2 in speed.

    After 20 time constants; the held input leaves a ripple of alpha_1 v h^2 / 8, below 1 %.
    """
    position, speed = _errors(observer_gains.robust(400.0), stop=0.05, step=1e-4, H_0=0.0)
    assert position == pytest.approx(2.0 / 400.0**2, rel=2e-2)
    assert speed == pytest.approx(2.0 * 800.0 / 400.0**2, rel=2e-2)


@pytest.mark.parametrize("w", [400.0, 4000.0])
def test_repaired_gains_weigh_small_innovations_as_promised(w: float) -> None:
    """Both poles at -w; f adds w^2 / 2 to alpha_2, at t = 0 and with eta_hat and H as they start."""
    gains = observer_gains.robust(w)
    assert np.roots([1.0, gains.alpha_1, gains.alpha_2]) == pytest.approx([-w, -w], rel=1e-6)
    start = {
        "y": 0.0,
        "x_hat": 0.0,
        "v_hat": 0.0,
        "eta_hat": gains.eta_hat_start,
        "time": 0.0,
        "i_q_ref": 10.0,
        "i_q": 10.0,
        "d_hat": 0.0,
        "r_hat": 0.0,
        **dict.fromkeys(("y_before", "i_before", "t_before", "h_before"), 0.0),
    }
    known = {"N_p": 8, "Phi_PM": 0.15, "A_eq": 35.26, "B_eq": 3.67}
    resting = SimpleNamespace(**vars(gains), **known, **start)
    pushed = SimpleNamespace(**vars(resting) | {"x_hat": -1e-9 / w**2})
    assert EmlaObserver().derivatives(resting)["v_hat"] == 0.0  # the commanded torque is left out
    assert EmlaObserver().derivatives(pushed)["v_hat"] == pytest.approx(1.5e-9, rel=1e-6)


def test_the_robust_term_acts_as_its_gains_promise() -> None:
    """In balance alpha_2 y_bar + 8 f is the unknown acceleration, and the error falls by a third."""
    gains = observer_gains.robust(400.0)
    with_f, without_f = (_errors(gains, stop=0.05, step=1e-4, H_0=H_0)[0] for H_0 in (1.0, 0.0))
    f = with_f / (abs(with_f) + gains.m_0)  # (21) with eta_hat H = 1
    assert gains.alpha_2 * with_f + 8.0 * f == pytest.approx(2.0, rel=2e-2)
    assert with_f < 0.72 * without_f


def test_the_robust_term_does_nothing_with_the_published_gains() -> None:
    gains = observers("published")["lift"]
    with_f, without_f = (_errors(gains, stop=1.0, step=2e-3, H_0=H_0)[0] for H_0 in (20.0, 0.0))
    assert abs(without_f) > 0.5  # metres, after 1 s
    assert with_f == pytest.approx(without_f, rel=0.05)


def test_published_poles() -> None:
    gains = observers("published")["lift"]
    poles = np.roots([1.0, gains.alpha_1, gains.alpha_2])
    assert sorted(poles.imag) == pytest.approx([-0.536, 0.536], abs=1e-3)
    assert poles.real == pytest.approx([-0.1596, -0.1596], abs=1e-4)
    assert math.isclose(gains.alpha_2, abs(poles[0]) ** 2)


@pytest.mark.parametrize("p", [400.0, 1600.0])
def test_compensated_gains_put_all_poles_at_one_place(p: float) -> None:
    """s^3 + alpha_1 s^2 + alpha_2 s + omega_d alpha_2: position, speed and disturbance."""
    gains = observer_gains.compensated(p)
    poles = np.roots([1.0, gains.alpha_1, gains.alpha_2, gains.omega_d * gains.alpha_2])
    assert poles == pytest.approx([-p, -p, -p], rel=1e-4)  # triple roots are known to a third of the digits


@pytest.mark.parametrize("p", [400.0, 1600.0])
def test_damped_gains_put_all_poles_at_one_place(p: float) -> None:
    """s^4 + alpha_1 s^3 + alpha_2 s^2 + omega_d alpha_2 s + omega_r omega_d alpha_2, and the rate."""
    g = observer_gains.damped(p, 1e-4)
    poles = np.roots([1.0, g.alpha_1, g.alpha_2, g.omega_d * g.alpha_2, g.omega_r * g.omega_d * g.alpha_2])
    assert poles == pytest.approx([-p] * 4, rel=1e-3)
    assert observer_gains.with_poles(g, 2.0 * p) == observer_gains.damped(2.0 * p, 1e-4)


def _ramp(gains: observer_gains.ObserverGains) -> tuple[float, float]:
    """Errors of d_hat in m/s2 and v_hat in m/s at an acceleration of 3 t, after 0.2 s."""
    instance = started(EmlaObserver, start_values(EmlaObserver, gains, {"x_hat_start": 0.0, "B_eq": 0.0}))
    for k in range(2000):
        instance["y"] = 0.5 * ((k + 1) * 1e-4) ** 3
        instance.do_step(k * 1e-4, 1e-4)
    return instance["d_hat"] - 3.0 * 0.2, instance["v_hat"] - 1.5 * 0.2**2


@pytest.mark.parametrize("ahead", [0.0, 2e-3])
def test_a_ramp_leaves_no_error_with_a_fourth_state(ahead: float) -> None:
    """Without it d_hat lags by 1 / (p / 3); with `ahead` it is the disturbance of a later time."""
    d_hat, v_hat = _ramp(observer_gains.damped(400.0, ahead))
    assert d_hat == pytest.approx(3.0 * ahead, abs=2e-4)
    assert abs(v_hat) < 1e-6
    lag, _ = _ramp(observer_gains.compensated(400.0))
    assert lag == pytest.approx(-3.0 * 3.0 / 400.0, rel=0.02)


def _follows(step: float, stop: float, **values: float) -> dict[str, float]:
    """Errors of an observer at 2 m/s2, of which its current explains 1.5 m/s2."""
    gains = observer_gains.compensated(400.0)
    A_2 = 1.5 * 8 * 0.15 / 35.26
    parameters = start_values(EmlaObserver, gains, {"x_hat_start": 0.0, "B_eq": 0.0} | values)
    instance = started(EmlaObserver, parameters | {"i_q": 1.5 / A_2})
    for k in range(round(stop / step)):
        instance["y"] = ((k + 1) * step) ** 2
        instance.do_step(k * step, step)
    true = {"x_hat": stop**2, "v_hat": 2.0 * stop, "d_hat": 0.5}
    return {name: instance[name] - value for name, value in true.items()}


def test_a_constant_disturbance_leaves_no_error() -> None:
    """After 40 time constants, with the position on a line between samples: what is left is its curvature."""
    errors = _follows(1e-4, 0.1)
    assert abs(errors["d_hat"]) < 2e-3
    assert abs(errors["v_hat"]) < 1e-5
    assert abs(errors["x_hat"]) < 1e-8


def test_a_held_position_is_ahead_by_half_a_step() -> None:
    """0.2 m/s for half of 1 ms, less what 0.4 of a time constant smooths; interpolation takes it away."""
    held, moving = (_follows(1e-3, 0.1, interpolate=value)["x_hat"] for value in (0.0, 1.0))
    assert held == pytest.approx(0.2 * 0.5e-3, rel=0.25)
    assert abs(moving) < 0.01 * held


def _estimates(start: float) -> np.ndarray:
    """Estimates after each of 20 steps of 2^-15 s, of which every time is a double."""
    step = 2.0**-15
    gains = start_values(EmlaObserver, observer_gains.damped(400.0, 4e-4), {"x_hat_start": 0.0})
    instance = started(EmlaObserver, gains, start)
    rows = []
    for k in range(20):
        instance["y"], instance["i_q"] = 1e-3 * math.sin(0.3 * (k + 1)), 10.0 * math.cos(0.2 * k)
        instance.do_step(start + k * step, step)
        rows.append([instance[name] for name in ("x_hat", "v_hat", "d_hat", "r_hat")])
    return np.array(rows)


def test_a_run_that_starts_later_has_the_same_estimates() -> None:
    """Bit for bit; the second step interpolates over the first one, not over the time since 0 s."""
    at_zero, later = _estimates(0.0), _estimates(5.0)
    assert np.array_equal(at_zero, later)
    assert np.ptp(at_zero, axis=0).min() > 1e-6


def test_the_time_of_the_last_step_begins_at_the_start_time() -> None:
    instance = Instance(EmlaObserver())
    instance.setup_experiment(5.0)
    instance.enter_initialization()
    assert instance["before.time"] == 5.0
    with pytest.raises(BlockError, match="cannot be set"):
        instance["before.time"] = 1.0
