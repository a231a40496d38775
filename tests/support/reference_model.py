"""One joint, written from the paper's equations a second time: what the tests compare against.

Numbers in parentheses are the paper's equations, names its labels. Nothing here is taken from the
blocks; where both agree, two readings of the paper agree. A state of the plant is the vector
x = (x_1, x_2, x_3, x_4) = (x_L, v_L, i_q, i_d); all quantities are in SI units. Only what is
deterministic is here: no sensor, no random part of (82). What a drive has beside the paper's plant is in
`reference_drive`.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from tests.support.reference_drive import NO_DRIVE, Drive, Transmission

Vector = NDArray[np.floating[Any]]
Four = tuple[float, float, float, float]
Wave = tuple[float, float, float]
"""Amplitude, angular frequency in rad/s, phase in rad."""


@dataclass(frozen=True)
class Subsystems:
    """A_i and g_i of (26) by Table I, with the numbers they need."""

    R_s: float
    L_d: float
    L_q: float
    Phi_PM: float
    N_p: int
    alpha_RL: float
    A_eq: float
    B_eq: float
    C_eq: float

    @cached_property
    def A(self) -> Vector:
        """A_1 to A_4."""
        k_t = 1.5 * self.N_p * self.Phi_PM
        return np.array([1.0, k_t / self.A_eq, 1.0 / self.L_q, 1.0 / self.L_d])

    def g(self, x: Sequence[float] | Vector) -> Vector:
        """g_1 to g_4."""
        x_1, x_2, x_3, x_4 = x
        omega = self.N_p * self.alpha_RL * x_2
        g_2 = (
            1.5 * self.N_p * (x_3 * x_4 * self.L_d - x_3 * x_4 * self.L_q) - self.B_eq * x_2 - self.C_eq * x_1
        )
        g_3 = -self.R_s * x_3 - omega * (x_4 * self.L_d + self.Phi_PM)
        g_4 = -self.R_s * x_4 + omega * x_3 * self.L_q
        return np.array([0.0, g_2 / self.A_eq, g_3 / self.L_q, g_4 / self.L_d])


# ---- plant ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Actuator:
    """The EMLA of Table IV, lift column; B_m and eta_GB are assumptions."""

    R_s: float = 0.14
    L_d: float = 2.4e-3
    L_q: float = 2.4e-3
    Phi_PM: float = 0.15
    N_p: int = 8
    J_m: float = 0.016
    J_c: float = 0.0
    J_GB: float = 0.0
    B_m: float = 1.67e-3
    rho: float = 1.0 / 7.0
    lead: float = 0.02
    M_BS: float = 156.5
    B_BS: float = 0.0
    eta_GB: float = 0.9
    C_eq: float = 0.0
    u_max: float = 445.0
    F: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """F_2, F_3, F_4 as fractions of g_2, g_3, g_4 (84)."""
    torque_from_command: bool = False
    """Whether i_q* drives the screw (9) instead of i_q (3)."""
    drive: Drive = NO_DRIVE
    """What it has beside the paper's plant."""

    @cached_property
    def known(self) -> Subsystems:
        """A_i and g_i that follow from the part's data ((4), (6))."""
        alpha_RL = 2.0 * math.pi / (self.rho * self.lead)
        A_eq = alpha_RL * (self.J_m + self.J_c + self.J_GB + self.M_BS / alpha_RL**2)
        B_eq = alpha_RL * (self.B_m + self.B_BS / alpha_RL**2)
        return Subsystems(
            self.R_s, self.L_d, self.L_q, self.Phi_PM, self.N_p, alpha_RL, A_eq, B_eq, self.C_eq
        )

    @property
    def D_eq(self) -> float:
        return 1.0 / (self.known.alpha_RL * self.eta_GB)


@dataclass(frozen=True)
class PlantInputs:
    """What acts on the plant; d_2 is an acceleration, d_3 and d_4 are voltages, sag a part of u_max."""

    u_q: float = 0.0
    u_d: float = 0.0
    i_q_ref: float = 0.0
    F_L: float = 0.0
    d_2: float = 0.0
    d_3: float = 0.0
    d_4: float = 0.0
    sag: float = 0.0


def shortened(u_q: float, u_d: float, u_max: float) -> tuple[float, float, bool]:
    """The voltage vector, kept in direction but no longer than u_max; and whether it was too long."""
    length = math.hypot(u_q, u_d)
    if length <= u_max:
        return u_q, u_d, False
    return u_q * u_max / length, u_d * u_max / length, True


def motor_voltage(p: Actuator, x: Vector, u: PlantInputs) -> tuple[float, float, bool]:
    """What the inverter gives: within the supply, less what dead time takes from each phase."""
    available = (1.0 - u.sag) * p.u_max
    u_q, u_d, saturated = shortened(u.u_q, u.u_d, available)
    if p.drive.dead_time is None:
        return u_q, u_d, saturated
    losses = [p.drive.dead_time.lost(i, math.sqrt(3.0) * available) for i in phase_currents(p, x)]
    e_d, e_q, _ = (2.0 * park(p, float(x[0])) / 3.0) @ losses
    return u_q + float(e_q), u_d + float(e_d), saturated


def force_against(p: Actuator, x: Vector, F_L: float) -> float:
    """Load, friction and end stops on the screw in N, as the motor feels them."""
    x_L, v_L = float(x[0]), float(x[1])
    d = p.drive
    force = F_L / p.eta_GB if d.eta_back is None else F_L + d.lost_in_gears(F_L, v_L, p.eta_GB)
    if d.friction is not None:
        force += d.friction.force(v_L, d.v_0)
    return force - (d.end_stops.force(x_L, v_L) if d.end_stops is not None else 0.0)


def cogging_torque(p: Actuator, x_L: float) -> float:
    """In N m, without current."""
    return 0.0 if p.drive.cogging is None else p.drive.cogging.torque(x_L / (p.rho * p.lead))


def plant_rates(p: Actuator, x: Vector, u: PlantInputs, rise: float = 0.0) -> Vector:
    """(26) with d_1 = 0, the load of Table I and the uncertainties (84); rise is that of the winding in K."""
    u_q, u_d, _ = motor_voltage(p, x, u)
    warm = 1.0 if p.drive.winding is None else 1.0 + p.drive.winding.alpha_R * rise
    A, g = p.known.A, replace(p.known, R_s=warm * p.R_s).g(x)
    F = np.array([0.0, *p.F]) * g
    drive = np.array([x[1], u.i_q_ref if p.torque_from_command else x[2], u_q, u_d])
    load = force_against(p, x, u.F_L) / (p.known.alpha_RL * p.known.A_eq)
    cogging = cogging_torque(p, float(x[0])) / p.known.A_eq
    d = np.array([0.0, u.d_2 - load + cogging, u.d_3 / p.L_q, u.d_4 / p.L_d])
    return A * drive + g + F + d


def heating(p: Actuator, x: Vector, rise: float) -> float:
    """Rate of the winding's temperature rise in K/s."""
    winding = p.drive.winding
    return 0.0 if winding is None else winding.rate(float(x[2]), float(x[3]), rise, p.R_s)


def measured(p: Actuator, x_L: float) -> float:
    """The position in m that the encoder at the motor measures."""
    return x_L if p.drive.encoder is None else p.drive.encoder.reads(x_L, x_L / (p.rho * p.lead), p.lead)


def plant_outputs(p: Actuator, x: Vector, u: PlantInputs) -> dict[str, float]:
    """What can be seen of the plant, by the names of its FMU; sensors have no noise."""
    x_L, v_L, i_q, i_d = (float(value) for value in x)
    u_q, u_d, saturated = motor_voltage(p, x, u)
    magnet_current = u.i_q_ref if p.torque_from_command else i_q
    winding = p.drive.winding
    return {
        "x_L": x_L,
        "v_L": v_L,
        "i_q": i_q,
        "i_d": i_d,
        "x_measured": measured(p, x_L),
        "i_q_measured": i_q,
        "i_d_measured": i_d,
        "inverter.u_available": (1.0 - u.sag) * p.u_max,
        "a_L": float(plant_rates(p, x, u)[1]),
        "tau_m": 1.5 * p.N_p * (i_q * i_d * p.L_d + magnet_current * p.Phi_PM - i_d * i_q * p.L_q)
        + cogging_torque(p, x_L),
        "omega_m": p.known.alpha_RL * v_L,
        "inverter.u_q": u_q,
        "inverter.u_d": u_d,
        "inverter.saturated": float(saturated),
        "motor.load": 0.0 if winding is None else winding.load(i_q, i_d),
        "P_el": 1.5 * ((u_q + u.d_3) * i_q + (u_d + u.d_4) * i_d),
        "P_L": u.F_L * v_L,
        **dict(zip(("phase.i_a", "phase.i_b", "phase.i_c"), phase_currents(p, x), strict=True)),
    }


def compliant_rates(p: Actuator, t: Transmission, x: Vector, u: PlantInputs, rise: float = 0.0) -> Vector:
    """x = (x_L, v_L, i_q, i_d, deflection, speed of the load): the transmission loads the screw."""
    force = t.force(float(x[4]), float(x[1] - x[5]))
    motor_rates = plant_rates(p, x[:4], replace(u, F_L=force), rise)
    return np.array([*motor_rates, x[1] - x[5], (force - u.F_L) / t.m])


def compliant_outputs(p: Actuator, t: Transmission, x: Vector, u: PlantInputs) -> dict[str, float]:
    """What can be seen of the plant with a second mass, by the names of its FMU."""
    force = t.force(float(x[4]), float(x[1] - x[5]))
    return {
        **plant_outputs(p, x[:4], replace(u, F_L=force)),
        "P_L": float(u.F_L * x[5]),
        "transmission.deflection": float(x[4]),
        "transmission.force": force,
        "load.x": float(x[0] - x[4]),
        "load.x_measured": float(x[0] - x[4]),
        "load.v": float(x[5]),
        "load.a": (force - u.F_L) / t.m,
    }


def phase_currents(p: Actuator, x: Vector) -> list[float]:
    """The currents that (2) turns into i_d, i_q and 0."""
    return np.linalg.solve(2.0 * park(p, float(x[0])) / 3.0, [x[3], x[2], 0.0]).tolist()


def park(p: Actuator, x_L: float) -> Vector:
    """The matrix of (2) without its factor 2/3: rows d, q and zero sequence."""
    angle, third = p.N_p * p.known.alpha_RL * x_L, 2.0 * math.pi / 3.0
    shifted = np.array([angle, angle - third, angle + third])
    return np.array([np.cos(shifted), -np.sin(shifted), np.full(3, 0.5)])


# ---- observer ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Observer:
    """Observer (17) to (25) with the numbers of (85) to (87) for the lift.

    ||y_bar|| is read as the absolute value, which (25) needs.
    """

    alpha: tuple[float, float] = (0.3192, 0.3129)
    Q: tuple[float, float, float] = (0.7752, -0.0775, 0.3949)
    """Q_11, Q_12, Q_22."""
    H_0: float = 20.0
    m_0: float = 200.0
    m_decay: float = 0.001
    ell: float = 1.0
    knows_command: bool = True
    """Whether B u + g of (20) is there."""
    A_2: float = 1.5 * 8 * 0.15 / 35.26
    """Acceleration per commanded current, as the observer knows it."""
    friction: float = 3.67 / 35.26
    """B_eq / A_eq as the observer knows it, 1/s."""
    measures_current: bool = False
    """Whether B u is made of the measured current instead of the commanded one."""
    omega_d: float = 0.0
    """Gain of the estimated disturbance over that of the speed, 1/s."""
    omega_r: float = 0.0
    """Gain of the disturbance's estimated rate over that of the disturbance, 1/s."""
    ahead: float = 0.0
    """Time by which d_hat predicts the disturbance, s."""

    @cached_property
    def A_bar(self) -> Vector:
        """A - alpha C (Assumption 1)."""
        return np.array([[0.0, 1.0], [0.0, 0.0]]) - np.outer(self.alpha, [1.0, 0.0])

    @cached_property
    def p(self) -> Vector:
        """The solution of p A_bar + A_bar' p = -Q (18)."""
        Q = np.array([[self.Q[0], self.Q[1]], [self.Q[1], self.Q[2]]])
        identity = np.eye(2)
        # row by row: vec(p A_bar) = (1 x A_bar') vec(p), vec(A_bar' p) = (A_bar' x 1) vec(p)
        lyapunov = np.kron(identity, self.A_bar.T) + np.kron(self.A_bar.T, identity)
        return np.linalg.solve(lyapunov, -Q.ravel()).reshape(2, 2)

    @cached_property
    def p_inverse_C(self) -> Vector:
        """p^-1 C'."""
        return np.linalg.solve(self.p, [1.0, 0.0])

    def H(self, y: float) -> float:
        """(86)."""
        return self.H_0 * (math.cos(y) ** 4 + math.sin(y) ** 4)

    def m(self, t: float) -> float:
        return self.m_0 * math.exp(-self.m_decay * t)


def observer_f(o: Observer, t: float, s: Vector, y: float) -> float:
    """(21); s = (x_hat, v_hat, d_hat, eta_hat, r_hat)."""
    y_bar, eta_H = y - s[0], s[3] * o.H(y)
    return float(eta_H**2 * y_bar / (eta_H * abs(y_bar) + o.m(t)))


def observer_rates(o: Observer, t: float, s: Vector, y: float, i_q_ref: float, i_q: float = 0.0) -> Vector:
    """(20) with A = [0 1; 0 0], B = [0; A_2], C = [1 0], and (23).

    The disturbance d is a ramp: d' = r + omega_d alpha_2 y_bar, r' = omega_r omega_d alpha_2 y_bar. The state
    d_hat is d + r `ahead`.
    """
    x_hat, v_hat, d_hat, eta_hat, r_hat = s
    y_bar = y - x_hat
    model = o.A_2 * (i_q if o.measures_current else i_q_ref) - o.friction * v_hat if o.knows_command else 0.0
    modelled = np.array([v_hat, model + (d_hat - r_hat * o.ahead)])
    x_hat_rate = modelled + np.array(o.alpha) * y_bar + o.p_inverse_C * observer_f(o, t, s, y)
    eta_hat_rate = -o.m(t) * o.ell * eta_hat + o.ell * o.H(y) * abs(y_bar)
    r_hat_rate = o.omega_r * o.omega_d * o.alpha[1] * y_bar
    d_hat_rate = r_hat + o.omega_d * o.alpha[1] * y_bar + r_hat_rate * o.ahead
    return np.array([*x_hat_rate, d_hat_rate, eta_hat_rate, r_hat_rate])


def observer_outputs(o: Observer, t: float, s: Vector, y: float) -> dict[str, float]:
    """What can be seen of the observer, by the names of its FMU."""
    names = ("x_hat", "v_hat", "d_hat", "eta_hat", "r_hat")
    return {
        **dict(zip(names, s.tolist(), strict=True)),
        "y_bar": float(y - s[0]),
        "f": observer_f(o, t, s, y),
    }


# ---- controller ----------------------------------------------------------------------------


@dataclass(frozen=True)
class Controller:
    """RSBA (27) to (41) with the lift's gains of Table V; the switches are the repairs."""

    known: Subsystems = Subsystems(0.14, 2.4e-3, 2.4e-3, 0.15, 8, 2199.0, 35.26, 3.67, 0.0)
    beta: Four = (3000.0, 3000.0, 1000.0, 1000.0)
    zeta: Four = (100.0, 100.0, 100.0, 100.0)
    delta: Four = (100.0, 100.0, 110.0, 110.0)
    sigma: Four = (0.001, 0.001, 0.01, 0.01)
    x_2d_in_a_1: bool = True
    """Whether (31) contains -x_2d, as printed."""
    feed_acceleration: bool = False
    """Whether u_2 contains the derivative of x_2d over A_2."""
    a_max: float = math.inf
    """Acceleration that a_1 may ask for."""
    i_max: float = math.inf
    """Largest |i_q*|."""
    u_max: float = math.inf
    """Longest voltage vector."""
    theta_max: float = math.inf
    approach_time: float = 5e-5
    """Time in s that theta would at least take to theta_max."""
    freeze: bool = False
    """Whether adaptation rests while the actuator saturates, and ends at theta_max."""
    compensate: bool = False
    """Whether u_2 takes off the estimated disturbance."""
    v_max: float = math.inf
    """Speed that a_1 may ask for, beside that of the reference; infinite is none at all."""
    weaken: bool = False
    """Whether i_d* makes room for i_q* in the voltage."""
    u_reserve: float = 0.1
    """Part of u_max that i_d* leaves."""
    i_reserve: float = 0.0
    """Part of i_max that i_q* leaves."""
    omega_u: float = 0.0
    """Bandwidth of the estimates of the voltages that act unknown, 1/s."""


@dataclass(frozen=True)
class Signals:
    """What the controller computes in one instant."""

    i_q_ref: float
    u_q: float
    u_d: float
    P: Vector
    current_limited: bool
    voltage_limited: bool


def approach(c: Controller, k: float, P_1: float) -> float:
    """Speed towards the reference: k P_1, beyond a_max / k^2 what a_max can brake."""
    e = abs(P_1)
    if e <= c.a_max / k**2:
        return k * P_1
    return math.copysign(math.sqrt(2.0 * c.a_max * (e - c.a_max / (2.0 * k**2))), P_1)


def fastest(c: Controller, v_d: float) -> float:
    """Speed in m/s that a_1 and reference may have together: v_max with 5 % left, and the base speed."""
    if math.isinf(c.v_max):
        return math.inf
    k = c.known
    # u_max^2 = (omega Phi)^2 + (omega L_q i_max)^2
    omega = c.u_max / abs(complex(k.Phi_PM, k.L_q * c.i_max))
    return max(min(0.95 * c.v_max, omega / (k.N_p * k.alpha_RL)), 1.02 * abs(v_d))


def weakest(c: Controller) -> float:
    """The most negative i_d* in A."""
    return -min(c.known.Phi_PM / c.known.L_d, 0.7 * c.i_max)


def flux(c: Controller, v: float) -> float:
    """Longest flux linkage in Wb that the voltage can turn at this speed."""
    k = c.known
    return (1.0 - c.u_reserve) * c.u_max / max(abs(k.N_p * k.alpha_RL * v), 1e-6)


def room_for_i_q(c: Controller, v: float) -> float:
    """The largest i_q in A: L_q i_q and the weakest field on the circle of the flux."""
    psi, field = flux(c, v), c.known.Phi_PM + c.known.L_d * weakest(c)
    return math.sqrt(max(psi**2 - field**2, (0.1 * psi) ** 2)) / c.known.L_q


def room_made(c: Controller, i_q: float, v: float) -> float:
    """i_d* in A: L_q i_q and Phi + L_d i_d on the same circle, or no field left to weaken."""
    psi, k = flux(c, v), c.known
    field = math.sqrt(max(psi**2 - (k.L_q * i_q) ** 2, (0.01 * psi) ** 2))
    return min(max((field - k.Phi_PM) / k.L_d, weakest(c)), 0.0)


def control(
    c: Controller,
    theta: Vector,
    x: Sequence[float] | Vector,
    x_d: Sequence[float],
    d_hat: float = 0.0,
    z: Sequence[float] | Vector = (0.0, 0.0),
) -> Signals:
    """Algorithm 2; x is what is measured or estimated, x_d = (x_1d, x_2d, derivative of x_2d)."""
    A, g = c.known.A, c.known.g(x)
    gain = 0.5 * (np.array(c.beta) + np.array(c.zeta) * theta[:4])
    d = (0.0, d_hat if c.compensate else 0.0, c.omega_u * (x[2] - z[0]), c.omega_u * (x[3] - z[1]))

    def W(i: int, P_i: float) -> float:  # (41), less what is estimated
        return float(-(gain[i - 1] * P_i + g[i - 1] + d[i - 1]) / A[i - 1])

    P_1 = x[0] - x_d[0]
    most = fastest(c, x_d[1])
    demanded = min(max(x_d[1] - approach(c, float(gain[0]), P_1), -most), most) - x_d[1]
    a_1 = demanded - (x_d[1] if c.x_2d_in_a_1 else 0.0)  # (31)
    P_2 = x[1] - x_d[1] - a_1
    u_2 = W(2, P_2) - P_1 * A[0] / A[1] + (x_d[2] / A[1] if c.feed_acceleration else 0.0)
    i_max = min((1.0 - c.i_reserve) * c.i_max, room_for_i_q(c, float(x[1])) if c.weaken else math.inf)
    i_q_ref = min(max(u_2, -i_max), i_max) if math.isfinite(c.i_max) else u_2
    i_d_ref = room_made(c, i_q_ref, float(x[1])) if c.weaken else 0.0
    P_3, P_4 = x[2] - i_q_ref, x[3] - i_d_ref
    u_q, u_d, voltage_limited = shortened(W(3, P_3), W(4, P_4), c.u_max)
    P = np.array([P_1, P_2, P_3, P_4])
    limited = math.isfinite(c.i_max) and bool(abs(u_2) > i_max)
    return Signals(float(i_q_ref), u_q, u_d, P, limited, voltage_limited)


def adaptation(c: Controller, theta: Vector, s: Signals) -> Vector:
    """(32), with the repairs."""
    delta, sigma, zeta = (np.array(gains) for gains in (c.delta, c.sigma, c.zeta))
    rates = -delta * sigma * theta + 0.5 * zeta * delta * s.P**2
    if c.freeze:
        rates = np.minimum(rates, (c.theta_max - theta) / c.approach_time)
        if s.voltage_limited:
            rates[:] = 0.0
        elif s.current_limited:
            rates[:2] = 0.0
    return rates


def currents_of_known(
    c: Controller, x: Sequence[float] | Vector, z: Sequence[float] | Vector, s: Signals
) -> Vector:
    """Rates of z_q and z_d: the currents under the voltages that are known and estimated."""
    if c.omega_u == 0.0:
        return np.zeros(2)
    A, g = c.known.A, c.known.g(x)
    i, u = np.array([x[2], x[3]]), np.array([s.u_q, s.u_d])
    return A[2:] * u + g[2:] + c.omega_u * (i - np.array(z))


def controller_outputs(
    theta: Vector, s: Signals, z: Sequence[float] | Vector = (0.0, 0.0)
) -> dict[str, float]:
    """What can be seen of the controller, by the names of its FMU."""
    return {
        **{f"theta[{i + 1}]": float(theta[i]) for i in range(4)},
        "u_q": s.u_q,
        "u_d": s.u_d,
        "i_q_ref": s.i_q_ref,
        "saturated": float(s.current_limited or s.voltage_limited),
        "z_q": float(z[0]),
        "z_d": float(z[1]),
        **{f"P[{i + 1}]": float(s.P[i]) for i in range(4)},
    }


# ---- reference and disturbance -------------------------------------------------------------

QUINTIC = Polynomial([0.0, 0.0, 0.0, 10.0, -15.0, 6.0])
"""s(r) from rest to rest, 0 at r = 0 and 1 at r = 1."""
QUINTIC_1, QUINTIC_2 = QUINTIC.deriv(1), QUINTIC.deriv(2)


@dataclass(frozen=True)
class Motion:
    """Quintic moves from way-point to way-point; with `period` 0 they are not repeated."""

    waypoints: tuple[float, ...]
    starts: tuple[float, ...]
    durations: tuple[float, ...]
    period: float = 0.0


def reference(motion: Motion, t: float) -> tuple[float, float, float]:
    """x_d, v_d, a_d: the way-point last reached, or the move that is on."""
    if motion.period > 0.0:
        t = t % motion.period
    x_d = motion.waypoints[0]
    for i, (start, T) in enumerate(zip(motion.starts, motion.durations, strict=True)):
        if t <= start:
            break
        d, r = motion.waypoints[i + 1] - motion.waypoints[i], (t - start) / T
        if r < 1.0:
            s, s_1, s_2 = (float(q(r)) for q in (QUINTIC, QUINTIC_1, QUINTIC_2))
            return x_d + d * s, d * s_1 / T, d * s_2 / T**2
        x_d = motion.waypoints[i + 1]
    return x_d, 0.0, 0.0


@dataclass(frozen=True)
class Surroundings:
    """Load, (82) without its random part, and (83)."""

    levels: tuple[float, ...] = (0.0,)
    level_starts: tuple[float, ...] = ()
    """When levels 2, 3, ... begin."""
    ramp: float = 0.5
    ripple: Wave = (0.0, 0.0, 0.0)
    sines_2: tuple[Wave, ...] = ()
    arctan_2: float = 0.0
    decay_2: float = 0.0
    cosines_3: tuple[Wave, ...] = ()
    cosine_4: Wave = (0.0, 0.0, 0.0)
    d_2_is_force: bool = False
    """Read (82) in N: it then acts against the load force."""
    sag: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """What the supply lacks as a fraction, from when on and for how long in s."""


def disturbance(s: Surroundings, t: float, v_L: float) -> dict[str, float]:
    """F_L, d_2, d_3, d_4 and the supply's sag by name."""
    points, forces = [0.0], [s.levels[0]]
    for i, start in enumerate(s.level_starts):
        points += [start, start + s.ramp]
        forces += [s.levels[i], s.levels[i + 1]]
    a, omega, phase = s.ripple
    load = float(np.interp(t, points, forces)) + a * math.sin(omega * t + phase)
    d_2 = s.arctan_2 * math.atan(v_L) * math.exp(-s.decay_2 * t)
    d_2 += sum(a * math.sin(omega * t + phase) for a, omega, phase in s.sines_2)
    d_3 = sum(a * math.cos(omega * t + phase) for a, omega, phase in s.cosines_3)
    a, omega, phase = s.cosine_4
    return {
        "F_L": load - d_2 if s.d_2_is_force else load,
        "d_2": 0.0 if s.d_2_is_force else d_2,
        "d_3": d_3,
        "d_4": a * math.cos(omega * t + phase),
        "supply.sag": s.sag[0] if s.sag[1] <= t < s.sag[1] + s.sag[2] else 0.0,
    }


# ---- the whole joint -----------------------------------------------------------------------

JOINT_STATES = (
    *("x_L", "v_L", "i_q", "i_d"),
    *("x_hat", "v_hat", "d_hat", "eta_hat", "r_hat"),
    *("theta[1]", "theta[2]", "theta[3]", "theta[4]", "z_q", "z_d"),
)
"""Names of the joint's states in the order of its state vector."""


@dataclass(frozen=True)
class Joint:
    """All parts of one joint, with the observer in the loop."""

    plant: Actuator
    observer: Observer
    controller: Controller
    motion: Motion
    surroundings: Surroundings


def joint_rates(j: Joint, t: float, s: Vector) -> Vector:
    """Right-hand side of the whole joint, with every exchange between its parts instantaneous."""
    x, estimate, theta, z = s[:4], s[4:9], s[9:13], s[13:]
    y = float(x[0])
    believed = (estimate[0], estimate[1], x[2], x[3])
    signals = control(j.controller, theta, believed, reference(j.motion, t), float(estimate[2]), z)
    outside = disturbance(j.surroundings, t, float(x[1]))
    sag = outside.pop("supply.sag")
    u = PlantInputs(signals.u_q, signals.u_d, signals.i_q_ref, sag=sag, **outside)
    return np.concatenate(
        [
            plant_rates(j.plant, x, u),
            observer_rates(j.observer, t, estimate, y, signals.i_q_ref, float(x[2])),
            adaptation(j.controller, theta, signals),
            currents_of_known(j.controller, believed, z, signals),
        ]
    )


def solve(
    rates: Callable[[float, Vector], Vector],
    start: Sequence[float] | Vector,
    times: Sequence[float] | Vector,
    *,
    method: Any = "DOP853",
    rtol: float = 1e-12,
    atol: float | Sequence[float] = 1e-15,
) -> Vector:
    """States at `times` (one row each, the first at times[0] is `start`)."""
    solution = solve_ivp(
        rates, (times[0], times[-1]), np.asarray(start), method, times, rtol=rtol, atol=np.asarray(atol)
    )
    if not solution.success:
        raise RuntimeError(solution.message)
    return solution.y.T
