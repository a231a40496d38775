"""Ports of the controllers from the equations and tables of their READMEs alone, over many steps.

Start values and names come from the tables; the equations are written here in the symbols of the
pages. Nothing is imported from the controllers' own code but the blocks that are compared.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from types import SimpleNamespace

import numpy as np
import pytest

from fmublock import Block
from rsba_fmu import AnatcController, CacController, FocController, RsbaController
from tests.support.in_process import started
from tests.support.readme_port import Laws, Numbers, Values, clip, stepped, table

STEP = 1e-4

Drawn = Callable[[np.random.Generator], Values]


def rsba(p: Mapping, x: Numbers, u: SimpleNamespace, t: float) -> tuple[Numbers, Numbers]:
    theta = [x[f"theta[{i + 1}]"] for i in range(4)]
    k = [0.5 * (p["beta"][i] + p["zeta"][i] * theta[i]) for i in range(4)]
    N_p, Phi, L_d, L_q, R_s = (p[f"model.{n}"] for n in ("N_p", "Phi_PM", "L_d", "L_q", "R_s"))
    alpha, A_eq, B_eq, C_eq = (p[f"model.{n}"] for n in ("alpha_RL", "A_eq", "B_eq", "C_eq"))
    a_max, i_max, v_max, r, r_i = (
        p[f"limit.{n}"] for n in ("a_max", "i_max", "v_max", "u_reserve", "i_reserve")
    )
    u_max = min(p["limit.u_max"], u.u_available) if p["measure_supply"] else p["limit.u_max"]
    omega_u = p["omega_u"]
    A_2, A_3, A_4 = 3.0 * N_p * Phi / (2.0 * A_eq), 1.0 / L_q, 1.0 / L_d
    g_2 = (1.5 * N_p * u.i_q * u.i_d * (L_d - L_q) - B_eq * u.v_hat - C_eq * u.x_hat) / A_eq
    g_3 = (-R_s * u.i_q - N_p * alpha * u.v_hat * (u.i_d * L_d + Phi)) / L_q
    g_4 = (-R_s * u.i_d + N_p * alpha * u.v_hat * u.i_q * L_q) / L_d

    P_1 = u.x_hat - u.x_d
    e, e_0, w = abs(P_1), a_max / k[0] ** 2, k[0] * P_1
    if p["limit_acceleration"] and e > e_0:
        w = math.copysign(math.sqrt(2.0 * a_max * (e - e_0 / 2.0)), P_1)
    if p["limit_speed"]:
        v_b = u_max / (N_p * alpha * math.sqrt(Phi**2 + L_q**2 * i_max**2))
        v = max(min(0.95 * v_max, v_b), 1.02 * abs(u.v_d))
        w = u.v_d - clip(u.v_d - w, -v, v)
    P_2 = u.v_hat - u.v_d + w + p["x_2d_in_a_1"] * u.v_d
    fed = p["feed_acceleration"] * u.a_d - p["compensate"] * u.d_hat
    u_2 = (-k[1] * P_2 - P_1 - g_2 + fed) / A_2

    psi = (1.0 - r) * u_max / abs(N_p * alpha * u.v_hat)
    i_f = -min(Phi / L_d, 0.7 * i_max)
    i_l = math.sqrt(max(psi**2 - (Phi + L_d * i_f) ** 2, 0.01 * psi**2)) / L_q
    limit = min((1.0 - r_i) * i_max, i_l) if p["weaken_field"] else (1.0 - r_i) * i_max
    i_q_ref = clip(u_2, -limit, limit) if p["limit_current"] else u_2
    i_d_ref = (math.sqrt(max(psi**2 - (L_q * i_q_ref) ** 2, 1e-4 * psi**2)) - Phi) / L_d
    P_3, P_4 = u.i_q - i_q_ref, u.i_d - (clip(i_d_ref, i_f, 0.0) if p["weaken_field"] else 0.0)

    d_3, d_4 = omega_u * (u.i_q - x["z_q"]), omega_u * (u.i_d - x["z_d"])
    u_3 = (-k[2] * P_3 - g_3 - d_3) / A_3
    u_4 = (-k[3] * P_4 - g_4 - d_4) / A_4
    part = min(1.0, u_max / math.hypot(u_3, u_4)) if p["limit_voltage"] else 1.0
    current_limited, voltage_limited = i_q_ref != u_2, part < 1.0

    rates = dict.fromkeys(("z_q", "z_d"), 0.0)
    if omega_u > 0.0:  # with the voltages that the plant has during the step
        rates = {"z_q": A_3 * u.before_q + g_3 + d_3, "z_d": A_4 * u.before_d + g_4 + d_4}
    for i, P in enumerate((P_1, P_2, P_3, P_4)):
        delta, sigma, zeta = p["delta"][i], p["sigma"][i], p["zeta"][i]
        rate = -delta * sigma * theta[i] + 0.5 * zeta * delta * P**2
        if p["freeze_adaptation"]:
            frozen = voltage_limited or (current_limited and i < 2)
            largest = (p["limit.theta_max"] - theta[i]) / p["solver.internal_step"]
            rate = 0.0 if frozen else min(rate, largest)
        rates[f"theta[{i + 1}]"] = rate
    return rates, {
        "u_q": part * u_3,
        "u_d": part * u_4,
        "i_q_ref": i_q_ref,
        "saturated": float(current_limited or voltage_limited),
        **{f"P[{i + 1}]": P for i, P in enumerate((P_1, P_2, P_3, P_4))},
    }


class Cascade:
    """The equations of FocController's README which those of the others refer to, from e = x_d - x_hat."""

    def __init__(self, p: Mapping, u: SimpleNamespace, k_p: float) -> None:
        self.p, self.u = p, u
        self.N_p, self.Phi, self.L_d, self.L_q, self.R_s, alpha, self.A_eq = (
            p[f"model.{n}"] for n in ("N_p", "Phi_PM", "L_d", "L_q", "R_s", "alpha_RL", "A_eq")
        )
        a_max, i_max, v_max = (p[f"limit.{n}"] for n in ("a_max", "i_max", "v_max"))
        self.omega_e = self.N_p * alpha * u.v_hat
        self.A_2 = 3.0 * self.N_p * self.Phi / (2.0 * self.A_eq)
        self.u_l = min(p["limit.u_max"], u.u_available)

        e = u.x_d - u.x_hat
        e_0 = a_max / k_p**2
        near = abs(e) <= e_0
        w_0 = math.copysign(k_p * abs(e) if near else math.sqrt(2.0 * a_max * (abs(e) - e_0 / 2.0)), e)
        root = math.sqrt(self.Phi**2 + self.L_q**2 * i_max**2)
        v_l = max(min(0.95 * v_max, self.u_l / (self.N_p * alpha * root)), 1.02 * abs(u.v_d))
        self.w = clip(u.v_d + w_0, -v_l, v_l) - u.v_d
        self.slope = 0.0 if abs(u.v_d + w_0) >= v_l else k_p if near else a_max / abs(w_0)

        self.psi = (1.0 - p["limit.u_reserve"]) * self.u_l / max(abs(self.omega_e), 1e-6)
        self.i_f = -min(self.Phi / self.L_d, 0.7 * i_max) if p["weaken_field"] else 0.0
        inside = max(self.psi**2 - (self.Phi + self.L_d * self.i_f) ** 2, 0.01 * self.psi**2)
        self.i_l = min((1.0 - p["limit.i_reserve"]) * i_max, math.sqrt(inside) / self.L_q)

    def g_2(self, i_d: float) -> float:
        u, reluctance = self.u, 1.5 * self.N_p * self.u.i_q * i_d * (self.L_d - self.L_q)
        return (reluctance - self.p["model.B_eq"] * u.v_hat - self.p["model.C_eq"] * u.x_hat) / self.A_eq

    def i_d_ref(self, i_q_ref: float) -> float:
        root = math.sqrt(max(self.psi**2 - self.L_q**2 * i_q_ref**2, 1e-4 * self.psi**2))
        return clip((root - self.Phi) / self.L_d, self.i_f, 0.0)

    def limited(self, u_3: float, u_4: float) -> tuple[float, float]:
        """Return u_q and u_d."""
        u = self.u
        emf = self.omega_e * (self.Phi + self.L_d * u.i_d)
        rho = math.sqrt(max(self.u_l**2 - emf**2, 0.01 * self.u_l**2))
        u_d = clip(u_4, -rho, rho)
        s = math.sqrt(self.u_l**2 - u_d**2)
        return clip(u_3, -s, s), u_d

    def required_voltages(self, q: float, d: float) -> tuple[float, float]:
        """Return u_3 and u_4, whose last three terms are the same in all READMEs."""
        u = self.u
        u_3 = q + self.R_s * u.i_q + self.omega_e * (self.L_d * u.i_d + self.Phi)
        return u_3, d + self.R_s * u.i_d - self.omega_e * self.L_q * u.i_q


def foc(p: Mapping, x: Numbers, u: SimpleNamespace, t: float) -> tuple[Numbers, Numbers]:
    c = Cascade(p, u, p["k_p"])
    w_c, w_i, g_2 = p["w_c"], p["w_i"], c.g_2(u.i_d)
    v_ref, d_o = u.v_d + c.w, p["omega_d"] * (u.v_hat - x["load.z"])
    d = p["compensate"] * u.d_hat + d_o
    i = (u.a_d + p["k_v"] * (v_ref - u.v_hat) - g_2 - d) / c.A_2
    i_q_ref = clip(i, -c.i_l, c.i_l)
    error_q, error_d = i_q_ref - u.i_q, c.i_d_ref(i_q_ref) - u.i_d
    u_3, u_4 = c.required_voltages(c.L_q * (w_c * error_q + x["xi_q"]), c.L_d * (w_c * error_d + x["xi_d"]))
    u_q, u_d = c.limited(u_3, u_4)
    rates = {
        "xi_q": w_i * (w_c * error_q + (u_q - u_3) / c.L_q),
        "xi_d": w_i * (w_c * error_d + (u_d - u_4) / c.L_d),
        "load.z": c.A_2 * u.i_q + g_2 + d_o if p["omega_d"] > 0.0 else 0.0,
    }
    limited = abs(i) > c.i_l or u_q != u_3 or u_d != u_4
    outputs = {"u_q": u_q, "u_d": u_d, "i_q_ref": i_q_ref, "saturated": float(limited)}
    return rates, {**outputs, "v_ref": v_ref, "load.d": d}


def cac(p: Mapping, x: Numbers, u: SimpleNamespace, t: float) -> tuple[Numbers, Numbers]:
    c = Cascade(p, u, p["k"][0])
    k_1, k_2, k_3, _, k_5 = p["k"]
    varpi, epsilon, m, gamma = p["varpi"], p["epsilon"], p["m"], p["leak"]
    w_c, w_rate, i_c, i_rate = (x[f"filter.{n}"] for n in ("w", "w_rate", "i_q", "i_q_rate"))
    xi, D = [x[f"xi[{i}]"] for i in (1, 2, 3, 4)], [x[f"D[{i}]"] for i in (2, 3, 4)]
    z = [u.x_hat - u.x_d, u.v_hat - u.v_d - w_c, u.i_q - i_c, u.i_d - c.i_d_ref(i_c)]
    v = [a - b for a, b in zip(z, xi, strict=True)]
    used = [varpi[i] for i in (0, 1, 2, 4)]
    push = [a * math.tanh(b / e) for a, b, e in zip(used, v, epsilon, strict=True)]

    a_1 = clip(c.w - push[0], -p["limit.v_max"], p["limit.v_max"])
    unknown = c.g_2(u.i_d) + p["compensate"] * u.d_hat + D[0] + push[1]
    a_2 = (u.a_d + w_rate - k_2 * z[1] - z[0] - unknown) / c.A_2
    u_3, u_4 = c.required_voltages(
        c.L_q * (i_rate - D[1]) - k_3 * z[2] - c.A_2 * z[1] - push[2], -c.L_d * D[2] - k_5 * z[3] - push[3]
    )
    u_q, u_d = c.limited(u_3, u_4)
    o_1, o_2 = p["omega_n"]
    damping = 2.0 * p["damping"]
    rates = {
        "filter.w": w_rate,
        "filter.w_rate": o_1**2 * (a_1 - w_c) - damping * o_1 * w_rate,
        "filter.i_q": i_rate,
        "filter.i_q_rate": o_2**2 * (clip(a_2, -c.i_l, c.i_l) - i_c) - damping * o_2 * i_rate,
        "xi[1]": -k_1 * xi[0] + w_c - a_1 + xi[1],
        "xi[2]": -k_2 * xi[1] + c.A_2 * (i_c - a_2) + c.A_2 * xi[2] - xi[0],
        "xi[3]": (-k_3 * xi[2] - c.A_2 * xi[1] + u_q - u_3) / c.L_q,
        "xi[4]": (-k_5 * xi[3] + u_d - u_4) / c.L_d,
        **{f"D[{i + 2}]": m[i] * v[i + 1] - gamma * D[i] for i in range(3)},
    }
    i_max = p["limit.i_max"]
    limited = abs(a_2) > c.i_l or u_q != u_3 or u_d != u_4
    outputs = {"u_q": u_q, "u_d": u_d, "i_q_ref": clip(i_c, -i_max, i_max), "saturated": float(limited)}
    return rates, {**outputs, **{f"v[{i + 1}]": v[i] for i in range(4)}}


def anatc(p: Mapping, x: Numbers, u: SimpleNamespace, t: float) -> tuple[Numbers, Numbers]:
    c = Cascade(p, u, p["k_1"])
    alpha, w_c, W = p["model.alpha_RL"], p["w_c"], [x[f"W[{j}]"] for j in range(1, 6)]
    z_1, z_2 = u.x_hat - u.x_d, u.v_hat - u.v_d - c.w
    omega = alpha * z_2
    S = [math.exp(-2.0 * (u.v_hat / p["limit.v_max"] - c_j) ** 2) for c_j in (-1.0, -0.5, 0.0, 0.5, 1.0)]
    sigma = max(p["g"] * math.exp(-p["b"] * t), p["sigma_min"])
    h = omega / math.sqrt(omega**2 + sigma**2)
    n = sum(a * b for a, b in zip(W, S, strict=True)) + x["delta"] * h
    a_rate = u.a_d - c.slope * (u.v_hat - u.v_d)
    i = (a_rate - c.g_2(0.0) - p["compensate"] * u.d_hat) / c.A_2 - n - p["k_2"] * omega - alpha * z_1
    bend = 1.0 - math.tanh(i / c.i_l) ** 2
    i_q_ref = c.i_l * math.tanh(i / c.i_l)
    error_q, error_d = i_q_ref - u.i_q, c.i_d_ref(i_q_ref) - u.i_d
    u_3, u_4 = c.required_voltages(c.L_q * w_c * error_q, c.L_d * w_c * error_d)
    u_q, u_d = c.limited(u_3, u_4)
    free = u_q == u_3 and u_d == u_4
    mu, ell = bend if free else 0.0, p["ell"]
    rates = {f"W[{j + 1}]": p["lambda_1"] * (mu * S[j] * omega - ell[0] * sigma * W[j]) for j in range(5)}
    rates["delta"] = p["lambda_2"] * (mu * h * omega - ell[1] * sigma * x["delta"])
    outputs = {"u_q": u_q, "u_d": u_d, "i_q_ref": i_q_ref, "saturated": float(bend < 0.5 or not free)}
    return rates, {**outputs, "z[1]": z_1, "z[2]": z_2, "unknown": n}


def inputs(draw: np.random.Generator, count: int) -> Iterator[dict[str, float]]:
    """Draw inputs, near a reference that moves and with some jumps, so that some are at limits."""
    x_d, v_d = draw.uniform(0.2, 0.3), draw.uniform(-0.15, 0.15)
    for i in range(count):
        yield {
            "x_hat": x_d + i * STEP * v_d + draw.choice([1e-6, 1e-5, 1e-3, 2e-2]) * draw.uniform(-1.0, 1.0),
            "v_hat": v_d + draw.choice([1e-3, 0.03]) * draw.uniform(-1.0, 1.0),
            "i_q": draw.uniform(-100.0, 100.0),
            "i_d": draw.uniform(-40.0, 0.0),
            "x_d": x_d + i * STEP * v_d,
            "v_d": v_d,
            "a_d": draw.uniform(-1.0, 1.0),
            "d_hat": draw.uniform(-4.0, 4.0),
            "u_available": draw.choice([250.0, 420.0, 1e4]),
        }


def model(draw: np.random.Generator) -> Values:
    """Draw what all controllers have in common, with a motor whose inductances differ."""
    return {
        "limit.i_reserve": draw.uniform(0.0, 0.1),
        "limit.u_reserve": draw.uniform(0.0, 0.3),
        "limit.a_max": draw.uniform(0.5, 2.0),
        "limit.i_max": draw.choice([60.0, 105.0]),
        "model.L_q": draw.uniform(2e-3, 4e-3),
        "model.C_eq": draw.uniform(0.0, 50.0),
        "compensate": float(draw.random() < 0.7),
        "weaken_field": float(draw.random() < 0.5),
    }


SWITCHES = (
    *("x_2d_in_a_1", "feed_acceleration", "limit_acceleration", "limit_current", "limit_voltage"),
    *("freeze_adaptation", "limit_speed", "measure_supply"),
)


def rsba_gains(draw: np.random.Generator) -> Values:
    """Draw switches and gains; in most cases limits are on, without which voltages are far off."""
    switches = {name: float(draw.random() < 0.8) for name in SWITCHES}
    gains: Values = {"beta": [288.0, 288.0, 4000.0, 4000.0], "omega_u": draw.choice([0.0, 200.0])}
    adaptation: Values = {"zeta": [draw.choice([0.0, 5.0])] * 4, "limit.theta_max": draw.choice([5.0, 1e6])}
    return model(draw) | switches | gains | adaptation


def foc_gains(draw: np.random.Generator) -> Values:
    return model(draw) | {"omega_d": draw.choice([0.0, 300.0]), "k_p": draw.uniform(50.0, 200.0)}


def cac_gains(draw: np.random.Generator) -> Values:
    gains: Values = {
        "k": [120.0, 230.0, 5.0, 1.0, 4.0],
        "m": [2e3, 3e4, 1e4],
        "epsilon": [0.01, 0.02, 1.0, 2.0],
        "leak": 5.0,
        "damping": 0.3,
    }
    return model(draw) | gains


def anatc_gains(draw: np.random.Generator) -> Values:
    gains: Values = {"k_1": 60.0, "k_2": 0.2, "lambda_1": 40.0, "lambda_2": 30.0, "ell": [2.0, 3.0]}
    return model(draw) | gains | {"g": draw.choice([0.075, 10.0]), "b": draw.choice([0.0, 50.0])}


CASES: dict[type[Block], tuple[Laws, Drawn, tuple[str, ...]]] = {
    RsbaController: (rsba, rsba_gains, (*(f"theta[{i}]" for i in (1, 2, 3, 4)), "z_q", "z_d")),
    FocController: (foc, foc_gains, ("xi_q", "xi_d", "load.z")),
    CacController: (
        cac,
        cac_gains,
        (
            *(f"filter.{n}" for n in ("w", "w_rate", "i_q", "i_q_rate")),
            *(f"xi[{i}]" for i in (1, 2, 3, 4)),
            *("D[2]", "D[3]", "D[4]"),
        ),
    ),
    AnatcController: (anatc, anatc_gains, (*(f"W[{j}]" for j in range(1, 6)), "delta")),
}


@pytest.mark.parametrize("block", CASES, ids=lambda block: block.__name__)
def test_steps_match_the_readme(block: type[Block]) -> None:
    laws, gains, states = CASES[block]
    draw, covered = np.random.default_rng(31), {"saturated": set(), "voltage": set(), "weakened": set()}
    for _ in range(20):
        start, drawn = float(draw.choice([0.0, 2.0])), gains(draw)
        p = table(block.__name__) | drawn
        instance = started(block, drawn, start)
        x, before = dict.fromkeys(states, 0.0), {"before_q": 0.0, "before_d": 0.0}
        for i, input_values in enumerate(inputs(draw, 12)):
            for name, value in input_values.items():
                instance[name] = value
            t = start + i * STEP
            instance.do_step(t, STEP)
            u = SimpleNamespace(**input_values, **before)
            x = stepped(laws, p, x, u, t, STEP)
            _, expected = laws(p, x, u, t + STEP)
            before = {"before_q": expected["u_q"], "before_d": expected["u_d"]}
            for name, value in (x | expected).items():
                assert instance[name] == pytest.approx(value, rel=1e-7, abs=1e-9), (name, i)
            covered["saturated"].add(expected["saturated"])
            length = math.hypot(expected["u_q"], expected["u_d"])
            covered["voltage"].add(length > 0.999 * min(p["limit.u_max"], input_values["u_available"]))
            covered["weakened"].add(p["weaken_field"])
    assert all(len(values) == 2 for values in covered.values()), covered
