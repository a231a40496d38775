"""The bounds of the certificate hold in the continuous closed loop, which SciPy integrates."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import eigvals, solve_continuous_lyapunov
from scipy.optimize import minimize

from rsba_fmu.certificate import (
    Bounds,
    Certificate,
    ControlGains,
    ObserverConstants,
    certificate,
    lyapunov,
    observer_rate,
)

OBSERVER = ObserverConstants((8000.0, 1.6e7), (1.0, 0.2, 2.0), 1.0, 1e-6, 1e-3)
GAINS = ControlGains(
    beta=(40.0, 160.0, 600.0, 500.0),
    zeta=(20.0, 30.0, 5.0, 8.0),
    delta=(2.0, 3.0, 4.0, 2.0),
    sigma=(1.0, 2.0, 1.5, 3.0),
)
A_2, A_3, A_4 = 0.05, 400.0, 350.0
START = np.array([0.01, 0.02, 3.0, -2.0, 0.5, 0.1, 0.2, 0.0])


def acting(t: float) -> np.ndarray:
    """d_1 to d_4, and the change of x_3d with time, which is given here and not u_2."""
    return np.array(
        [1e-4 * math.sin(9 * t), 2 + math.sin(7 * t), 30 * math.cos(50 * t), -20.0, 40 * math.sin(5 * t)]
    )


def motion(t: float, state: np.ndarray, g: ControlGains = GAINS) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives of P_1 to P_4 and theta_hat by (26), (31), (32), (39); and F_i + d_i - x_id' by (33).

    Nothing moves (x_1d = x_2d = 0), so a_1 is -(beta_1 + zeta_1 theta_1) / 2 P_1.
    """
    P, theta = state[:4], state[4:]
    d = acting(t)
    gain = (np.array(g.beta) + np.array(g.zeta) * theta) / 2
    theta_dot = -np.array(g.delta) * g.sigma * theta + 0.5 * np.array(g.zeta) * g.delta * P**2
    a_1 = -gain[0] * P[0]
    x_1_dot = P[1] + a_1 + d[0]  # = x_2 + d_1
    a_1_dot = -gain[0] * x_1_dot - g.zeta[0] / 2 * theta_dot[0] * P[0]
    u_2 = -gain[1] / A_2 * P[1] - P[0] / A_2
    u_3, u_4 = -gain[2] / A_3 * P[2], -gain[3] / A_4 * P[3]
    P_dot = np.array([x_1_dot, A_2 * u_2 + d[1] - a_1_dot, A_3 * u_3 + d[2] - d[4], A_4 * u_4 + d[3]])
    return np.concatenate([P_dot, theta_dot]), np.array([d[0], d[1] - a_1_dot, d[2] - d[4], d[3]])


@pytest.fixture(scope="module")
def run() -> tuple[Any, Certificate]:
    """A run of 3 s, and the certificate for what acted in it."""
    times = np.linspace(0.0, 3.0, 6001)
    solution = solve_ivp(
        lambda t, y: motion(t, y)[0], (0.0, 3.0), START, "LSODA", times, rtol=1e-9, atol=1e-12
    )
    D = np.max([np.abs(motion(t, y)[1]) for t, y in zip(solution.t, solution.y.T, strict=True)], axis=0)
    return solution, certificate(GAINS, OBSERVER, Bounds(tuple(D.tolist()), duration=3.0))


def test_length_of_P_stays_below_its_bound(run: tuple[Any, Certificate]) -> None:
    solution, certified = run
    lengths = np.linalg.norm(solution.y[:4], axis=0)
    bounds = [certified.direct_bound(t, lengths[0]) for t in solution.t]
    assert (lengths <= np.array(bounds) * (1 + 1e-6)).all()


def test_position_and_current_stay_below_their_bounds_after_the_start(
    run: tuple[Any, Certificate],
) -> None:
    solution, certified = run
    late = np.abs(solution.y[:, solution.t > 1.5]).max(axis=1)
    assert late[0] <= certified.position <= 20 * late[0]
    assert late[2] <= certified.current <= 2 * late[2]


def test_V_stays_below_the_bound_of_the_paper(run: tuple[Any, Certificate]) -> None:
    solution, certified = run
    off = solution.y[4:] - np.array(certified.theta_star)[:, None]
    V = 0.5 * (solution.y[:4] ** 2).sum(axis=0) + 0.5 * (off**2 / np.array(GAINS.delta)[:, None]).sum(axis=0)
    bounds = np.array([certified.lyapunov_bound(t, V[0]) for t in solution.t])
    assert (V <= bounds * (1 + 1e-9)).all()
    assert np.linalg.norm(solution.y[:4, -1]) <= certified.ultimate


def test_constant_disturbance_of_the_current_reaches_its_bound() -> None:
    certified = certificate(GAINS, OBSERVER, Bounds((0.0, 0.0, 100.0, 0.0)))
    current = solve_ivp(lambda t, P: -GAINS.beta[2] / 2 * P + 100.0, (0.0, 1.0), [0.0])
    assert current.y[0, -1] == pytest.approx(certified.current, rel=1e-3)


def test_no_other_constants_give_less() -> None:
    """mu, nu and psi of (43) by a search, for one subsystem with Lambda r, d_max and Omega of their own."""
    parts, zeta, sigma = np.array([2.0, 0.5, 7.0]), 3.0, 0.7

    def terms(logarithms: np.ndarray) -> float:
        free = np.exp(logarithms)
        theta = (free * parts**2).sum() / zeta
        return float(0.5 * (1 / free).sum() + 0.5 * sigma * theta**2)

    best = minimize(terms, np.zeros(3), method="Nelder-Mead", options={"fatol": 1e-13, "xatol": 1e-10})
    gains = ControlGains((1.0,) * 4, (zeta,) * 4, (1.0,) * 4, (sigma,) * 4)
    certified = certificate(gains, OBSERVER, Bounds((0.0, float(parts.sum()), 0.0, 0.0)))
    assert certified.residual == pytest.approx(best.fun, rel=1e-6)
    assert certified.theta_star[1] == pytest.approx((np.exp(best.x) * parts**2).sum() / zeta, rel=1e-4)


def test_decay_rates_match_the_paper() -> None:
    certified = certificate(GAINS, OBSERVER, Bounds((0.0,) * 4, duration=1000.0))
    assert certified.phi == pytest.approx((1e-6 * math.exp(-1.0), 2.0, 6.0, 6.0, 6.0))
    assert certified.phi_total == certified.phi[0] == 2 * certified.rate
    assert certified.ultimate == certified.direct_ultimate == certified.observer_position == 0.0


def test_without_adaptation_only_the_direct_bound_is_finite() -> None:
    gains = ControlGains(GAINS.beta, (0.0,) * 4, GAINS.delta, GAINS.sigma)
    certified = certificate(gains, OBSERVER, Bounds((0.0, 1.0, 0.0, 0.0)))
    assert math.isinf(certified.ultimate)
    assert math.isinf(certified.lyapunov_bound(1.0, 0.0))
    assert certified.direct_ultimate == pytest.approx(2.0 / 40.0)


def test_observer_matches_the_lyapunov_equation() -> None:
    (a_1, a_2), (Q_11, Q_12, Q_22) = OBSERVER.alpha, OBSERVER.Q
    A, Q = np.array([[-a_1, 1.0], [-a_2, 0.0]]), np.array([[Q_11, Q_12], [Q_12, Q_22]])
    p = solve_continuous_lyapunov(A.T, -Q)
    actual = lyapunov(OBSERVER)
    assert actual == pytest.approx((p[0, 0], p[0, 1], p[1, 1]), rel=1e-9)
    assert observer_rate(actual, OBSERVER.Q) == pytest.approx(
        min(eigvals(np.linalg.solve(p, Q)).real), rel=1e-6
    )


@pytest.mark.parametrize(("alpha_1", "near"), [(40.0, 0.3), (4.0, 0.99)])
def test_estimated_position_stays_below_its_bound(alpha_1: float, near: float) -> None:
    """The worst disturbance changes its sign as the observer swings."""
    observer = ObserverConstants((alpha_1, 400.0), (1.0, 0.0, 1.0), 1.0, 1.0, 0.0)
    swing = math.sqrt(max(400.0 - alpha_1**2 / 4, 225.0))
    bound = certificate(GAINS, observer, Bounds((0.0,) * 4, acceleration=3.0)).observer_position

    def error(t: float, x: np.ndarray) -> list[float]:
        return [x[1] - alpha_1 * x[0], 3.0 * math.copysign(1.0, math.sin(swing * t)) - 400.0 * x[0]]

    solution = solve_ivp(error, (0.0, 5.0), [0.0, 0.0], max_step=1e-3)
    assert near * bound < np.abs(solution.y[0]).max() <= bound


@pytest.mark.parametrize(
    ("gains", "bounds", "sentence"),
    [
        ({"beta": (1.0, 0.0, 1.0, 1.0)}, {}, "beta must be positive"),
        ({"sigma": (1.0, -1.0, 1.0, 1.0)}, {}, "sigma must not be negative"),
        ({}, {"total": (math.nan, 0.0, 0.0, 0.0)}, "the bounds must not be negative"),
    ],
)
def test_invalid_gains_and_bounds_are_refused(gains: Any, bounds: Any, sentence: str) -> None:
    ones = dict.fromkeys(("beta", "zeta", "delta", "sigma"), (1.0,) * 4)
    with pytest.raises(ValueError, match=sentence):
        certificate(ControlGains(**{**ones, **gains}), OBSERVER, Bounds(**{"total": (0.0,) * 4, **bounds}))
