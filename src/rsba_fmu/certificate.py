"""Evaluate the paper's stability proof for a set of gains: decay rates and ultimate bounds as numbers.

Numbers in parentheses are those of the equations as printed. mu_i, nu_i, psi_i and theta*_i of (43) are free
positive constants there. Here they are chosen to minimise the bound. With D_i = Lambda_i r_i + d_max(i) +
Omega_i and T_i = zeta_i theta*_i, the terms of (61) and (63) depend on D_i^2 / T_i + sigma_i T_i^2 /
zeta_i^2. This is least at T_i^3 = D_i^2 zeta_i^2 / (2 sigma_i), which gives 3/4 D_i^2 / T_i.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

Four = tuple[float, float, float, float]


@dataclass(frozen=True)
class ControlGains:
    """beta_i in 1/s, zeta_i, delta_i and sigma_i of (31), (32) and (39) for the four subsystems."""

    beta: Four
    zeta: Four
    delta: Four
    sigma: Four


@dataclass(frozen=True)
class ObserverConstants:
    """alpha_1 in 1/s, alpha_2 in 1/s2, Q of (18), ell of (23), and m(t) = m_0 exp(-m_decay t) of (21)."""

    alpha: tuple[float, float]
    Q: tuple[float, float, float]
    """Q_11, Q_12, Q_22."""
    ell: float
    m_0: float
    m_decay: float


@dataclass(frozen=True)
class Bounds:
    """Upper bounds of the disturbances on a loop during `duration` s.

    `total` has D_i = Lambda_i r_i + d_max(i) + Omega_i of (35) in m/s, m/s2, A/s, A/s. `acceleration` is
    |K_2| of (17) in m/s2, the acceleration that the observer does not know.
    """

    total: Four
    acceleration: float = 0.0
    duration: float = 10.0


@dataclass(frozen=True)
class Certificate:
    """Constants of the proof. Norms of P = (P_1, ..., P_4) mix m, m/s and A as in the paper.

    `phi` are phi_0 of (55), phi_1 of (65), phi_2 of (69), phi_3 and phi_4 of (73) in 1/s. `phi_total` of
    (80) is their minimum, and |P| decays with `rate` = phi_total / 2. `theta_star` are (43), `residual` the
    constant terms of (78) except for the observer's. `ultimate` is the remaining norm of P, inf if the
    proof gives none.

    Since theta_hat only adds damping, |P|' <= -beta_min / 2 |P| + |D| holds without (43), too. It gives
    `direct_rate` in 1/s, the remaining norm `direct_ultimate`, and the bounds `position` in m of |P_1| and
    `current` in A of |P_3|. `observer_rate` is that of x_eo' p x_eo by (18), in 1/s. `observer_position`
    in m is the largest error of the estimated position that |K_2| can cause with f = 0.
    """

    phi: tuple[float, float, float, float, float]
    phi_total: float
    rate: float
    theta_star: Four
    residual: float
    ultimate: float
    direct_rate: float
    direct_ultimate: float
    position: float
    current: float
    p: tuple[float, float, float]
    observer_rate: float
    observer_position: float

    def direct_bound(self, time: float, start: float) -> float:
        """Return a bound of the norm of P at `time` s from a norm `start`, without the adaptation."""
        fallen = math.exp(-self.direct_rate * time)
        return start * fallen + self.direct_ultimate * (1.0 - fallen)

    def lyapunov_bound(self, time: float, start: float) -> float:
        """Return a bound of V_1 + ... + V_4 of (57), (66), (70) at `time` s from `start`; inf if unproven."""
        rate = min(self.phi[1:])
        if rate <= 0.0 or math.isinf(self.residual):
            return math.inf
        fallen = math.exp(-rate * time)
        return start * fallen + self.residual / rate * (1.0 - fallen)


def certificate(gains: ControlGains, observer: ObserverConstants, bounds: Bounds) -> Certificate:
    """Return the constants of the proof. Raises ValueError for negative gains or bounds."""
    _check(gains, observer, bounds)
    least_m = observer.m_0 * math.exp(-observer.m_decay * bounds.duration)
    each = [min(b, d * s) for b, d, s in zip(gains.beta, gains.delta, gains.sigma, strict=True)]
    phi = (min(1.0, least_m * observer.ell), each[0], each[1], each[2], each[3])
    theta, residuals = zip(
        *(_adapted(*of) for of in zip(bounds.total, gains.zeta, gains.sigma, strict=True)), strict=True
    )
    residual = sum(residuals)
    control_rate = min(each)
    slowest = min(gains.beta)
    remaining = 2.0 * math.hypot(*bounds.total) / slowest
    # position and speed do not depend on the currents in (36), so only their own terms count
    mechanical = 2.0 * math.hypot(*bounds.total[:2]) / min(gains.beta[:2])
    p = lyapunov(observer)
    rate = observer_rate(p, observer.Q)
    return Certificate(
        phi=phi,
        phi_total=min(phi),
        rate=min(phi) / 2.0,
        theta_star=(theta[0], theta[1], theta[2], theta[3]),
        residual=residual,
        ultimate=math.sqrt(2.0 * residual / control_rate) if control_rate > 0.0 else _nothing(residual),
        direct_rate=slowest / 2.0,
        direct_ultimate=remaining,
        position=min(2.0 * (bounds.total[0] + mechanical) / gains.beta[0], mechanical),
        current=2.0 * bounds.total[2] / gains.beta[2],
        p=p,
        observer_rate=rate,
        observer_position=bounds.acceleration * _peak_gain(*observer.alpha),
    )


def lyapunov(observer: ObserverConstants) -> tuple[float, float, float]:
    """Return p_11, p_12 and p_22 of (18)."""
    (alpha_1, alpha_2), (Q_11, Q_12, Q_22) = observer.alpha, observer.Q
    p_12 = -Q_22 / 2.0
    p_11 = (Q_11 / 2.0 - alpha_2 * p_12) / alpha_1
    return p_11, p_12, (p_11 - alpha_1 * p_12 + Q_12) / alpha_2


def observer_rate(p: Sequence[float], Q: Sequence[float]) -> float:
    """Return the largest rate with -x' Q x <= -rate x' p x, in 1/s: the least eigenvalue of p^-1 Q."""
    determinant = p[0] * p[2] - p[1] * p[1]
    trace = (p[2] * Q[0] - 2.0 * p[1] * Q[1] + p[0] * Q[2]) / determinant
    product = (Q[0] * Q[2] - Q[1] * Q[1]) / determinant
    # compute the larger root first: a difference would lose all digits of a far smaller one
    return product / (0.5 * trace + math.sqrt(max(0.25 * trace * trace - product, 0.0)))


def _peak_gain(alpha_1: float, alpha_2: float) -> float:
    """Return the peak gain of 1 / (s^2 + alpha_1 s + alpha_2) for inputs within +-1, in s2."""
    damping = alpha_1 / (2.0 * math.sqrt(alpha_2))
    if damping >= 1.0:
        return 1.0 / alpha_2  # its impulse response has one sign
    return 1.0 / (alpha_2 * math.tanh(0.5 * math.pi * damping / math.sqrt(1.0 - damping * damping)))


def _adapted(D: float, zeta: float, sigma: float) -> tuple[float, float]:
    """Return theta* and the constant terms of one subsystem, with the best free constants."""
    if D == 0.0:
        return 0.0, 0.0
    if zeta == 0.0:
        return math.inf, math.inf  # (43) divides by it
    if sigma == 0.0:
        return math.inf, 0.0  # without leak a large theta* costs nothing
    T = (D * D * zeta * zeta / (2.0 * sigma)) ** (1.0 / 3.0)
    return T / zeta, 0.75 * D * D / T


def _nothing(residual: float) -> float:
    """Return the remaining bound without any decay: 0 if nothing acts, else inf."""
    return math.inf if residual > 0.0 else 0.0


def _check(gains: ControlGains, observer: ObserverConstants, bounds: Bounds) -> None:
    positive = {"beta": gains.beta, "alpha": observer.alpha, "the eigenvalues of Q": _eigenvalues(observer.Q)}
    other = {
        "zeta": gains.zeta,
        "delta": gains.delta,
        "sigma": gains.sigma,
        "ell and m": (observer.ell, observer.m_0, observer.m_decay),
        "the bounds": (*bounds.total, bounds.acceleration, bounds.duration),
    }
    for name, values in positive.items():
        if not all(x > 0.0 for x in values):
            raise ValueError(f"{name} must be positive, not {values}")
    for name, values in other.items():
        if not all(x >= 0.0 for x in values):
            raise ValueError(f"{name} must not be negative, as {values} are")


def _eigenvalues(Q: Sequence[float]) -> tuple[float, float]:
    middle, half = 0.5 * (Q[0] + Q[2]), math.hypot(0.5 * (Q[0] - Q[2]), Q[1])
    return middle - half, middle + half
