"""Points at which the blocks are smooth, drawn by hypothesis."""

import math
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import accumulate, pairwise
from typing import Any

from hypothesis import strategies as st

from emla_cosim.fmu.models import MODELS
from emla_fmu.disturbance import LEVELS
from emla_fmu.reference import MOVES
from fmublock.instance import Instance
from hdrm_fmu.spline_window import DEGREE, KNOTS
from hdrm_fmu.trajectory import JOINTS

Draw = Callable[..., Any]


@dataclass
class Point:
    """Values at which to differentiate; no known is zero."""

    values: dict[str, Any]
    time: float = 0.0
    kinks: set[str] = field(default_factory=set)
    """Parameters whose value 0 means none: nothing is continuous there."""
    reach: dict[str, float] = field(default_factory=dict)
    """Distance over which a known matters, where that is not its own magnitude."""
    terms: dict[str, float] = field(default_factory=dict)
    """How large the terms are of which an unknown is the sum, where they can cancel each other."""


def magnitude(draw: Draw, low: float, high: float) -> float:
    """Between low and high, every order of magnitude alike."""
    return math.exp(draw(st.floats(math.log(low), math.log(high))))


def signed(draw: Draw, low: float, high: float) -> float:
    return magnitude(draw, low, high) * draw(st.sampled_from([-1.0, 1.0]))


def beside(draw: Draw, limit: float) -> float:
    """Clearly less than the limit, or clearly more."""
    return limit * draw(st.one_of(st.floats(0.2, 0.7), st.floats(1.4, 4.0)))


@st.composite
def plant_points(draw: Draw) -> Point:
    u_q, u_d = signed(draw, 10.0, 400.0), signed(draw, 10.0, 400.0)
    x_L, sigma, noise = magnitude(draw, 0.01, 0.4), magnitude(draw, 1e-5, 1e-4), signed(draw, 0.1, 2.0)
    quantized = draw(st.booleans())
    steps = draw(st.integers(1, 5)) + draw(st.floats(-0.3, 0.3))
    sag, F_C = magnitude(draw, 0.01, 0.4), magnitude(draw, 10.0, 1e3)
    # dead time depends on the electrical angle, whose sine loses digits where it is many turns
    N_p, rho, angle = draw(st.integers(2, 10)), magnitude(draw, 0.1, 1.0), magnitude(draw, 2.0, 20.0)
    values = {
        "supply.sag": sag,
        "u_q": u_q,
        "u_d": u_d,
        "i_q_ref": signed(draw, 1.0, 100.0),
        "F_L": signed(draw, 100.0, 6e4),
        "d_2": signed(draw, 0.01, 1.0),
        "d_3": signed(draw, 0.1, 10.0),
        "d_4": signed(draw, 0.1, 10.0),
        "motor.R_s": magnitude(draw, 0.05, 0.5),
        "motor.alpha_R": magnitude(draw, 1e-4, 5e-3),
        "motor.cogging.amplitude": magnitude(draw, 0.1, 2.0),
        "motor.cogging.periods": draw(st.integers(2, 12)),
        "screw.lead_error": signed(draw, 1e-3, 1e-2),
        "screw.wobble": magnitude(draw, 1e-4, 1e-2),
        "sensor.eccentricity": magnitude(draw, 1e-3, 1e-1),
        "motor.L_d": magnitude(draw, 1e-3, 5e-3),
        "motor.L_q": magnitude(draw, 1e-3, 5e-3),
        "motor.Phi_PM": magnitude(draw, 0.05, 0.3),
        "motor.N_p": N_p,
        "motor.J_m": magnitude(draw, 0.005, 0.05),
        "motor.B_m": magnitude(draw, 1e-3, 1e-2),
        "coupling.J_c": magnitude(draw, 1e-3, 1e-2),
        "gearbox.rho": rho,
        "gearbox.J_GB": magnitude(draw, 1e-3, 1e-2),
        "gearbox.eta_GB": draw(st.floats(0.7, 0.95)),
        "screw.lead": 2.0 * math.pi * N_p * x_L / (rho * angle),
        "screw.M_BS": magnitude(draw, 50.0, 500.0),
        "screw.B_BS": magnitude(draw, 1.0, 100.0),
        "screw.C_eq": magnitude(draw, 0.1, 10.0),
        "screw.q_LB": beside(draw, x_L),
        "screw.q_UB": beside(draw, x_L),
        "stop.stiffness": magnitude(draw, 1e3, 1e6),
        "stop.damping": magnitude(draw, 0.1, 10.0),
        "friction.F_C": F_C,
        "friction.F_S": F_C * draw(st.floats(1.1, 3.0)),
        "friction.v_S": magnitude(draw, 1e-3, 1e-1),
        "friction.v_0": magnitude(draw, 1e-3, 1e-1),
        "gearbox.directional": draw(st.booleans()),
        "gearbox.eta_back": signed(draw, 0.1, 0.9),
        "motor.i_N": magnitude(draw, 5.0, 50.0),
        "motor.permitted_rise": magnitude(draw, 10.0, 100.0),
        "motor.tau_th": magnitude(draw, 1.0, 100.0),
        "motor.temperature_rise": signed(draw, 1.0, 100.0),
        "inverter.delay": 0.0,
        "inverter.dead_time": magnitude(draw, 1e-6, 1e-5),
        "inverter.f_PWM": magnitude(draw, 1e3, 2e4),
        "inverter.i_0": magnitude(draw, 1.0, 10.0),
        "sensor.current.sigma": magnitude(draw, 1e-3, 1e-1),
        "sensor.current.noise_q": signed(draw, 0.1, 2.0),
        "sensor.current.noise_d": signed(draw, 0.1, 2.0),
        "sensor.current.resolution": 0.0,
        "screw.v_max": magnitude(draw, 0.01, 1.0),
        "motor.i_max": magnitude(draw, 1.0, 100.0),
        "inverter.u_max": math.hypot(u_q, u_d) / (1.0 - sag) / beside(draw, 1.0),
        "use_commanded_current": draw(st.booleans()),
        "uncertainty.F_2": signed(draw, 0.01, 0.2),
        "uncertainty.F_3": signed(draw, 0.01, 0.2),
        "uncertainty.F_4": signed(draw, 0.01, 0.2),
        "sensor.sigma": sigma,
        "sensor.noise": noise,
        "sensor.resolution": (x_L + sigma * noise) / steps if quantized else 0.0,
        "solver.internal_step": magnitude(draw, 1e-5, 1e-4),
        "start.x_L": x_L,
        "v_L": signed(draw, 1e-3, 0.3),
        "i_q": signed(draw, 0.1, 100.0),
        "i_d": signed(draw, 0.1, 100.0),
    }
    kinks = {"inverter.delay", "sensor.current.resolution"}
    return Point(values, kinks=kinks if quantized else kinks | {"sensor.resolution"})


@st.composite
def compliant_points(draw: Draw) -> Point:
    """As the plant, in contact or within the play, or without any play."""
    plant, backlash = draw(plant_points()), draw(st.sampled_from([0.0, 1e-3]))
    values = {
        **plant.values,
        "load.m": magnitude(draw, 100.0, 1e4),
        "load.v": signed(draw, 1e-3, 0.3),
        "transmission.stiffness": magnitude(draw, 1e5, 1e7),
        "transmission.damping": magnitude(draw, 1.0, 100.0),
        "transmission.backlash": backlash,
        "start.deflection": signed(draw, 2e-3, 4e-3) if backlash else signed(draw, 1e-4, 4e-3),
        "sensor.at_load": draw(st.booleans()),
    }
    return Point(values, kinks=plant.kinks | {"transmission.backlash"})


@st.composite
def motor_points(draw: Draw) -> Point:
    """As the plant, its motion among what is given."""
    plant, known = draw(plant_points()), {s.name for s in MODELS["EmlaMotor"].layout().scalars}
    values = {name: value for name, value in plant.values.items() if name in known}
    return Point({**values, "x_L": plant.values["start.x_L"]}, kinks=plant.kinks)


@st.composite
def observer_points(draw: Draw) -> Point:
    x_hat, y_bar = signed(draw, 0.05, 0.5), signed(draw, 0.01, 0.04)
    values = {
        "y": x_hat + y_bar,
        "i_q_ref": signed(draw, 1.0, 100.0),
        "i_q": signed(draw, 1.0, 100.0),
        "alpha_1": magnitude(draw, 0.1, 10.0),
        "alpha_2": magnitude(draw, 0.1, 10.0),
        "Q_11": magnitude(draw, 0.3, 3.0),
        "Q_12": signed(draw, 0.01, 0.2),
        "Q_22": magnitude(draw, 0.3, 3.0),
        "H_0": magnitude(draw, 2.0, 50.0),
        "m_0": magnitude(draw, 20.0, 500.0),
        "m_decay": magnitude(draw, 1e-3, 1e-1),
        "ell": magnitude(draw, 0.1, 3.0),
        "use_model": draw(st.booleans()),
        "use_measured_current": draw(st.booleans()),
        "omega_d": magnitude(draw, 0.1, 3.0),
        "d_hat": signed(draw, 0.1, 3.0),
        "omega_r": magnitude(draw, 0.1, 3.0),
        "ahead": magnitude(draw, 0.01, 0.3),
        "r_hat": signed(draw, 0.1, 3.0),
        "model.N_p": draw(st.integers(2, 10)),
        "model.Phi_PM": magnitude(draw, 0.05, 0.3),
        "model.A_eq": magnitude(draw, 10.0, 100.0),
        "model.B_eq": magnitude(draw, 1.0, 10.0),
        "solver.internal_step": 5e-5,
        "start.x_hat": x_hat,
        "v_hat": signed(draw, 1e-3, 0.3),
        "start.eta_hat": magnitude(draw, 0.1, 10.0),
    }
    reach = dict.fromkeys(("y", "x_hat", "start.x_hat"), abs(y_bar))
    return Point(values, draw(st.floats(0.0, 10.0)), reach=reach)


@st.composite
def controller_points(draw: Draw) -> Point:
    """Limits are laid beside what is asked for, which the block says in process."""
    x_d, P_1 = signed(draw, 0.05, 0.5), signed(draw, 1e-3, 0.04)
    switches = ("x_2d_in_a_1", "feed_acceleration", "freeze_adaptation", "limit_acceleration", "compensate")
    values: dict[str, Any] = {
        "x_hat": x_d + P_1,
        "v_hat": signed(draw, 1e-3, 0.3),
        "i_q": signed(draw, 0.1, 100.0),
        "i_d": signed(draw, 0.1, 100.0),
        "x_d": x_d,
        "v_d": signed(draw, 1e-3, 0.3),
        "a_d": signed(draw, 1e-2, 1.0),
        "d_hat": signed(draw, 1e-2, 1.0),
        "omega_u": magnitude(draw, 10.0, 1000.0),
        "z_q": signed(draw, 0.1, 100.0),
        "z_d": signed(draw, 0.1, 100.0),
        "limit.i_reserve": draw(st.floats(0.05, 0.3)),
        "limit.u_reserve": draw(st.floats(0.05, 0.3)),
        "limit.v_max": magnitude(draw, 1e-2, 1.0),
        **{name: draw(st.booleans()) for name in switches},
        "model.R_s": magnitude(draw, 0.05, 0.5),
        "model.L_d": magnitude(draw, 1e-3, 5e-3),
        "model.L_q": magnitude(draw, 1e-3, 5e-3),
        "model.Phi_PM": magnitude(draw, 0.05, 0.3),
        "model.N_p": draw(st.integers(2, 10)),
        "model.alpha_RL": magnitude(draw, 500.0, 5000.0),
        "model.A_eq": magnitude(draw, 10.0, 100.0),
        "model.B_eq": magnitude(draw, 1.0, 10.0),
        "model.C_eq": magnitude(draw, 0.1, 10.0),
        "solver.internal_step": magnitude(draw, 1e-5, 1e-4),
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
    values["limit.a_max"] = abs(P_1) * k**2 / beside(draw, 1.0)
    found = controller(values, "i_q_ref")
    values |= {
        "limit.i_max": abs(found["i_q_ref"]) / beside(draw, 1.0) / (1.0 - values["limit.i_reserve"]),
        "limit_current": draw(st.booleans()),
    }
    found = controller(values, "u_q", "u_d", *(f"P[{i}]" for i in range(1, 5)))
    limit = math.hypot(found["u_q"], found["u_d"]) / beside(draw, 1.0)
    measured = draw(st.booleans())
    values |= {"measure_supply": measured, "limit_voltage": draw(st.booleans())}
    values |= {"limit.u_max": limit * (2.0 if measured else 1.0), "u_available": limit}
    values["limit.theta_max"] = draw(st.sampled_from(bounds_of_adaptation(values, found)))
    return Point(values, reach={"x_hat": abs(P_1), "x_d": abs(P_1)})


def controller(values: dict[str, Any], *outputs: str) -> dict[str, float]:
    """What a controller with these values gives."""
    instance = Instance(MODELS["RsbaController"]())
    reference = instance.layout.reference
    for name, value in values.items():
        instance.set([reference(name)], [value])
    return dict(zip(outputs, instance.get([reference(n) for n in outputs]), strict=True))


def bounds_of_adaptation(values: dict[str, Any], found: dict[str, float]) -> list[float]:
    """Values of theta_max clearly between those at which it begins to slow an adaptation down."""
    begins = []
    for i in range(1, 5):
        gain = 0.5 * values[f"zeta[{i}]"] * values[f"delta[{i}]"]
        growth = gain * found[f"P[{i}]"] ** 2
        begins.append(values[f"theta[{i}]"] + values["solver.internal_step"] * growth)
    begins = sorted(begins)
    pairs = [(low, high) for low, high in pairwise(begins) if high > 10.0 * low]
    return [3.0 * begins[-1], *(math.sqrt(low * high) for low, high in pairs)]


def drive_points(draw: Draw) -> tuple[dict[str, Any], dict[str, float]]:
    """Values, and reaches, of what FocController, CacController and AnatcController have in common.

    Nothing is limited, or all of one kind is, by far; the approach brakes clearly or is clearly linear
    for gains of the position up to 10 / s.
    """
    x_d, P_1 = signed(draw, 0.05, 0.5), signed(draw, 1e-3, 0.04)
    limited = draw(st.sampled_from(["nothing", "speed", "current", "voltage"]))
    u = 1e-2 if limited == "voltage" else 1e7
    u_max, u_available = draw(st.sampled_from([(u, 3.0 * u), (3.0 * u, u)]))
    values = {
        "x_hat": x_d + P_1,
        "v_hat": signed(draw, 1e-2, 0.3),
        "d_hat": signed(draw, 0.1, 5.0),
        "i_q": signed(draw, 0.1, 100.0),
        "i_d": signed(draw, 0.1, 100.0),
        "u_available": u_available,
        "x_d": x_d,
        "v_d": signed(draw, 1e-3, 0.3),
        "a_d": signed(draw, 1e-2, 1.0),
        "compensate": draw(st.booleans()),
        "limit.a_max": draw(st.sampled_from([1e-4, 100.0])),
        "limit.v_max": 1e-5 if limited == "speed" else 1.0,
        "limit.i_max": 1e-3 if limited == "current" else 1e5,
        "limit.u_max": u_max,
        "limit.u_reserve": draw(st.floats(0.05, 0.3)),
        "limit.i_reserve": draw(st.floats(0.05, 0.3)),
        "model.R_s": magnitude(draw, 0.05, 0.5),
        "model.L_d": magnitude(draw, 1e-3, 5e-3),
        "model.L_q": magnitude(draw, 1e-3, 5e-3),
        "model.Phi_PM": magnitude(draw, 0.05, 0.3),
        "model.N_p": draw(st.integers(2, 10)),
        "model.alpha_RL": magnitude(draw, 500.0, 5000.0),
        "model.A_eq": magnitude(draw, 10.0, 100.0),
        "model.B_eq": magnitude(draw, 1.0, 10.0),
        "model.C_eq": magnitude(draw, 0.1, 10.0),
        "solver.internal_step": magnitude(draw, 1e-5, 1e-4),
    }
    return values, {"x_hat": abs(P_1), "x_d": abs(P_1)}


@st.composite
def foc_points(draw: Draw) -> Point:
    values, reach = drive_points(draw)
    own = {
        "k_p": magnitude(draw, 1.0, 10.0),
        "k_v": magnitude(draw, 10.0, 1000.0),
        "w_c": magnitude(draw, 100.0, 3000.0),
        "w_i": magnitude(draw, 10.0, 300.0),
        "omega_d": magnitude(draw, 10.0, 1000.0),
        "xi_q": signed(draw, 10.0, 1e4),
        "xi_d": signed(draw, 10.0, 1e4),
        "load.z": signed(draw, 1e-2, 0.3),
    }
    return Point(values | own, kinks={"omega_d"}, reach=reach)


@st.composite
def cac_points(draw: Draw) -> Point:
    values, reach = drive_points(draw)
    own = {
        "k[1]": magnitude(draw, 1.0, 10.0),
        **{f"k[{i}]": magnitude(draw, 0.01, 1e3) for i in range(2, 6)},
        "varpi[1]": magnitude(draw, 1e-3, 0.1),
        **{f"varpi[{i}]": magnitude(draw, 0.1, 10.0) for i in range(2, 6)},
        **{f"m[{i}]": magnitude(draw, 0.1, 1e3) for i in range(1, 4)},
        "leak": magnitude(draw, 1e-3, 1.0),
        "epsilon[1]": magnitude(draw, 0.03, 1.0),
        "epsilon[2]": magnitude(draw, 0.3, 3.0),
        "epsilon[3]": magnitude(draw, 30.0, 300.0),
        "epsilon[4]": magnitude(draw, 30.0, 300.0),
        "omega_n[1]": magnitude(draw, 100.0, 1e4),
        "omega_n[2]": magnitude(draw, 100.0, 1e4),
        "damping": magnitude(draw, 0.5, 2.0),
        "filter.w": signed(draw, 1e-3, 0.1),
        "filter.w_rate": signed(draw, 0.1, 10.0),
        "filter.i_q": signed(draw, 0.1, 100.0),
        "filter.i_q_rate": signed(draw, 10.0, 1e4),
        "xi[1]": signed(draw, 1e-4, 1e-2),
        "xi[2]": signed(draw, 1e-3, 0.1),
        "xi[3]": signed(draw, 0.1, 10.0),
        "xi[4]": signed(draw, 0.1, 10.0),
        **{f"D[{i}]": signed(draw, 0.1, 10.0) for i in range(2, 5)},
    }
    return Point(values | own, reach=reach)


@st.composite
def anatc_points(draw: Draw) -> Point:
    values, reach = drive_points(draw)
    own = {
        "k_1": magnitude(draw, 1.0, 10.0),
        "k_2": magnitude(draw, 0.1, 10.0),
        "lambda_1": magnitude(draw, 0.1, 100.0),
        "lambda_2": magnitude(draw, 0.1, 100.0),
        "ell[1]": magnitude(draw, 1e-3, 1.0),
        "ell[2]": magnitude(draw, 1e-3, 1.0),
        "g": magnitude(draw, 10.0, 300.0),
        "b": magnitude(draw, 0.1, 3.0),
        "sigma_min": draw(st.sampled_from([1e-3, 1e3])),
        "w_c": magnitude(draw, 100.0, 3000.0),
        **{f"W[{i}]": signed(draw, 0.1, 10.0) for i in range(1, 6)},
        "delta": magnitude(draw, 0.1, 10.0),
    }
    return Point(values | own, draw(st.floats(0.0, 1.0)), reach=reach)


@st.composite
def reference_points(draw: Draw) -> Point:
    """A time within a move, or in a dwell; perhaps some periods later."""
    values: dict[str, Any] = {f"waypoint[{i + 1}]": signed(draw, 0.05, 0.5) for i in range(MOVES + 1)}
    moves, time, end = draw(st.integers(1, MOVES)), None, 0.0
    chosen, where_in_it = draw(st.integers(1, moves)), draw(st.floats(0.05, 0.95))
    in_a_move = draw(st.booleans())
    for i in range(1, moves + 1):
        start, duration = end + draw(st.floats(0.1, 0.5)), draw(st.floats(0.3, 2.0))
        values |= {f"move.start[{i}]": start, f"move.duration[{i}]": duration}
        if i == chosen:
            dwell = end + where_in_it * (start - end)
            time = start + where_in_it * duration if in_a_move else dwell
        end = start + duration
    assert time is not None
    periodic = draw(st.booleans())
    period = end * draw(st.floats(1.0, 1.5)) if periodic else 0.0
    time += period * draw(st.integers(0, 3))
    return Point({**values, "period": period}, time, set() if periodic else {"period"})


@st.composite
def trajectory_points(draw: Draw) -> Point:
    """A time within a span of a spline whose spans are of different length."""
    degree, spans = draw(st.integers(1, DEGREE)), draw(st.integers(1, 20))
    drawn = random.Random(draw(st.integers(0, 1000)))  # a hundred values that need not shrink
    places = list(accumulate([0.5, *(drawn.uniform(0.3, 2.0) for _ in range(spans))]))
    knots = [places[0]] * degree + places + [places[-1]] * (KNOTS - degree - len(places))
    k, part = draw(st.integers(0, spans - 1)), draw(st.floats(0.1, 0.9))
    values: dict[str, Any] = {f"knot[{i}]": x for i, x in enumerate(knots, 1)}
    reach = dict.fromkeys(values, 0.1)
    for joint in JOINTS:
        values |= {f"coefficient.{joint}[{i + 1}]": drawn.uniform(0.1, 0.5) for i in range(spans + degree)}
    time = places[k] + part * (places[k + 1] - places[k])
    return Point({**values, "degree": degree}, time, reach=reach)


@st.composite
def disturbance_points(draw: Draw) -> Point:
    """A time on a load level, or within a ramp."""
    ramp = draw(st.floats(0.1, 0.5))
    values: dict[str, Any] = {
        "v_L": signed(draw, 1e-2, 3.0),
        "load.ramp": ramp,
        "load.ripple": magnitude(draw, 1.0, 100.0),
        "load.ripple_omega": magnitude(draw, 1.0, 10.0),
        "d_2.is_force": draw(st.booleans()),
        "d_2.arctan": signed(draw, 0.1, 10.0),
        "d_2.decay": magnitude(draw, 0.01, 1.0),
        "d_2.low": -magnitude(draw, 0.1, 1.0),
        "d_2.high": magnitude(draw, 0.1, 1.0),
        "d_2.sample_time": magnitude(draw, 1e-4, 1e-2),
        "d_2.seed": draw(st.integers(1, 2147483646)),
        "d_4.amplitude": signed(draw, 0.1, 10.0),
        "d_4.omega": magnitude(draw, 1.0, 10.0),
        "d_4.phase": signed(draw, 0.1, 3.0),
        "supply.depth": magnitude(draw, 0.01, 0.5),
        "supply.start": 5.0,
        "supply.duration": 1.0,
    }
    for name in ("d_2", "d_3"):
        for i in (1, 2):
            values |= {
                f"{name}.amplitude[{i}]": signed(draw, 0.1, 10.0),
                f"{name}.omega[{i}]": magnitude(draw, 1.0, 10.0),
                f"{name}.phase[{i}]": signed(draw, 0.1, 3.0),
            }
    starts = [draw(st.floats(0.3, 0.6))]
    for _ in range(LEVELS - 1):
        starts.append(starts[-1] + ramp + draw(st.floats(0.4, 1.0)))
    for i, start in enumerate(starts, 1):
        values |= {f"load.level[{i}]": signed(draw, 10.0, 1e4), f"load.start[{i}]": start}
    time = draw(st.sampled_from(starts)) + ramp * draw(st.sampled_from([-0.4, 0.3, 0.5, 0.8, 1.2]))
    return Point(values, time)


@st.composite
def fault_points(draw: Draw) -> Point:
    """A time clearly before, within or after the fault."""
    start, duration = draw(st.floats(0.3, 0.6)), draw(st.floats(0.3, 0.6))
    values = {
        "u": signed(draw, 0.1, 10.0),
        "freeze": draw(st.booleans()),
        "start": start,
        "duration": duration,
        "gain": draw(st.sampled_from([1.0, -0.5, 3.0])),
        "offset": signed(draw, 0.1, 10.0),
    }
    return Point(values, start + duration * draw(st.sampled_from([-0.4, 0.5, 1.4])))


def machine(draw: Draw) -> dict[str, Any]:
    """Parameters of the manipulator, whose triangles close from 0.05 to 0.55 m."""
    values = {
        "payload.m": magnitude(draw, 100.0, 600.0),
        "lift.a": draw(st.floats(1.1, 1.2)),
        "lift.b": draw(st.floats(0.40, 0.44)),
        "lift.L_0": draw(st.floats(0.82, 0.88)),
        "lift.delta": signed(draw, 0.3, 1.5),
        "lift.epsilon": signed(draw, 0.1, 1.0),
        "tilt.a": draw(st.floats(1.2, 1.3)),
        "tilt.b": draw(st.floats(0.43, 0.47)),
        "tilt.L_0": draw(st.floats(0.95, 1.05)),
        "tilt.delta": signed(draw, 1.0, 3.0),
        "tilt.epsilon": signed(draw, 0.1, 1.0),
        "lift_boom.length": magnitude(draw, 1.0, 3.0),
        "inner_boom.reach": magnitude(draw, 1.0, 3.0),
        "payload.J": magnitude(draw, 0.01, 0.1),
        "tube.share": draw(st.floats(0.2, 0.8)),
        "gravity": signed(draw, 5.0, 15.0),
    }
    for boom in ("lift_boom", "outer_boom", "inner_boom"):
        values |= {
            f"{boom}.m": magnitude(draw, 50.0, 200.0),
            f"{boom}.c": signed(draw, 0.3, 1.0),
            f"{boom}.J": magnitude(draw, 10.0, 50.0),
        }
    for i in (1, 2, 3):
        values |= {
            f"screw.M_BS[{i}]": magnitude(draw, 30.0, 200.0),
            f"motor.m[{i}]": magnitude(draw, 10.0, 50.0),
            f"housing.c[{i}]": signed(draw, 0.2, 0.6),
            f"housing.J[{i}]": magnitude(draw, 2.0, 10.0),
            f"tube.c[{i}]": signed(draw, 0.2, 0.6),
            f"tube.J[{i}]": magnitude(draw, 0.5, 3.0),
            f"screw.q_LB[{i}]": 0.05,
            f"screw.q_UB[{i}]": 0.55,
        }
    return values


@st.composite
def manipulator_points(draw: Draw) -> Point:
    values = machine(draw)
    for i in (1, 2, 3):
        values |= {
            f"x_L[{i}]": draw(st.floats(0.1, 0.5)),
            f"v_L[{i}]": signed(draw, 0.03, 0.3),
            f"a_L[{i}]": signed(draw, 0.1, 3.0),
        }
    return Point(values, terms={f"F_L[{i}]": 1e3 for i in (1, 2, 3)})


@st.composite
def merged_points(draw: Draw) -> Point:
    values = machine(draw)
    for i in (1, 2, 3):
        values |= {
            f"tau_m[{i}]": signed(draw, 3.0, 100.0),
            f"d_2[{i}]": signed(draw, 0.1, 3.0),
            f"motor.J_m[{i}]": magnitude(draw, 1e-3, 0.02),
            f"motor.B_m[{i}]": magnitude(draw, 1e-3, 1e-2),
            f"coupling.J_c[{i}]": magnitude(draw, 1e-3, 1e-2),
            f"gearbox.rho[{i}]": magnitude(draw, 0.2, 1.0),
            f"gearbox.J_GB[{i}]": magnitude(draw, 1e-3, 1e-2),
            f"gearbox.eta_GB[{i}]": draw(st.floats(0.7, 0.95)),
            f"screw.lead[{i}]": magnitude(draw, 0.01, 0.03),
            f"screw.B_BS[{i}]": magnitude(draw, 10.0, 100.0),
            f"screw.C_eq[{i}]": magnitude(draw, 0.3, 3.0),
            f"screw.v_max[{i}]": magnitude(draw, 0.1, 1.0),
            f"uncertainty.F_2[{i}]": signed(draw, 0.03, 0.3),
            f"start.x_L[{i}]": draw(st.floats(0.1, 0.5)),
            f"start.v_L[{i}]": signed(draw, 0.03, 0.3),
        }
    terms = {f"{name}[{i}]": size for name, size in (("F_L", 1e3), ("a_L", 1.0)) for i in (1, 2, 3)}
    accelerations = {f"der(v_L[{i}])": 1.0 for i in (1, 2, 3)}
    return Point({**values, "solver.internal_step": 1e-4}, terms={**terms, **accelerations, "energy": 1e3})


@st.composite
def toy_points(draw: Draw) -> Point:
    values = {
        "force": signed(draw, 0.1, 10.0),
        "body.mass": magnitude(draw, 0.2, 9.0),
        "spring.k[1]": magnitude(draw, 0.1, 10.0),
        "spring.k[2]": magnitude(draw, 0.1, 10.0),
        "shape": draw(st.integers(1, 2)),
        "damped": draw(st.booleans()),
        "count": draw(st.integers(1, 9)),
        "seed": draw(st.integers(1, 2147483646)),
        "x_0": signed(draw, 0.05, 0.6),
        "solver.internal_step": 5e-5,
        "v[1]": signed(draw, 0.1, 3.0),
        "v[2]": signed(draw, 0.1, 3.0),
    }
    return Point(values, draw(st.floats(0.0, 3.0)))


POINTS: dict[str, Callable[[], st.SearchStrategy[Point]]] = {
    "EmlaPlant": plant_points,
    "EmlaCompliantPlant": compliant_points,
    "EmlaMotor": motor_points,
    "EmlaObserver": observer_points,
    "RsbaController": controller_points,
    "FocController": foc_points,
    "CacController": cac_points,
    "AnatcController": anatc_points,
    "Reference": reference_points,
    "Trajectory": trajectory_points,
    "Disturbance": disturbance_points,
    "SignalFault": fault_points,
    "HdrmManipulator": manipulator_points,
    "HdrmPlant": merged_points,
    "Toy": toy_points,
}
