"""Facts about the blocks of rsba_fmu."""

import math
from itertools import pairwise
from typing import Any

from hypothesis import strategies as st

from emla_cosim.study.joint import start_values
from fmublock.instance import Instance
from rsba_fmu import AnatcController, CacController, FocController, RsbaController
from tests.support.blocks.facts import BlockFacts, Draw, Point, around, magnitude, magnitudes, signed, signs
from tests.support.joint_data import ROBUST, TILT, gains_of


@st.composite
def controller_points(draw: Draw) -> Point:
    """Limits are beside the demands, which the block computes in process."""
    x_d, P_1 = signed(draw, 0.05, 0.5), signed(draw, 1e-3, 0.04)
    switches = ("x_2d_in_a_1", "feed_acceleration", "freeze_adaptation", "limit_acceleration", "compensate")
    values: dict[str, Any] = {
        "x_hat": x_d + P_1,
        "x_d": x_d,
        "limit.i_reserve": draw(st.floats(0.05, 0.3)),
        "limit.u_reserve": draw(st.floats(0.05, 0.3)),
        **{name: draw(st.booleans()) for name in switches},
        "model.N_p": draw(st.integers(2, 10)),
        **magnitudes(draw, {"model.R_s": (0.05, 0.5), "omega_u": (10.0, 1000.0), "model.L_d": (1e-3, 5e-3)}),
        **magnitudes(draw, {"model.L_q": (1e-3, 5e-3), "model.B_eq": (1.0, 10.0), "model.C_eq": (0.1, 10.0)}),
        **magnitudes(draw, {"limit.v_max": (1e-2, 1.0), "model.Phi_PM": (0.05, 0.3)}),
        **magnitudes(draw, {"model.A_eq": (10.0, 100.0), "model.alpha_RL": (500.0, 5000.0)}),
        "solver.internal_step": magnitude(draw, 1e-5, 1e-4),
        **signs(draw, {"v_d": (1e-3, 0.3), "a_d": (1e-2, 1.0), "i_q": (0.1, 100.0), "i_d": (0.1, 100.0)}),
        **signs(draw, {"z_q": (0.1, 100.0), "z_d": (0.1, 100.0), "v_hat": (1e-3, 0.3), "d_hat": (1e-2, 1.0)}),
    }
    for i in range(1, 5):
        values |= {
            f"beta[{i}]": magnitude(draw, 10.0, 3000.0),
            f"zeta[{i}]": magnitude(draw, 1.0, 100.0),
            f"delta[{i}]": magnitude(draw, 1.0, 100.0),
            f"sigma[{i}]": magnitude(draw, 1e-3, 1e-1),
            f"theta[{i}]": magnitude(draw, 0.1, 10.0),
        }
    k = 0.5 * (values["beta[1]"] + values["zeta[1]"] * values["theta[1]"])
    values["limit.a_max"] = abs(P_1) * k**2 / around(draw, 1.0)
    signals = controller(values, "i_q_ref")
    values |= {
        "limit.i_max": abs(signals["i_q_ref"]) / around(draw, 1.0) / (1.0 - values["limit.i_reserve"]),
        "limit_current": draw(st.booleans()),
    }
    signals = controller(values, "u_q", "u_d", *(f"P[{i}]" for i in range(1, 5)))
    limit = math.hypot(signals["u_q"], signals["u_d"]) / around(draw, 1.0)
    measured = draw(st.booleans())
    values |= {"measure_supply": measured, "limit_voltage": draw(st.booleans())}
    values |= {"limit.u_max": limit * (2.0 if measured else 1.0), "u_available": limit}
    values["limit.theta_max"] = draw(st.sampled_from(bounds_of_adaptation(values, signals)))
    return Point(values, reach={"x_hat": abs(P_1), "x_d": abs(P_1)})


def controller(values: dict[str, Any], *outputs: str) -> dict[str, float]:
    """Return outputs of a controller with these values."""
    instance = Instance(RsbaController())
    reference = instance.layout.reference
    for name, value in values.items():
        instance.set([reference(name)], [value])
    return dict(zip(outputs, instance.get([reference(n) for n in outputs]), strict=True))


def bounds_of_adaptation(values: dict[str, Any], signals: dict[str, float]) -> list[float]:
    """Return values of theta_max clearly between those at which it starts to limit an adaptation."""
    begins = []
    for i in range(1, 5):
        gain = 0.5 * values[f"zeta[{i}]"] * values[f"delta[{i}]"]
        growth = gain * signals[f"P[{i}]"] ** 2
        begins.append(values[f"theta[{i}]"] + values["solver.internal_step"] * growth)
    begins = sorted(begins)
    pairs = [(low, high) for low, high in pairwise(begins) if high > 10.0 * low]
    return [3.0 * begins[-1], *(math.sqrt(low * high) for low, high in pairs)]


def drive_points(draw: Draw) -> tuple[dict[str, Any], dict[str, float]]:
    """Draw values and reaches of what FocController, CacController and AnatcController have in common.

    Nothing is limited, or all of one kind is, by far; the approach brakes clearly or is clearly linear
    for gains of the position up to 10 / s.
    """
    x_d, P_1 = signed(draw, 0.05, 0.5), signed(draw, 1e-3, 0.04)
    limited = draw(st.sampled_from(["nothing", "speed", "current", "voltage"]))
    u = 1e-2 if limited == "voltage" else 1e7
    u_max, u_available = draw(st.sampled_from([(u, 3.0 * u), (3.0 * u, u)]))
    values = {
        "x_hat": x_d + P_1,
        "u_available": u_available,
        "x_d": x_d,
        "compensate": draw(st.booleans()),
        "limit.a_max": draw(st.sampled_from([1e-4, 100.0])),
        "limit.v_max": 1e-5 if limited == "speed" else 1.0,
        "limit.i_max": 1e-3 if limited == "current" else 1e5,
        "limit.u_max": u_max,
        "limit.u_reserve": draw(st.floats(0.05, 0.3)),
        "limit.i_reserve": draw(st.floats(0.05, 0.3)),
        "model.N_p": draw(st.integers(2, 10)),
        **magnitudes(draw, {"model.R_s": (0.05, 0.5), "model.L_d": (1e-3, 5e-3), "model.L_q": (1e-3, 5e-3)}),
        **magnitudes(draw, {"model.B_eq": (1.0, 10.0), "model.C_eq": (0.1, 10.0)}),
        **magnitudes(draw, {"model.Phi_PM": (0.05, 0.3), "model.A_eq": (10.0, 100.0)}),
        **magnitudes(draw, {"model.alpha_RL": (500.0, 5000.0), "solver.internal_step": (1e-5, 1e-4)}),
        **signs(draw, {"v_d": (1e-3, 0.3), "a_d": (1e-2, 1.0), "d_hat": (0.1, 5.0), "i_q": (0.1, 100.0)}),
        **signs(draw, {"i_d": (0.1, 100.0), "v_hat": (1e-2, 0.3)}),
    }
    return values, {"x_hat": abs(P_1), "x_d": abs(P_1)}


@st.composite
def foc_points(draw: Draw) -> Point:
    values, reach = drive_points(draw)
    parameters = {
        **magnitudes(draw, {"k_p": (1.0, 10.0), "w_i": (10.0, 300.0), "k_v": (10.0, 1000.0)}),
        **magnitudes(draw, {"w_c": (100.0, 3000.0), "omega_d": (10.0, 1000.0)}),
        **signs(draw, {"xi_q": (10.0, 1e4), "xi_d": (10.0, 1e4), "load.z": (1e-2, 0.3)}),
    }
    return Point(values | parameters, kinks={"omega_d"}, reach=reach)


@st.composite
def cac_points(draw: Draw) -> Point:
    values, reach = drive_points(draw)
    parameters = {
        **{f"k[{i}]": magnitude(draw, 0.01, 1e3) for i in range(2, 6)},
        **{f"varpi[{i}]": magnitude(draw, 0.1, 10.0) for i in range(2, 6)},
        **{f"m[{i}]": magnitude(draw, 0.1, 1e3) for i in range(1, 4)},
        **{f"D[{i}]": signed(draw, 0.1, 10.0) for i in range(2, 5)},
        **magnitudes(draw, {"k[1]": (1.0, 10.0), "leak": (1e-3, 1.0), "damping": (0.5, 2.0)}),
        **magnitudes(draw, {"varpi[1]": (1e-3, 0.1), "epsilon[2]": (0.3, 3.0), "epsilon[1]": (0.03, 1.0)}),
        **magnitudes(draw, {"omega_n[1]": (100.0, 1e4), "omega_n[2]": (100.0, 1e4)}),
        **magnitudes(draw, {"epsilon[3]": (30.0, 300.0), "epsilon[4]": (30.0, 300.0)}),
        **signs(draw, {"xi[2]": (1e-3, 0.1), "xi[3]": (0.1, 10.0), "xi[4]": (0.1, 10.0)}),
        **signs(draw, {"xi[1]": (1e-4, 1e-2), "filter.w": (1e-3, 0.1), "filter.i_q": (0.1, 100.0)}),
        **signs(draw, {"filter.w_rate": (0.1, 10.0), "filter.i_q_rate": (10.0, 1e4)}),
    }
    return Point(values | parameters, reach=reach)


@st.composite
def anatc_points(draw: Draw) -> Point:
    values, reach = drive_points(draw)
    parameters = {
        "sigma_min": draw(st.sampled_from([1e-3, 1e3])),
        **{f"W[{i}]": signed(draw, 0.1, 10.0) for i in range(1, 6)},
        **magnitudes(draw, {"b": (0.1, 3.0), "k_1": (1.0, 10.0), "k_2": (0.1, 10.0), "g": (10.0, 300.0)}),
        **magnitudes(draw, {"delta": (0.1, 10.0), "ell[1]": (1e-3, 1.0), "ell[2]": (1e-3, 1.0)}),
        **magnitudes(draw, {"w_c": (100.0, 3000.0), "lambda_1": (0.1, 100.0), "lambda_2": (0.1, 100.0)}),
    }
    return Point(values | parameters, draw(st.floats(0.0, 1.0)), reach=reach)


SIGNALS = {"x_hat": 1e-3, "v_hat": 0.05, "d_hat": 1, "i_q": 20, "i_d": 5, "u_available": 400}
REFERENCE = {"x_d": 1e-3, "v_d": 0.05, "a_d": 0.3}
NEAR = {"x_hat": 0.25, "x_d": 0.2501, "v_hat": 0.01, "d_hat": 0.2, "i_q": 5.0, "i_d": 1.0}
NEAR |= {"u_available": 400.0, "a_d": 0.1}

FACTS = {
    "RsbaController": BlockFacts(
        start=start_values(RsbaController, TILT, ROBUST["tilt"]),
        inputs={
            "x_hat": 1e-3,
            "v_hat": 0.05,
            "i_q": 20,
            "i_d": 5,
            **REFERENCE,
            "d_hat": 0.5,
            "u_available": 100,
        },
        smooth={"x_hat": 0.25, "x_d": 0.24, "v_hat": 0.01, "i_q": 5.0, "i_d": 1.0}
        | {"limit_acceleration": True, "feed_acceleration": True}
        | {f"beta[{i}]": 50.0 for i in range(1, 5)}
        | {f"delta[{i}]": 1.0 for i in range(1, 5)}
        | {f"sigma[{i}]": 40.0 for i in range(1, 5)},
        points=controller_points,
        exchange=(0.1, 2e-2),
        still=frozenset({"saturated"}),
        is_laborious=True,
    ),
    "FocController": BlockFacts(
        start=start_values(FocController, TILT, gains_of("foc", "rule")["tilt"]),
        inputs=SIGNALS | REFERENCE,
        smooth={**NEAR, "omega_d": 50.0, "w_c": 100.0, "w_i": 40.0},
        points=foc_points,
        exchange=(0.1, 2e-2),
        is_laborious=True,
    ),
    "CacController": BlockFacts(
        start=start_values(CacController, TILT, gains_of("cac", "published")["tilt"]),
        inputs=SIGNALS | REFERENCE,
        smooth={
            **NEAR,
            "omega_n[1]": 50.0,
            "omega_n[2]": 80.0,
            "k[1]": 20.0,
            "k[2]": 30.0,
            "limit.i_max": 1e4,
        },
        points=cac_points,
        exchange=(0.1, 1e-2),
        is_laborious=True,
    ),
    "AnatcController": BlockFacts(
        start=start_values(AnatcController, TILT, gains_of("anatc", "published")["tilt"]),
        inputs=SIGNALS | REFERENCE,
        smooth={**NEAR, "k_1": 20.0, "g": 10.0, "ell[1]": 3.0, "ell[2]": 3.0},
        points=anatc_points,
        exchange=(0.1, 2e-2),
        is_laborious=True,
    ),
}
