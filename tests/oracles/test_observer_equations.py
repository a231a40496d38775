"""A port of EmlaObserver from the equations and tables of its README alone, over many steps."""

import math
from collections.abc import Mapping
from types import SimpleNamespace

import numpy as np
import pytest

from emla_fmu import EmlaObserver
from tests.support.in_process import started
from tests.support.readme_port import Numbers, stepped, table

STATES = ("x_hat", "v_hat", "d_hat", "eta_hat", "r_hat")
W = 400.0
"""Bandwidth in 1/s at which all parts of the observer act."""


def observer(p: Mapping, x: Numbers, u: SimpleNamespace, t: float) -> tuple[Numbers, Numbers]:
    moves = p["interpolate"] and u.h_b > 0.0
    part = min((t - u.t_b) / u.h_b, 1.0) if moves else 1.0
    y, i_q = u.y_b + part * (u.y - u.y_b), u.i_b + part * (u.i_q - u.i_b)
    alpha_1, alpha_2, Q_11, Q_12, Q_22 = (p[n] for n in ("alpha_1", "alpha_2", "Q_11", "Q_12", "Q_22"))
    p_12, p_11 = -Q_22 / 2.0, (Q_11 + alpha_2 * Q_22) / (2.0 * alpha_1)
    p_22 = (p_11 - alpha_1 * p_12 + Q_12) / alpha_2
    m = p["m_0"] * math.exp(-p["m_decay"] * t)

    def robust(y: float) -> tuple[float, float, float]:
        y_bar, H = y - x["x_hat"], p["H_0"] * (math.cos(y) ** 4 + math.sin(y) ** 4)
        eta = x["eta_hat"]
        return y_bar, H, eta**2 * H**2 * y_bar / (eta * H * abs(y_bar) + m)

    y_bar, H, f = robust(y)
    determinant = p_11 * p_22 - p_12**2
    i = i_q if p["use_measured_current"] else u.i_q_ref
    force = 1.5 * p["model.N_p"] * p["model.Phi_PM"] * i - p["model.B_eq"] * x["v_hat"]
    modelled = p["use_model"] / p["model.A_eq"] * force
    r_rate = p["omega_r"] * p["omega_d"] * alpha_2 * y_bar
    rates = {
        "x_hat": x["v_hat"] + alpha_1 * y_bar + p_22 / determinant * f,
        "v_hat": modelled + x["d_hat"] - p["ahead"] * x["r_hat"] + alpha_2 * y_bar - p_12 / determinant * f,
        "eta_hat": -m * p["ell"] * x["eta_hat"] + p["ell"] * H * abs(y_bar),
        "r_hat": r_rate,
        "d_hat": p["omega_d"] * alpha_2 * y_bar + x["r_hat"] + p["ahead"] * r_rate,
    }
    y_bar, _, f = robust(u.y)
    return rates, {"y_bar": y_bar, "f": f}


def test_steps_match_the_readme() -> None:
    draw = np.random.default_rng(31)
    for case in range(40):
        drawn = {
            "alpha_1": 4.0 * W,
            "alpha_2": 6.0 * W**2,
            "omega_d": draw.choice([0.0, 0.6 * W]),
            "omega_r": draw.choice([0.0, 0.25 * W]),
            "ahead": draw.choice([0.0, 4e-4]),
            "m_0": draw.choice([0.01, 1.0]),
            "m_decay": draw.choice([1e-3, 30.0]),
            "Q_11": draw.uniform(0.5, 1.0),
            "start.eta_hat": draw.uniform(0.5, 2.0),
            "start.x_hat": 0.3,
            **{n: float(draw.random() < 0.6) for n in ("use_model", "use_measured_current", "interpolate")},
        }
        p = table("EmlaObserver") | drawn
        if case == 0:  # as in the tables, but for what has no effect at the published gains
            p = table("EmlaObserver") | (drawn := {"interpolate": 1.0})
        t = float(draw.choice([0.0, 2.0]))
        instance = started(EmlaObserver, drawn, t)
        x = {
            "x_hat": p["start.x_hat"],
            "v_hat": 0.0,
            "d_hat": 0.0,
            "eta_hat": p["start.eta_hat"],
            "r_hat": 0.0,
        }
        names = {"y_b": "before.y", "i_b": "before.i_q", "t_b": "before.time", "h_b": "before.step"}
        before = {symbol: p.get(name, t) for symbol, name in names.items()}
        for i in range(12):
            h = 1e-4 if i < 8 else draw.choice([5e-5, 2e-4])
            input_values = {
                "y": 0.3 + draw.choice([1e-6, 1e-4, 2e-2]) * draw.uniform(-1.0, 1.0),
                "i_q_ref": draw.uniform(-100.0, 100.0),
                "i_q": draw.uniform(-100.0, 100.0),
            }
            for name, value in input_values.items():
                instance[name] = value
            instance.do_step(t, h)
            u = SimpleNamespace(**input_values, **before)
            x = stepped(observer, p, x, u, t, h)
            t += h
            for name, value in (x | observer(p, x, u, t)[1]).items():
                assert instance[name] == pytest.approx(value, rel=1e-7, abs=1e-9), (name, case, i)
            before = {"y_b": u.y, "i_b": u.i_q, "t_b": t, "h_b": t - u.t_b}
