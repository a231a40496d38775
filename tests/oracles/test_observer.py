"""The observer's Lyapunov solution, its bound (25), and what its gains do."""

from types import SimpleNamespace

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from emla_fmu import EmlaObserver, observer_gains
from fmublock.instance import BlockError, Instance
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


def test_published_p_follows_from_the_published_alpha_and_Q() -> None:
    """(85) prints p to four digits, and alpha and Q rounded."""
    p = EmlaObserver().lyapunov_solution(observers("published")["lift"])
    assert p == pytest.approx((1.4078, -0.1975, 4.4535), rel=3e-4)


@given(
    y_bar=st.floats(-1.0, 1.0),
    eta_hat=st.floats(0.0, 100.0),
    y=st.floats(-1.0, 1.0),
    time=st.floats(0.0, 100.0),
)
def test_robust_term_keeps_its_bound(y_bar: float, eta_hat: float, y: float, time: float) -> None:
    """(25): |f| <= eta_hat H, and f has the innovation's sign."""
    gains = observers("robust")["lift"]
    point = {"y": y, "x_hat": y - y_bar, "eta_hat": eta_hat, "time": time, "h_before": 0.0}
    values = SimpleNamespace(**vars(gains) | point)
    f = EmlaObserver().robust_term(values, y)
    assert abs(f) <= eta_hat * EmlaObserver().H(values, y) * (1 + 1e-12)
    assert f * (values.y - values.x_hat) >= 0.0


@pytest.mark.parametrize("w", [400.0, 4000.0])
def test_repaired_gains_weigh_small_innovations_as_promised(w: float) -> None:
    """Both poles at -w; f adds w^2 / 2 to alpha_2, at t = 0 and with eta_hat and H as they start."""
    gains = observer_gains.robust(w)
    assert np.roots([1.0, gains.alpha_1, gains.alpha_2]) == pytest.approx([-w, -w], rel=1e-6)
    zeros = ("y", "x_hat", "v_hat", "d_hat", "r_hat", "y_before", "i_before", "time", "t_before", "h_before")
    start = dict.fromkeys(zeros, 0.0) | {"eta_hat": gains.eta_hat_start, "i_q_ref": 10.0, "i_q": 10.0}
    model = {"N_p": 8, "Phi_PM": 0.15, "A_eq": 35.26, "B_eq": 3.67}
    resting = SimpleNamespace(**vars(gains), **model, **start)
    pushed = SimpleNamespace(**vars(resting) | {"x_hat": -1e-9 / w**2})
    assert EmlaObserver().derivatives(resting)["v_hat"] == 0.0  # the commanded torque is left out
    assert EmlaObserver().derivatives(pushed)["v_hat"] == pytest.approx(1.5e-9, rel=1e-6)


@pytest.mark.parametrize("p", [400.0, 1600.0])
def test_compensated_gains_make_all_poles_equal(p: float) -> None:
    """s^3 + alpha_1 s^2 + alpha_2 s + omega_d alpha_2: position, speed and disturbance."""
    gains = observer_gains.compensated(p)
    poles = np.roots([1.0, gains.alpha_1, gains.alpha_2, gains.omega_d * gains.alpha_2])
    assert poles == pytest.approx([-p, -p, -p], rel=1e-4)  # triple roots are known to a third of the digits
    assert gains.use_model and gains.use_measured_current and gains.interpolate


@pytest.mark.parametrize("p", [400.0, 1600.0])
def test_damped_gains_make_all_poles_equal(p: float) -> None:
    """s^4 + alpha_1 s^3 + alpha_2 s^2 + omega_d alpha_2 s + omega_r omega_d alpha_2, and the rate."""
    g = observer_gains.damped(p, 1e-4)
    poles = np.roots([1.0, g.alpha_1, g.alpha_2, g.omega_d * g.alpha_2, g.omega_r * g.omega_d * g.alpha_2])
    assert poles == pytest.approx([-p] * 4, rel=1e-3)
    assert g.use_model and g.use_measured_current and g.interpolate and g.ahead == 1e-4
    assert observer_gains.with_poles(g, 2.0 * p) == observer_gains.damped(2.0 * p, 1e-4)


def test_time_of_the_last_step_begins_at_the_start_time() -> None:
    instance = Instance(EmlaObserver())
    instance.setup_experiment(5.0)
    instance.enter_initialization()
    assert instance["before.time"] == 5.0
    with pytest.raises(BlockError, match="cannot be set"):
        instance["before.time"] = 1.0
