"""The controllers that RSBA is compared with, written a second time from the equations of their READMEs.

Beside `reference_model`, and like it taken from no block. All quantities are in SI units; x is
(x_hat, v_hat, i_q, i_d), x_d is (x_d, v_d, a_d).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .reference_model import Subsystems, Vector

LIFT = Subsystems(0.14, 2.4e-3, 2.4e-3, 0.15, 8, 2199.0, 35.26, 3.67, 0.0)


@dataclass(frozen=True)
class Given:
    """What a controller is given in one instant."""

    x: tuple[float, float, float, float]
    x_d: tuple[float, float, float]
    d_hat: float = 0.0
    u_available: float = 1e4


@dataclass(frozen=True)
class Limits:
    """What drive and motor can do, and the model that the controller has of them."""

    known: Subsystems = LIFT
    a_max: float = 1.2
    v_max: float = 0.136
    i_max: float = 105.0
    u_max: float = 445.0
    u_reserve: float = 0.05
    i_reserve: float = 0.0
    weaken_field: bool = True

    def longest(self, at: Given) -> float:
        return min(self.u_max, at.u_available)

    def beside_emf(self, at: Given, u: float) -> float:
        emf = self.known.N_p * self.known.alpha_RL * at.x[1] * (self.known.Phi_PM + self.known.L_d * at.x[3])
        return math.sqrt(max(u**2 - emf**2, (0.1 * u) ** 2))

    def flux(self, at: Given) -> float:
        speed = abs(self.known.N_p * self.known.alpha_RL * at.x[1])
        return math.inf if speed == 0.0 else (1.0 - self.u_reserve) * self.longest(at) / speed

    def weakest(self) -> float:
        return -min(self.known.Phi_PM / self.known.L_d, 0.7 * self.i_max) if self.weaken_field else 0.0

    def current(self, at: Given) -> float:
        flux, along = self.flux(at), self.known.Phi_PM + self.known.L_d * self.weakest()
        across = math.sqrt(max(flux**2 - along**2, (0.1 * flux) ** 2))
        return min((1.0 - self.i_reserve) * self.i_max, across / self.known.L_q)

    def i_d_ref(self, at: Given, i_q_ref: float) -> float:
        along = math.sqrt(
            max(self.flux(at) ** 2 - (self.known.L_q * i_q_ref) ** 2, 1e-4 * self.flux(at) ** 2)
        )
        return float(np.clip((along - self.known.Phi_PM) / self.known.L_d, self.weakest(), 0.0))

    def voltage(self, at: Given, q: float, d: float) -> tuple[float, float]:
        """q and d as the inverter can make them."""
        u = self.longest(at)
        d = float(np.clip(d, -self.beside_emf(at, u), self.beside_emf(at, u)))
        rest = math.sqrt(max(u**2 - d**2, 0.0))
        return float(np.clip(q, -rest, rest)), d

    def fastest(self, at: Given) -> float:
        """What may be asked for: 5 % less than v_max, the base speed, or 2 % more than the reference."""
        k = self.known
        omega = self.longest(at) / abs(complex(k.Phi_PM, k.L_q * self.i_max))
        return max(min(0.95 * self.v_max, omega / (k.N_p * k.alpha_RL)), 1.02 * abs(at.x_d[1]))

    def approach(self, at: Given, k: float, e: float) -> tuple[float, float]:
        """Speed beside the reference's that brings e to zero, and its slope over e."""
        knee = self.a_max / k**2
        if abs(e) <= knee:
            speed, slope = k * abs(e), k
        else:
            speed = math.sqrt(2.0 * self.a_max * (abs(e) - knee / 2.0))
            slope = self.a_max / speed
        total, most = at.x_d[1] + math.copysign(speed, e), self.fastest(at)
        return float(np.clip(total, -most, most)) - at.x_d[1], slope if abs(total) < most else 0.0

    def voltage_for(self, at: Given, rate_q: float, rate_d: float) -> tuple[float, float]:
        """Voltages in (26) that make the currents change at these rates."""
        g = self.known.g(at.x)
        return self.known.L_q * (rate_q - g[2]), self.known.L_d * (rate_d - g[3])


Result = tuple[Vector, dict[str, float]]
"""Rates of the states, and outputs by name."""


def outputs(u: tuple[float, float], i_q_ref: float, limited: bool, **more: float) -> dict[str, float]:
    """What all have, and more."""
    values = {"u_q": u[0], "u_d": u[1], "i_q_ref": i_q_ref, "saturated": limited, **more}
    return {name: float(value) for name, value in values.items()}


@dataclass(frozen=True)
class Foc:
    """FocController; states xi_q, xi_d, z."""

    limits: Limits = Limits()
    k_p: float = 150.0
    k_v: float = 600.0
    w_c: float = 2500.0
    w_i: float = 250.0
    omega_d: float = 0.0
    compensate: bool = True

    def evaluate(self, t: float, s: Vector, at: Given) -> Result:
        x, v, i_q, i_d = at.x
        lim, A_2, g_2 = self.limits, self.limits.known.A[1], self.limits.known.g(at.x)[1]
        v_ref = at.x_d[1] + lim.approach(at, self.k_p, at.x_d[0] - x)[0]
        correction = self.omega_d * (v - s[2])
        load = correction + (at.d_hat if self.compensate else 0.0)
        demanded_current = (at.x_d[2] + self.k_v * (v_ref - v) - load - g_2) / A_2
        i_ref = float(np.clip(demanded_current, -lim.current(at), lim.current(at)))
        error_q, error_d = i_ref - i_q, lim.i_d_ref(at, i_ref) - i_d
        demanded_voltage = lim.voltage_for(at, self.w_c * error_q + s[0], self.w_c * error_d + s[1])
        u = lim.voltage(at, *demanded_voltage)
        rates = [
            self.w_i * (self.w_c * error_q + (u[0] - demanded_voltage[0]) / lim.known.L_q),
            self.w_i * (self.w_c * error_d + (u[1] - demanded_voltage[1]) / lim.known.L_d),
            A_2 * i_q + g_2 + correction if self.omega_d > 0.0 else 0.0,
        ]
        names = dict(zip(("xi_q", "xi_d", "load.z"), s.tolist(), strict=True))
        more = {**names, "v_ref": v_ref, "load.d": load}
        return np.array(rates), outputs(u, i_ref, i_ref != demanded_current or u != demanded_voltage, **more)


CAC_STATES = (
    *("filter.w", "filter.w_rate", "filter.i_q", "filter.i_q_rate"),
    *("xi[1]", "xi[2]", "xi[3]", "xi[4]"),
    *("D[2]", "D[3]", "D[4]"),
)


@dataclass(frozen=True)
class Cac:
    """CacController; states in the order of CAC_STATES."""

    limits: Limits = Limits()
    k: Sequence[float] = (230.0, 230.0, 0.05, 1.0, 0.05)
    varpi: Sequence[float] = (3.0, 3.0, 0.03, 3.0, 0.03)
    m: Sequence[float] = (1.0, 12.0, 1.0)
    leak: float = 0.01
    epsilon: Sequence[float] = (0.1, 0.1, 1.0, 1.0)
    omega_n: Sequence[float] = (5000.0, 10000.0)
    damping: float = 1.0
    compensate: bool = True

    def evaluate(self, t: float, s: Vector, at: Given) -> Result:
        x, v, i_q, i_d = at.x
        lim, known = self.limits, self.limits.known
        A_2, g_2 = known.A[1], known.g(at.x)[1]
        w, w_rate, i_c, i_rate = s[:4]
        xi, D = s[4:8], s[8:]
        z = np.array([x - at.x_d[0], v - at.x_d[1] - w, i_q - i_c, i_d - lim.i_d_ref(at, i_c)])
        V = z - xi
        k = np.array([self.k[0], self.k[1], self.k[2], self.k[4]])
        push = np.array([self.varpi[i] for i in (0, 1, 2, 4)]) * np.tanh(V / np.array(self.epsilon))

        a_1 = float(np.clip(lim.approach(at, k[0], -z[0])[0] - push[0], -lim.v_max, lim.v_max))
        load = D[0] + (at.d_hat if self.compensate else 0.0)
        a_2 = (at.x_d[2] + w_rate - k[1] * z[1] - z[0] - g_2 - load - push[1]) / A_2
        limited = float(np.clip(a_2, -lim.current(at), lim.current(at)))
        rate_q = i_rate - (k[2] * z[2] + A_2 * z[1] + push[2]) / known.L_q - D[1]
        rate_d = -(k[3] * z[3] + push[3]) / known.L_d - D[2]
        demanded_voltage = lim.voltage_for(at, rate_q, rate_d)
        u = lim.voltage(at, *demanded_voltage)

        o_1, o_2 = self.omega_n
        filters = [
            w_rate,
            o_1**2 * (a_1 - w) - 2.0 * self.damping * o_1 * w_rate,
            i_rate,
            o_2**2 * (limited - i_c) - 2.0 * self.damping * o_2 * i_rate,
        ]
        compensation = [
            w - a_1 + xi[1] - k[0] * xi[0],
            A_2 * (i_c - a_2 + xi[2]) - xi[0] - k[1] * xi[1],
            (u[0] - demanded_voltage[0] - A_2 * xi[1] - k[2] * xi[2]) / known.L_q,
            (u[1] - demanded_voltage[1] - k[3] * xi[3]) / known.L_d,
        ]
        adaptation = np.array(self.m) * V[1:] - self.leak * D
        more = {**dict(zip(CAC_STATES, s, strict=True)), **{f"v[{i + 1}]": V[i] for i in range(4)}}
        i_ref = float(np.clip(i_c, -lim.i_max, lim.i_max))
        values = outputs(u, i_ref, limited != a_2 or u != demanded_voltage, **more)
        return np.array([*filters, *compensation, *adaptation]), values


@dataclass(frozen=True)
class Anatc:
    """AnatcController; states W_1 to W_5, delta."""

    limits: Limits = Limits()
    k_1: float = 0.14
    k_2: float = 0.7
    lambda_1: float = 1.22
    lambda_2: float = 0.66
    ell: Sequence[float] = (0.03, 0.03)
    g: float = 0.075
    b: float = 2.0
    sigma_min: float = 1e-9
    w_c: float = 2500.0
    compensate: bool = True

    def evaluate(self, t: float, s: Vector, at: Given) -> Result:
        x, v, i_q, i_d = at.x
        lim, known = self.limits, self.limits.known
        z_1 = x - at.x_d[0]
        speed, slope = lim.approach(at, self.k_1, -z_1)
        z_2 = v - at.x_d[1] - speed
        omega = known.alpha_RL * z_2
        sigma = max(self.g * math.exp(-self.b * t), self.sigma_min)
        h = omega / math.hypot(omega, sigma)
        S = np.exp(-2.0 * (v / lim.v_max - np.linspace(-1.0, 1.0, 5)) ** 2)
        unknown = float(s[:5] @ S + s[5] * h)

        g_2 = known.g((x, v, i_q, 0.0))[1]
        demanded_current = at.x_d[2] + slope * (at.x_d[1] - v) - g_2 - (at.d_hat if self.compensate else 0.0)
        asked_i = demanded_current / known.A[1] - unknown - self.k_2 * omega - known.alpha_RL * z_1
        bound = lim.current(at)
        i_ref = bound * math.tanh(asked_i / bound)
        open_ = 1.0 / math.cosh(min(abs(asked_i / bound), 300.0)) ** 2
        demanded_voltage = lim.voltage_for(
            at, self.w_c * (i_ref - i_q), self.w_c * (lim.i_d_ref(at, i_ref) - i_d)
        )
        u = lim.voltage(at, *demanded_voltage)

        mu = open_ if u == demanded_voltage else 0.0
        rates = [
            *(self.lambda_1 * (mu * omega * S - self.ell[0] * sigma * s[:5])),
            self.lambda_2 * (mu * omega * h - self.ell[1] * sigma * s[5]),
        ]
        more = {**{f"W[{i + 1}]": s[i] for i in range(5)}, "delta": s[5]}
        more |= {"z[1]": z_1, "z[2]": z_2, "unknown": unknown}
        return np.array(rates), outputs(u, i_ref, open_ < 0.5 or u != demanded_voltage, **more)
