"""Facts about the blocks of emla_fmu."""

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from hypothesis import strategies as st

from emla_cosim.study.joint import start_values
from emla_fmu import EmlaAxis, EmlaCompliantAxis, EmlaCompliantPlant, EmlaMotor, EmlaObserver, EmlaPlant
from emla_fmu.disturbance import LEVELS
from emla_fmu.holding_brake import PHASES
from emla_fmu.reference import MOVES
from emla_fmu.shared_supply import JOINTS
from emla_fmu.stroke_load import POINTS
from tests.support import joint_data
from tests.support.blocks.facts import BlockFacts, Draw, Point, around, magnitude, magnitudes, signed, signs
from tests.support.joint_data import TILT, observers


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
        "motor.cogging.periods": draw(st.integers(2, 12)),
        "motor.N_p": N_p,
        "gearbox.rho": rho,
        "gearbox.eta_GB": draw(st.floats(0.7, 0.95)),
        "screw.lead": 2.0 * math.pi * N_p * x_L / (rho * angle),
        "screw.q_LB": around(draw, x_L),
        "screw.q_UB": around(draw, x_L),
        "friction.F_C": F_C,
        "friction.F_S": F_C * draw(st.floats(1.1, 3.0)),
        "gearbox.directional": draw(st.booleans()),
        "inverter.delay": 0.0,
        "sensor.current.resolution": 0.0,
        "inverter.u_max": math.hypot(u_q, u_d) / (1.0 - sag) / around(draw, 1.0),
        "use_commanded_current": draw(st.booleans()),
        "sensor.sigma": sigma,
        "sensor.noise": noise,
        "sensor.resolution": (x_L + sigma * noise) / steps if quantized else 0.0,
        "start.x_L": x_L,
        **magnitudes(draw, {"motor.R_s": (0.05, 0.5), "motor.i_N": (5.0, 50.0), "motor.L_d": (1e-3, 5e-3)}),
        **magnitudes(draw, {"motor.L_q": (1e-3, 5e-3), "motor.B_m": (1e-3, 1e-2), "screw.C_eq": (0.1, 10.0)}),
        **magnitudes(draw, {"motor.J_m": (0.005, 0.05), "screw.B_BS": (1.0, 100.0)}),
        **magnitudes(draw, {"screw.v_max": (0.01, 1.0), "motor.Phi_PM": (0.05, 0.3)}),
        **magnitudes(draw, {"screw.M_BS": (50.0, 500.0), "stop.damping": (0.1, 10.0)}),
        **magnitudes(draw, {"inverter.i_0": (1.0, 10.0), "motor.i_max": (1.0, 100.0)}),
        **magnitudes(draw, {"screw.wobble": (1e-4, 1e-2), "coupling.J_c": (1e-3, 1e-2)}),
        **magnitudes(draw, {"gearbox.J_GB": (1e-3, 1e-2), "stop.stiffness": (1e3, 1e6)}),
        **magnitudes(draw, {"friction.v_S": (1e-3, 1e-1), "friction.v_0": (1e-3, 1e-1)}),
        **magnitudes(draw, {"motor.tau_th": (1.0, 100.0), "inverter.f_PWM": (1e3, 2e4)}),
        **magnitudes(draw, {"motor.alpha_R": (1e-4, 5e-3), "inverter.dead_time": (1e-6, 1e-5)}),
        **magnitudes(draw, {"sensor.eccentricity": (1e-3, 1e-1), "sensor.current.sigma": (1e-3, 1e-1)}),
        **magnitudes(draw, {"solver.internal_step": (1e-5, 1e-4), "motor.cogging.amplitude": (0.1, 2.0)}),
        "motor.permitted_rise": magnitude(draw, 10.0, 100.0),
        **signs(draw, {"d_2": (0.01, 1.0), "d_3": (0.1, 10.0), "d_4": (0.1, 10.0), "v_L": (1e-3, 0.3)}),
        **signs(draw, {"F_L": (100.0, 6e4), "i_q": (0.1, 100.0), "i_d": (0.1, 100.0)}),
        **signs(draw, {"i_q_ref": (1.0, 100.0), "gearbox.eta_back": (0.1, 0.9)}),
        **signs(draw, {"uncertainty.F_2": (0.01, 0.2), "uncertainty.F_3": (0.01, 0.2)}),
        **signs(draw, {"uncertainty.F_4": (0.01, 0.2), "screw.lead_error": (1e-3, 1e-2)}),
        **signs(draw, {"sensor.current.noise_q": (0.1, 2.0), "sensor.current.noise_d": (0.1, 2.0)}),
        "motor.temperature_rise": signed(draw, 1.0, 100.0),
    }
    kinks = {"inverter.delay", "sensor.current.resolution"}
    return Point(values, kinks=kinks if quantized else kinks | {"sensor.resolution"})


@st.composite
def compliant_points(draw: Draw) -> Point:
    """As the plant, in contact, within the play, or without play."""
    plant, backlash = draw(plant_points()), draw(st.sampled_from([0.0, 1e-3]))
    values = {
        **plant.values,
        "transmission.backlash": backlash,
        "start.deflection": signed(draw, 2e-3, 4e-3) if backlash else signed(draw, 1e-4, 4e-3),
        "sensor.at_load": draw(st.booleans()),
        **magnitudes(draw, {"load.m": (100.0, 1e4), "transmission.stiffness": (1e5, 1e7)}),
        "transmission.damping": magnitude(draw, 1.0, 100.0),
        "load.v": signed(draw, 1e-3, 0.3),
        "load.sensor.sigma": magnitude(draw, 1e-5, 1e-4),
        "load.sensor.noise": signed(draw, 0.1, 2.0),
    }
    return Point(values, kinks=plant.kinks | {"transmission.backlash", "load.sensor.resolution"})


def table_points(draw: Draw, x: float) -> Point:
    """A table, with x in the middle of one of its segments: the first, the last, or one in between."""
    segment, r = draw(st.sampled_from([0, 12, POINTS - 2])), draw(st.floats(0.3, 0.7))
    widths = [draw(st.floats(0.05, 0.2)) for _ in range(3)] * (POINTS // 3 + 1)
    first = x - sum(widths[:segment]) - r * widths[segment]
    # neighbouring slopes differ clearly, in sign as well: the slope of a smooth curve has kinks between
    slopes = [signed(draw, 1e3, 3e3) * factor for factor in (1.0, draw(st.floats(1.3, 2.0)), -0.6)]
    forces = [signed(draw, 1e3, 1e4)]
    for i in range(POINTS - 1):
        forces.append(forces[-1] + slopes[i % 3] * widths[i])
    values = {f"load.table.position[{i + 1}]": first + sum(widths[:i]) for i in range(POINTS)}
    values |= {f"load.table.force[{i + 1}]": force for i, force in enumerate(forces)}
    reach = {f"load.table.position[{i + 1}]": min(widths) for i in range(POINTS)}
    return Point(values | {"load.table.interpolation": draw(st.sampled_from([1, 2]))}, reach=reach)


def brake_values(draw: Draw, plant: Mapping[str, float]) -> dict[str, float]:
    """A brake that is open, slips, or holds clearly below its torque; the inverter is on or off."""
    angle, zeta = signed(draw, 1e-4, 1e-2), draw(st.floats(0.01, 0.2))
    frequency = magnitude(draw, 50.0, 150.0)
    alpha = 2.0 * math.pi * 7.0 / 0.02  # the default ratio and lead
    J = plant["motor.J_m"] + plant["coupling.J_c"] + plant["gearbox.J_GB"] + plant["screw.M_BS"] / alpha**2
    omega, speed = 2.0 * math.pi * frequency, alpha * plant["v_L"]
    torque = abs(J * omega * (omega * angle + 2.0 * zeta * speed))
    factor = draw(st.sampled_from([0.2, 5.0]))
    return {
        "brake.engaged": draw(st.sampled_from([0.2, 1.0])),
        "inverter.disabled": draw(st.sampled_from([0.2, 1.0])),
        "brake.torque": factor * (torque if factor > 1.0 else min(torque, abs(J * omega * omega * angle))),
        "brake.frequency": frequency,
        "brake.damping_ratio": zeta,
        "brake.angle": angle,
        "brake.slip": magnitude(draw, 1e-4, 1e-2),
    }


@st.composite
def axis_points(draw: Draw) -> Point:
    """As the plant, with a load along the stroke."""
    plant = draw(plant_points())
    table, brake = table_points(draw, plant.values["start.x_L"]), brake_values(draw, plant.values)
    return Point({**plant.values, **table.values, **brake}, kinks=plant.kinks, reach=table.reach)


@st.composite
def compliant_axis_points(draw: Draw) -> Point:
    """As the plant with such a load, with a load along the stroke."""
    plant = draw(compliant_points())
    table = table_points(draw, plant.values["start.x_L"] - plant.values["start.deflection"])
    brake = brake_values(draw, plant.values)
    return Point({**plant.values, **table.values, **brake}, kinks=plant.kinks, reach=table.reach)


@st.composite
def motor_points(draw: Draw) -> Point:
    """As the plant, with its motion as inputs."""
    plant, names = draw(plant_points()), {s.name for s in EmlaMotor.layout().scalars}
    values = {name: value for name, value in plant.values.items() if name in names}
    return Point({**values, "x_L": plant.values["start.x_L"]}, kinks=plant.kinks)


@st.composite
def observer_points(draw: Draw) -> Point:
    x_hat, y_bar = signed(draw, 0.05, 0.5), signed(draw, 0.01, 0.04)
    values = {
        "y": x_hat + y_bar,
        "use_model": draw(st.booleans()),
        "use_measured_current": draw(st.booleans()),
        "model.N_p": draw(st.integers(2, 10)),
        "solver.internal_step": 5e-5,
        "start.x_hat": x_hat,
        **magnitudes(draw, {"ell": (0.1, 3.0), "Q_11": (0.3, 3.0), "Q_22": (0.3, 3.0), "H_0": (2.0, 50.0)}),
        **magnitudes(draw, {"m_0": (20.0, 500.0), "ahead": (0.01, 0.3), "omega_d": (0.1, 3.0)}),
        **magnitudes(draw, {"omega_r": (0.1, 3.0), "alpha_1": (0.1, 10.0), "alpha_2": (0.1, 10.0)}),
        **magnitudes(draw, {"m_decay": (1e-3, 1e-1), "model.B_eq": (1.0, 10.0), "model.Phi_PM": (0.05, 0.3)}),
        **magnitudes(draw, {"model.A_eq": (10.0, 100.0), "start.eta_hat": (0.1, 10.0)}),
        **signs(draw, {"i_q": (1.0, 100.0), "Q_12": (0.01, 0.2), "d_hat": (0.1, 3.0), "r_hat": (0.1, 3.0)}),
        **signs(draw, {"v_hat": (1e-3, 0.3), "i_q_ref": (1.0, 100.0)}),
    }
    reach = dict.fromkeys(("y", "x_hat", "start.x_hat"), abs(y_bar))
    return Point(values, draw(st.floats(0.0, 10.0)), reach=reach)


@st.composite
def load_observer_points(draw: Draw) -> Point:
    """In contact, or without play."""
    y, backlash = signed(draw, 0.05, 0.5), draw(st.sampled_from([0.0, 1e-3]))
    deflection = signed(draw, 2e-3, 4e-3)
    values = {
        "y": y,
        "x_1": y + deflection,
        "model.backlash": backlash,
        "interpolate": draw(st.booleans()),
        "solver.internal_step": 5e-5,
        **magnitudes(draw, {"model.stiffness": (1e5, 1e7), "model.damping": (1.0, 100.0)}),
        **magnitudes(draw, {"model.m_load": (100.0, 1e4), "l_1": (100.0, 1e3), "l_2": (1e4, 1e5)}),
        **magnitudes(draw, {"l_3": (1e4, 1e5)}),
        **signs(draw, {"v_1": (1e-3, 0.3), "travel": (1e-3, 0.1), "v_hat": (1e-3, 0.3), "f_hat": (0.1, 3.0)}),
    }
    reach = dict.fromkeys(("y", "x_1"), abs(deflection) - 0.5 * backlash)
    return Point(values, kinks={"model.backlash"}, reach=reach)


@st.composite
def command_points(draw: Draw) -> Point:
    """At the start, with everything on; without a notch, an approach or stiffness in some."""
    off = draw(st.sampled_from(["", "approach.duration", "model.stiffness", "notch.frequency[2]"]))
    lags = [f"notch.p[{i}]" for i in range(1, 9)]
    values = {
        "interpolate": draw(st.booleans()),
        "solver.internal_step": 5e-5,
        **magnitudes(draw, {"model.stiffness": (1e5, 1e7), "model.m_load": (100.0, 1e4)}),
        **magnitudes(draw, {"model.backlash": (1e-4, 1e-3), "approach.duration": (0.1, 1.0)}),
        **magnitudes(draw, {"limit.v_max": (0.01, 1.0), "approach.a_max": (0.1, 10.0)}),
        **magnitudes(draw, {f"notch.frequency[{i}]": (1.0, 50.0) for i in (1, 2)}),
        **magnitudes(draw, {f"notch.damping_ratio[{i}]": (0.01, 0.5) for i in (1, 2)}),
        **magnitudes(draw, {"feedback.limit": (1e-3, 1e-2)}),
        **signs(draw, {"feedback.k_0": (1.0, 100.0), "feedback.k_1": (0.1, 1.0)}),
        **signs(draw, {"feedback.k_2": (1e-3, 0.1), "F_hat": (100.0, 6e4), "x_1": (0.05, 0.5)}),
        **signs(draw, {"x_d": (0.05, 0.5), "v_d": (1e-3, 0.3), "a_d": (0.1, 3.0)}),
        **signs(draw, {"load.x": (0.05, 0.5), "load.v": (1e-3, 0.3), "load.a": (0.1, 3.0)}),
        **signs(draw, dict.fromkeys(lags, (1e-3, 0.1))),
    }
    return Point(values | ({off: 0.0} if off else {}), kinks={off} if off else set())


@st.composite
def reference_points(draw: Draw) -> Point:
    """A time within a move or a dwell, or some periods later."""
    values: dict[str, Any] = {f"waypoint[{i + 1}]": signed(draw, 0.05, 0.5) for i in range(MOVES + 1)}
    moves, time, end = draw(st.integers(1, MOVES)), None, 0.0
    move, where_in_it = draw(st.integers(1, moves)), draw(st.floats(0.05, 0.95))
    in_a_move = draw(st.booleans())
    for i in range(1, moves + 1):
        start, duration = end + draw(st.floats(0.1, 0.5)), draw(st.floats(0.3, 2.0))
        values |= {f"move.start[{i}]": start, f"move.duration[{i}]": duration}
        if i == move:
            dwell = end + where_in_it * (start - end)
            time = start + where_in_it * duration if in_a_move else dwell
        end = start + duration
    assert time is not None
    periodic = draw(st.booleans())
    period = end * draw(st.floats(1.0, 1.5)) if periodic else 0.0
    time += period * draw(st.integers(0, 3))
    return Point({**values, "period": period}, time, set() if periodic else {"period"})


@st.composite
def disturbance_points(draw: Draw) -> Point:
    """A time on a load level, or within a ramp."""
    ramp = draw(st.floats(0.1, 0.5))
    values: dict[str, Any] = {
        "load.ramp": ramp,
        "d_2.is_force": draw(st.booleans()),
        "d_2.low": -magnitude(draw, 0.1, 1.0),
        "d_2.seed": draw(st.integers(1, 2147483646)),
        "supply.start": 5.0,
        "supply.duration": 1.0,
        **magnitudes(draw, {"d_2.high": (0.1, 1.0), "d_2.decay": (0.01, 1.0), "d_4.omega": (1.0, 10.0)}),
        **magnitudes(draw, {"load.ripple": (1.0, 100.0), "supply.depth": (0.01, 0.5)}),
        **magnitudes(draw, {"d_2.sample_time": (1e-4, 1e-2), "load.ripple_omega": (1.0, 10.0)}),
        **signs(draw, {"v_L": (1e-2, 3.0), "d_4.phase": (0.1, 3.0), "d_2.arctan": (0.1, 10.0)}),
        "d_4.amplitude": signed(draw, 0.1, 10.0),
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
def supply_points(draw: Draw) -> Point:
    """A voltage below that of the source, between source and chopper, within the band, or above."""
    u_0, u_on, band = 560.0, 650.0, 20.0
    u = draw(st.sampled_from([500.0, 600.0, 660.0, 690.0])) * draw(st.floats(0.99, 1.01))
    C, u_start = magnitude(draw, 1e-3, 1e-2), draw(st.floats(500.0, 700.0))
    values = {
        "link.C": C,
        "link.u_start": u_start,
        "link.stored": 0.5 * C * (u * u - u_start * u_start),
        "source.u_0": u_0,
        "chopper.u_on": u_on,
        "chopper.band": band,
        "solver.internal_step": 5e-5,
        **magnitudes(draw, {"source.R": (0.1, 1.0), "chopper.R": (5.0, 50.0), "link.u_low": (100.0, 300.0)}),
        **magnitudes(draw, {"link.u_high": (800.0, 1e3), "source.energy": (1.0, 1e3)}),
        **magnitudes(draw, dict.fromkeys(("source.loss", "chopper.energy"), (1.0, 1e3))),
        **magnitudes(draw, dict.fromkeys(("joint.drawn", "joint.returned"), (1.0, 1e3))),
        **{f"joint.u_max[{i}]": around(draw, u / math.sqrt(3.0)) for i in range(1, JOINTS + 1)},
        **signs(draw, {f"joint.P_el[{i}]": (1e3, 1e4) for i in range(1, JOINTS + 1)}),
        **magnitudes(draw, {f"joint.sag[{i}]": (0.01, 0.4) for i in range(1, JOINTS + 1)}),
    }
    reach = dict.fromkeys(("source.u_0", "chopper.u_on", "link.u_start"), 5.0) | {
        "link.stored": 0.01 * C * u * u
    }
    return Point(values, reach=reach)


@st.composite
def brake_points(draw: Draw) -> Point:
    """A time before a hold phase, after it, or in one of its three parts."""
    values = {
        **{f"phase.start[{i}]": 2.0 * i for i in range(1, PHASES + 1)},
        **{f"phase.end[{i}]": 2.0 * i + 1.0 for i in range(1, PHASES + 1)},
        "engage.delay": 0.3,
        "release.delay": 0.3,
        "before.i_q_ref": signed(draw, 1.0, 30.0),
        **signs(draw, dict.fromkeys(("x_d", "v_d", "x_hat"), (0.1, 1.0))),
        **signs(draw, dict.fromkeys(("a_d", "i_q", "i_d", "i_q_ref"), (1.0, 30.0))),
    }
    reach = {name: 0.1 for name in values if name.partition(".")[0] in ("phase", "engage", "release")}
    return Point(values, 4.0 + draw(st.sampled_from([-0.5, 0.15, 0.5, 0.85, 1.5])), reach=reach)


@st.composite
def fault_points(draw: Draw) -> Point:
    """A time clearly before, within or after the fault."""
    start, duration = draw(st.floats(0.3, 0.6)), draw(st.floats(0.3, 0.6))
    values = {
        "freeze": draw(st.booleans()),
        "start": start,
        "duration": duration,
        "gain": draw(st.sampled_from([1.0, -0.5, 3.0])),
        **signs(draw, {"u": (0.1, 10.0), "offset": (0.1, 10.0)}),
    }
    return Point(values, start + duration * draw(st.sampled_from([-0.4, 0.5, 1.4])))


DRIVE = asdict(joint_data.DRIVES["tilt"])
VOLTAGES = {
    "u_q": 300,
    "u_d": 200,
    "i_q_ref": 10,
    "F_L": 2e4,
    "d_2": 1,
    "d_3": 0.4,
    "d_4": 0.2,
    "supply.sag": 0.1,
}
MOVING = {"u_q": 30.0, "u_d": -5.0, "v_L": 0.02, "i_q": 5.0, "i_d": 1.0, "motor.i_N": 30.0}

LEVER = {
    "position": [0.2, 0.22, 0.25, 0.3, *[0.4] * 28],
    "force": [2e4, 1e4, 4e3, 3e3, *[-2e3] * 28],
    "interpolation": 2,
}
BRAKE = {"brake_torque": 20.0, "brake_damping_ratio": 0.1}
BRAKED = VOLTAGES | {"brake.engaged": 1.0, "inverter.disabled": 1.0}
SWINGING = {"brake.engaged": 1.0, "brake.torque": 1e3, "brake.frequency": 5.0}
"""A brake so soft and strong that it never slips."""

BETWEEN_POINTS = {**LEVER, "position": [0.1, 0.2, 0.3, 0.4, *[0.5] * 28]}
"""A table of which motions from the default start use one segment."""


PHASE = {"engage.delay": 0.05, "release.delay": 0.1}

FACTS = {
    "EmlaPlant": BlockFacts(
        start=start_values(
            EmlaPlant,
            TILT,
            DRIVE,
            {"sigma": 1e-6, "resolution": 1e-7, "L_d": 3e-3, "F_2": 0.01, "F_3": 0.002, "F_4": 0.001},
        ),
        inputs=VOLTAGES,
        smooth={
            **MOVING,
            "F_L": 1e3,
            "d_2": 0.1,
            "d_3": 1.0,
            "d_4": 2.0,
            "motor.L_q": 3e-3,
            "uncertainty.F_2": 0.1,
        },
        points=plant_points,
        exchange=(0.1, 2e-3),
        sampled=frozenset({"supply.sag"}),
    ),
    "EmlaCompliantPlant": BlockFacts(
        start=start_values(
            EmlaCompliantPlant,
            TILT,
            DRIVE,
            {"sigma": 1e-6, "resolution": 1e-7, "F_2": 0.01, "F_3": 0.002, "F_4": 0.001, "m_load": 1.5e4},
            {"stiffness": 7e7, "damping": 4e4, "backlash": 1e-4, "tau_cog": 0.5, "alpha_R": 4e-3},
            {"eccentricity": 1e-4, "lead_error": 1e-4, "wobble": 4e-6},
            {"sigma_load": 2e-6, "resolution_load": 1e-7},
        ),
        inputs=VOLTAGES,
        smooth={
            **MOVING,
            "F_L": 1e3,
            "load.v": 0.01,
            "load.m": 2e3,
            "transmission.stiffness": 1e7,
            "transmission.damping": 1e3,
        },
        points=compliant_points,
        exchange=(0.1, 2e-3),
        sampled=frozenset({"supply.sag"}),
    ),
    "EmlaAxis": BlockFacts(
        start=start_values(
            EmlaAxis, TILT, DRIVE, LEVER, BRAKE, {"sigma": 1e-6, "resolution": 1e-7, "F_2": 0.01}
        ),
        inputs=BRAKED,
        smooth={
            **MOVING,
            **SWINGING,
            **start_values(EmlaAxis, BETWEEN_POINTS),
            "F_L": 1e3,
            "d_2": 0.1,
            "motor.L_q": 3e-3,
        },
        points=axis_points,
        exchange=(0.1, 1.5e-3),
        sampled=frozenset({"supply.sag"}),
        still=frozenset({"brake.slip"}),  # tests/oracles has the slipping brake
    ),
    "EmlaCompliantAxis": BlockFacts(
        start=start_values(
            EmlaCompliantAxis,
            TILT,
            DRIVE,
            LEVER,
            BRAKE,
            {"sigma": 1e-6, "resolution": 1e-7, "m_load": 1.5e4, "sigma_load": 2e-6, "resolution_load": 1e-7},
            {"stiffness": 7e7, "damping": 4e4, "backlash": 1e-4},
        ),
        inputs=BRAKED,
        smooth={
            **MOVING,
            **SWINGING,
            **start_values(EmlaCompliantAxis, BETWEEN_POINTS),
            "F_L": 1e3,
            "load.v": 0.01,
            "load.m": 2e3,
            "transmission.stiffness": 1e7,
            "transmission.damping": 1e3,
        },
        points=compliant_axis_points,
        exchange=(0.1, 2e-3),
        sampled=frozenset({"supply.sag"}),
        still=frozenset({"brake.slip", "inverter.u_available"}),  # tests/oracles has the slipping brake
    ),
    "EmlaMotor": BlockFacts(
        start=start_values(
            EmlaMotor,
            TILT,
            joint_data.DRIVES["tilt"],
            {"sigma": 1e-6, "resolution": 1e-7, "L_d": 3e-3, "F_3": 0.002, "F_4": 0.001},
        ),
        inputs={"u_q": 300, "u_d": 200, "i_q_ref": 10, "x_L": 1e-3, "v_L": 0.05, "d_3": 0.4, "d_4": 0.2}
        | {"supply.sag": 0.1},
        smooth={
            "u_q": 30.0,
            "u_d": -5.0,
            "x_L": 0.24,
            "v_L": 0.02,
            "d_3": 1.0,
            "i_q": 5.0,
            "motor.L_q": 3e-3,
        },
        points=motor_points,
        exchange=(0.1, 1e-3),
        sampled=frozenset({"supply.sag"}),
    ),
    "EmlaObserver": BlockFacts(
        start=start_values(EmlaObserver, TILT, observers("robust")["tilt"], {"use_model": True}),
        inputs={"y": 1e-4, "i_q_ref": 10, "i_q": 10},
        smooth={"y": 0.5, "i_q_ref": 10.0, "v_hat": 0.1, "m_0": 100.0, "H_0": 10.0},
        points=observer_points,
        exchange=(0.1, 1e-2),
        still=frozenset({"d_hat", "r_hat"}),
    ),
    "LoadObserver": BlockFacts(
        start={"model.damping": 1e3, "model.backlash": 1e-4, "model.stiffness": 1e7},
        inputs={"y": 0.1, "x_1": 0.1, "v_1": 0.1},
        smooth={"interpolate": False, "x_1": 0.01, "v_1": 0.02, "v_hat": 0.1, "model.damping": 1e3}
        | {"model.stiffness": 1e5, "l_1": 40.0, "l_2": 500.0, "l_3": 4e3},
        points=load_observer_points,
        has_model_exchange=False,
        still=frozenset({"F_0"}),
    ),
    "ScrewCommand": BlockFacts(
        start={"model.stiffness": 1e8, "model.m_load": 1e4, "model.backlash": 1e-5, "feedback.k_0": 10.0}
        | {"approach.duration": 0.2, "notch.frequency[1]": 8.0, "notch.frequency[2]": 20.0}
        | {"notch.damping_ratio[1]": 0.05, "feedback.k_1": 0.2, "feedback.k_2": 0.02},
        inputs={"x_d": 0.1, "v_d": 0.1, "a_d": 1.0, "x_1": 0.1, "F_hat": 1e4}
        | {"load.x": 0.1, "load.v": 0.1, "load.a": 1.0},
        # rigid, without approach and feedback: progress, rate of the deflection and correction are sampled
        smooth={"interpolate": False, "x_d": 0.1, "v_d": 0.02, "x_1": 0.11}
        | {"notch.frequency[1]": 3.0, "notch.frequency[2]": 5.0, "notch.p[1]": 0.01},
        points=command_points,
        has_model_exchange=False,
    ),
    "Reference": BlockFacts(
        start={"waypoint[1]": 0.1, "waypoint[2]": 0.3, "waypoint[3]": 0.2, "period": 0.4}
        | {"move.duration[1]": 0.2, "move.start[2]": 0.25, "move.duration[2]": 0.1},
        inputs={},
        smooth={"waypoint[2]": 0.3, "move.start[1]": 0.05},
        points=reference_points,
    ),
    "Disturbance": BlockFacts(
        start={"load.level[1]": 1e4, "load.level[2]": 3e4, "load.start[2]": 0.3, "load.ripple": 5e3}
        | {"d_2.amplitude[1]": 0.8, "d_2.omega[1]": 7.0, "d_2.high": 2.0, "d_2.arctan": 1.2, "d_2.decay": 3.0}
        | {"d_3.amplitude[1]": 0.42, "d_3.omega[1]": 8.0, "d_3.phase[1]": 1.0, "d_4.amplitude": -0.15},
        inputs={"v_L": 0.1},
        smooth={"v_L": 0.1, "load.level[2]": 100.0, "load.start[2]": 0.1, "load.ripple": 7.0}
        | {"d_2.arctan": 3.0, "d_2.decay": 2.0, "d_2.amplitude[1]": 0.5, "d_2.omega[1]": 7.0}
        | {"d_3.amplitude[2]": 1.5, "d_3.omega[2]": 9.0}
        | {"d_4.amplitude": 2.5, "d_4.omega": 5.0, "d_4.phase": 0.5},
        points=disturbance_points,
        has_model_exchange=False,
    ),
    "HoldingBrake": BlockFacts(
        start={**PHASE, "phase.start[1]": 0.1, "phase.end[1]": 0.4},
        inputs={
            "x_d": 0.1,
            "v_d": 0.1,
            "a_d": 1.0,
            "x_hat": 0.1,
            **dict.fromkeys(("i_q", "i_d", "i_q_ref"), 10.0),
        },
        smooth={"x_d": 0.2, "x_hat": 0.3, "v_d": 0.1, "a_d": 0.5, "i_q": 3.0, "i_d": 1.0, "i_q_ref": 4.0},
        points=brake_points,
        has_model_exchange=False,
    ),
    "SharedSupply": BlockFacts(
        start={"link.C": 1e-3, "source.R": 0.5, "chopper.u_on": 780.0, "joint.u_max[2]": 430.0},
        inputs={**{f"joint.P_el[{i}]": 2e4 for i in range(1, JOINTS + 1)}}
        | {f"joint.sag[{i}]": 0.1 for i in range(1, JOINTS + 1)},
        # the source acts, and the chopper does not: they never act at the same time
        smooth={
            **{f"joint.P_el[{i}]": (-1.0) ** i * 900.0 * i for i in range(1, JOINTS + 1)},
            "link.C": 5e-3,
            "source.R": 0.5,
            "link.u_start": 700.0,
            **{f"joint.u_max[{i}]": 600.0 for i in range(1, JOINTS + 1)},
        },
        points=supply_points,
        exchange=(0.02, 1e-3),
    ),
    "SignalFault": BlockFacts(
        start={"freeze": True, "start": 0.1, "duration": 0.2},
        inputs={"u": 0.5},
        smooth={"u": 0.2, "gain": 2.0, "offset": 3.0, "start": 0.1},
        points=fault_points,
        has_model_exchange=False,
    ),
}
