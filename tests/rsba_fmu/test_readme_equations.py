"""A port of RsbaController from the equations and tables of its README alone, for one step.

Start values and names come from the tables; the equations are written here in the symbols of the
page. Nothing is imported from the controller's own code but the block that is compared.
"""

import math
import re
from types import SimpleNamespace

import numpy as np
import pytest

from fmublock.instance import Instance
from fmus.make_tables import readme
from rsba_fmu import RsbaController

STEP = 1e-4
_ROW = re.compile(r"^\| (?:\$.+\$)? *\| `([^`]+)` \| \S* \| ([^|]*) \| ", re.MULTILINE)

SWITCHES = ("feed_acceleration", "limit_acceleration", "limit_current", "limit_voltage", "limit_speed")
ON = dict.fromkeys((*SWITCHES, "compensate", "weaken_field", "measure_supply"), 1.0)
GAINS = {"x_2d_in_a_1": 0.0, "omega_u": 200.0, "limit.i_reserve": 0.02, "limit.u_reserve": 0.2}
BETA = [288.0, 288.0, 4000.0, 4000.0]


def table() -> dict[str, float | list[float]]:
    """Return the start values of the README's tables by name; vectors as lists."""
    found: dict[str, float | list[float]] = {}
    for name, start in _ROW.findall(readme("RsbaController").read_text(encoding="utf-8")):
        values = [float({"true": "1", "false": "0"}.get(v.strip(), v)) for v in start.split(",") if v.strip()]
        array, dots, last = name.removesuffix("]").partition("[1..")
        if dots:
            found[array] = values * int(last) if len(values) == 1 else values
        elif values:
            found[name] = values[0]
    return found


def clip(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


def port(p: dict, x: SimpleNamespace) -> dict[str, float]:
    """Return the outputs after the first step, with the switches of ON; theta_hat stays 0."""
    k = [0.5 * beta for beta in p["beta"]]
    N_p, Phi, L_d, L_q, R_s = (p[f"model.{n}"] for n in ("N_p", "Phi_PM", "L_d", "L_q", "R_s"))
    alpha, A_eq, B_eq, C_eq = (p[f"model.{n}"] for n in ("alpha_RL", "A_eq", "B_eq", "C_eq"))
    a_max, i_max, v_max, r, r_i = (
        p[f"limit.{n}"] for n in ("a_max", "i_max", "v_max", "u_reserve", "i_reserve")
    )
    u_max, omega_u = min(p["limit.u_max"], x.u_available), p["omega_u"]
    A_2, A_3, A_4 = 3.0 * N_p * Phi / (2.0 * A_eq), 1.0 / L_q, 1.0 / L_d
    g_2 = (1.5 * N_p * x.i_q * x.i_d * (L_d - L_q) - B_eq * x.v_hat - C_eq * x.x_hat) / A_eq
    g_3 = (-R_s * x.i_q - N_p * alpha * x.v_hat * (x.i_d * L_d + Phi)) / L_q
    g_4 = (-R_s * x.i_d + N_p * alpha * x.v_hat * x.i_q * L_q) / L_d

    P_1 = x.x_hat - x.x_d
    e, e_0 = abs(P_1), a_max / k[0] ** 2
    w = k[0] * P_1 if e <= e_0 else math.copysign(math.sqrt(2.0 * a_max * (e - e_0 / 2.0)), P_1)
    v_b = u_max / (N_p * alpha * math.sqrt(Phi**2 + L_q**2 * i_max**2))
    v = max(min(0.95 * v_max, v_b), 1.02 * abs(x.v_d))
    w = x.v_d - clip(x.v_d - w, -v, v)
    P_2 = x.v_hat - x.v_d + w
    u_2 = (-k[1] * P_2 - P_1 - g_2 + x.a_d - x.d_hat) / A_2

    psi = (1.0 - r) * u_max / abs(N_p * alpha * x.v_hat)
    i_f = -min(Phi / L_d, 0.7 * i_max)
    i_l = math.sqrt(max(psi**2 - (Phi + L_d * i_f) ** 2, 0.01 * psi**2)) / L_q
    weakens = p["weaken_field"] == 1.0
    limit = min((1.0 - r_i) * i_max, i_l) if weakens else (1.0 - r_i) * i_max
    i_q_ref = clip(u_2, -limit, limit)
    i_d_ref = (math.sqrt(max(psi**2 - (L_q * i_q_ref) ** 2, 1e-4 * psi**2)) - Phi) / L_d
    P_3, P_4 = x.i_q - i_q_ref, x.i_d - (clip(i_d_ref, i_f, 0.0) if weakens else 0.0)

    # z' = g + omega_u (i - z) from 0, as the voltages before the first step are 0
    decay = 1.0 - math.exp(-omega_u * STEP)
    d_3, d_4 = (omega_u * (i - (i + g / omega_u) * decay) for i, g in ((x.i_q, g_3), (x.i_d, g_4)))
    u_3 = (-k[2] * P_3 - g_3 - d_3) / A_3
    u_4 = (-k[3] * P_4 - g_4 - d_4) / A_4
    part = min(1.0, u_max / math.hypot(u_3, u_4))
    at_limit = float(i_q_ref != u_2 or part < 1.0)
    return {
        "u_q": part * u_3,
        "u_d": part * u_4,
        "i_q_ref": i_q_ref,
        "saturated": at_limit,
        **{f"P[{i + 1}]": P for i, P in enumerate((P_1, P_2, P_3, P_4))},
    }


def test_a_step_is_that_of_the_readme() -> None:
    draw, seen = np.random.default_rng(31), set()
    parameters = table() | ON | GAINS | {"beta": BETA, "zeta": [0.0] * 4}
    for _ in range(60):
        x = SimpleNamespace(
            x_hat=draw.uniform(0.2, 0.3),
            v_hat=draw.choice([-1.0, 1.0]) * draw.uniform(0.01, 0.16),
            i_q=draw.uniform(-100.0, 100.0),
            i_d=draw.uniform(-40.0, 0.0),
            v_d=draw.uniform(-0.12, 0.12),
            a_d=draw.uniform(-1.0, 1.0),
            d_hat=draw.uniform(-4.0, 4.0),
            u_available=draw.choice([300.0, 420.0, 1e4]),
        )
        parameters["weaken_field"] = float(draw.random() < 0.5)
        x.x_d = x.x_hat + draw.choice([1e-5, 1e-3, 2e-2]) * draw.uniform(-1.0, 1.0)
        instance = Instance(RsbaController())
        for name, value in (ON | GAINS | {"weaken_field": parameters["weaken_field"]}).items():
            instance[name] = value
        for i in range(4):
            instance[f"beta[{i + 1}]"], instance[f"zeta[{i + 1}]"] = BETA[i], 0.0
        instance.enter_initialization()
        instance.exit_initialization()
        for name, value in vars(x).items():
            instance[name] = value
        instance.do_step(0.0, STEP)
        expected = port(parameters, x)
        seen.add(expected["saturated"])
        for name, value in expected.items():
            assert instance[name] == pytest.approx(value, rel=1e-7, abs=1e-9), name
    assert seen == {0.0, 1.0}
