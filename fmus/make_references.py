"""Write the reference solutions that an FMU can be checked against: `python -m fmus.make_references`.

Per model, in the form of the FMI cross-check rules: <Model>_in.csv (where it has inputs),
<Model>_ref.csv and <Model>_ref.opt; and <Model>_ref.toml with what these cannot say: start values,
tolerances, and what made them. <Model>_ref.ssv has the start values for tools of SSP, and the
experiments <Model>_validation.exp and <Model>_smoke_test.exp name these files, as FMI-LS-REF has it.
The solutions come from `tests/support/reference_model.py`, the paper's equations written independently of
the FMUs, and are exact to about 1e-11.

Inputs are those of a co-simulation: the value in the row of t_k is held until t_k+1, so step the
FMU by the file's interval (StepSize). Outputs in the row of t_k+1 belong to the inputs held up to
then; the first row is the state after initialization with the first row's inputs.
"""

import json
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from scipy.interpolate import BSpline, PchipInterpolator

from emla_cosim.fmu.parameters.parameter_sets import ParameterSet, SsvParameter, format_parameter_set
from fmublock.description import format_xml
from tests.support import reference_controllers as compared
from tests.support import reference_load_control as load_control
from tests.support import reference_model as paper
from tests.support.reference_drive import (
    Cogging,
    DeadTime,
    Drive,
    EndStops,
    Friction,
    HoldingBrake,
    MotorEncoder,
    Transmission,
    Winding,
)
from tests.support.reference_manipulator import Lagrangian, Merged
from tests.support.reference_model import Vector

FMUS = Path(__file__).parent

Row = dict[str, float]
TOLERANCE = 1e-12


@dataclass(frozen=True)
class Solution:
    """The files' content: a row per communication point, time left out; times in s."""

    step: float
    inputs: list[Row]
    outputs: list[Row]


def solved(
    step: float,
    inputs: Sequence[Row],
    start: Sequence[float],
    rates: Callable[[float, Vector, Row], Vector],
    outputs: Callable[[float, Vector, Row], Row],
) -> Solution:
    """The solution of x' = rates(t, x, u) with u held between the rows of `inputs`."""
    x = np.array(start)
    shown = [outputs(0.0, x, inputs[0])]
    for k, u in enumerate(inputs[:-1]):
        times = [k * step, (k + 1) * step]
        x = paper.solve(lambda t, s, u=u: rates(t, s, u), x, times, rtol=TOLERANCE, atol=1e-16)[-1]
        shown.append(outputs(times[1], x, u))
    return Solution(step, list(inputs), shown)


def rounded(row: Row) -> Row:
    """Twelve decimals, so that the files are short; the solution is that of what they say."""
    return {name: round(float(value), 12) + 0.0 for name, value in row.items()}


# ---- the plant: voltages and a load that shake it, beyond the inverter's limit for a moment ----

DRIVE = Drive(  # every effect of a drive that is not random
    dead_time=DeadTime(2e-6, 10e3, 5.0),
    friction=Friction(300.0, 450.0, 0.03),
    end_stops=EndStops(0.2385, 0.2412, 4e9, 3.0),
    winding=Winding(25.0, 80.0, 0.5, alpha_R=4e-3),
    cogging=Cogging(2.0, 12),
    encoder=MotorEncoder(2e-3, 1e-3, 2e-5),
    eta_back=0.7,
    v_0=0.01,
)
DELAY = 2
"""Steps by which the plant's voltages come late."""
ACTUATOR = paper.Actuator(drive=DRIVE)
INPUT_NAMES = {"sag": "supply.sag"}
"""FMI names of inputs that go by another name in the reference model."""


def demands(k: int, step: float) -> Row:
    """What drives the electrical half at t_k."""
    t, long = k * step, k == 100  # 634 V are asked for, 445 V can be had
    return {
        "u_q": 600.0 if long else 15.0 * math.sin(40.0 * t) + 5.0,
        "u_d": -205.0 if long else 8.0 * math.cos(25.0 * t),
        "i_q_ref": 20.0 * math.sin(30.0 * t),  # not used: use_commanded_current is false
        "d_3": 0.42 * math.cos(8.0 * t + math.pi / 3.0),
        "d_4": -0.15 * math.cos(12.0 * t + math.pi / 6.0),
        "sag": 0.1 if 0.14 <= t < 0.15 else 0.0,
    }


def effective(inputs: Sequence[Row]) -> list[Row]:
    """The inputs with the voltages that take effect; "next u_q" and "next u_d" are those of the next step.

    The outputs in the end of a step show the voltages that take effect then.
    """

    def late(k: int) -> Row:  # 0 V before
        return {name: inputs[k - DELAY][name] if k >= DELAY else 0.0 for name in ("u_q", "u_d")}

    return [
        {**u, **late(k), **{f"next {name}": value for name, value in late(k + 1).items()}}
        for k, u in enumerate(inputs)
    ]


def acting(u: Row, later: bool = False) -> paper.PlantInputs:
    """What acts in a step, or after it with the voltages that take effect then."""
    given = {field.name: u[field.name] for field in fields(paper.PlantInputs) if field.name in u}
    return paper.PlantInputs(**given | ({"u_q": u["next u_q"], "u_d": u["next u_d"]} if later else {}))


def named(inputs: Sequence[Row]) -> list[Row]:
    """Inputs by their FMI names."""
    return [{INPUT_NAMES.get(name, name): value for name, value in u.items()} for u in inputs]


def shaken(k: int, step: float) -> Row:
    """What acts on the whole plant at t_k: `demands`, and a load that reverses."""
    t = k * step
    load = 4e3 * (1.0 if t < 0.12 else -1.0)
    disturbance = 0.8 * math.sin(8.0 * t) + 0.7 * math.sin(20.0 * t)
    row = {**demands(k, step), "F_L": load, "d_2": disturbance}
    return rounded({field.name: row[field.name] for field in fields(paper.PlantInputs)})


LEVER = (
    np.array([0.2375, 0.239, 0.2398, 0.2404, 0.2415]),
    np.array([3.5e3, 2.5e3, 0.5e3, -0.8e3, -1.2e3]),
)
"""Positions in m and forces in N of a load along the stroke, which brakes and drives."""

Along = Callable[[float], float]
"""A load along the stroke: force in N at a position in m."""


def lever(x: float) -> float:
    """The force of `LEVER`, a smooth curve held beyond its ends."""
    return float(PchipInterpolator(*LEVER)(min(max(x, LEVER[0][0]), LEVER[0][-1])))


def loaded(u: paper.PlantInputs, along: Along | None, x: float) -> paper.PlantInputs:
    """The inputs with the force along the stroke at x in m."""
    return u if along is None else replace(u, F_L=u.F_L + along(x))


BRAKE = HoldingBrake(500.0, 60.0, 0.1, ACTUATOR.known.A_eq / ACTUATOR.known.alpha_RL)

Rates = Callable[[float, Vector, Row], Vector]
Outputs = Callable[[float, Vector, Row], Row]


def holding(k: int) -> Row:
    """What a brake does at t_k: it holds without slipping. The inverter is off for a while."""
    return {"brake.engaged": float(40 <= k < 220), "inverter.disabled": float(110 <= k < 200)}


def braked(rates: Rates, outputs: Outputs) -> tuple[Rates, Outputs]:
    """Rates and outputs of an axis with the brake: the last states are its angle and its slip.

    Those of the axis without it begin with (x_L, v_L, i_q, i_d), and end with the winding's temperature.
    """
    p = ACTUATOR

    def torque(x: Vector, u: Row) -> float:
        return u["brake.engaged"] * BRAKE.torque(float(x[-2]), p.known.alpha_RL * float(x[1]))

    def with_brake(t: float, x: Vector, u: Row) -> Vector:
        own, speed, angle = rates(t, x[:-2], u), p.known.alpha_RL * float(x[1]), float(x[-2])
        own[1] -= torque(x, u) / p.known.A_eq
        if u["inverter.disabled"] and DRIVE.winding is not None:
            R_s = p.R_s * (1.0 + DRIVE.winding.alpha_R * float(x[-3]))
            own[2:4] = -R_s * x[2:4] / np.array([p.L_q, p.L_d])
        if not u["brake.engaged"]:
            return np.array([*own, -angle / BRAKE.released, 0.0])
        slips = BRAKE.slips(angle, speed)
        return np.array([*own, 0.0 if slips else speed, abs(float(x[1])) if slips else 0.0])

    def shown(t: float, x: Vector, u: Row) -> Row:
        own, tau = outputs(t, x[:-2], u), torque(x, u)
        if u["inverter.disabled"]:
            own |= dict.fromkeys(("inverter.u_q", "inverter.u_d", "inverter.saturated", "P_el"), 0.0)
        brake = {"brake.angle": float(x[-2]), "brake.slip": float(x[-1]), "brake.tau": tau}
        own["a_L"] -= tau / p.known.A_eq
        return {**own, **brake}

    return with_brake, shown


def plant(along: Along | None = None) -> Solution:
    """0.18 s: the open loop rings with some 40 Hz between its end stops."""
    step, count, p = 5e-4, 301 if along else 361, ACTUATOR

    def rates(t: float, x: Vector, u: Row) -> Vector:
        rise, given = float(x[4]), loaded(acting(u), along, float(x[0]))
        return np.array([*paper.plant_rates(p, x[:4], given, rise), paper.heating(p, x[:4], rise)])

    def outputs(t: float, x: Vector, u: Row) -> Row:
        given = loaded(acting(u, later=True), along, float(x[0]))
        shown = {**paper.plant_outputs(p, x[:4], given), "motor.temperature_rise": float(x[4])}
        return shown if along is None else {**shown, "load.force": given.F_L}

    inputs, start = [shaken(k, step) for k in range(count)], [0.24, 0.0, 0.0, 0.0, 0.0]
    laws: tuple[Rates, Outputs] = (rates, outputs)
    if along is not None:
        inputs = [u | holding(k) for k, u in enumerate(inputs)]
        laws, start = braked(*laws), [*start, 0.0, 0.0]
    solution = solved(step, effective(inputs), start, *laws)
    return Solution(step, named(inputs), solution.outputs)


# ---- the same with a load that swings, and hits both ends of the play ----------------------------

TRANSMISSION = Transmission(m=500.0, k=4e6, c=2e3, b=4e-4)
DEFLECTION = 1.2e-3
"""Deflection at the start, in m: that of the first load at rest."""


def compliant_plant(along: Along | None = None) -> Solution:
    """0.145 s; the load reverses at 0.12 s and crosses the play."""
    step, count, p, t = 5e-4, 261 if along else 291, ACTUATOR, TRANSMISSION

    def rates(_: float, x: Vector, u: Row) -> Vector:
        rise, given = float(x[6]), loaded(acting(u), along, float(x[0] - x[4]))
        return np.array([*paper.compliant_rates(p, t, x[:6], given, rise), paper.heating(p, x[:4], rise)])

    def outputs(_: float, x: Vector, u: Row) -> Row:
        given = loaded(acting(u, later=True), along, float(x[0] - x[4]))
        shown = {**paper.compliant_outputs(p, t, x[:6], given), "motor.temperature_rise": float(x[6])}
        return shown if along is None else {**shown, "load.force": given.F_L}

    inputs = [shaken(k, step) for k in range(count)]
    start = [0.24, 0.0, 0.0, 0.0, DEFLECTION, 0.0, 0.0]
    laws: tuple[Rates, Outputs] = (rates, outputs)
    if along is not None:
        inputs = [u | holding(k) for k, u in enumerate(inputs)]
        laws, start = braked(*laws), [*start, 0.0, 0.0]
    solution = solved(step, effective(inputs), start, *laws)
    return Solution(step, named(inputs), solution.outputs)


# ---- its electrical half: the same voltages, at a screw that is moved ---------------------------

MECHANICAL = ("x_L", "v_L", "a_L", "P_L")
"""What of the plant's outputs belongs to its mechanical half."""


def motor() -> Solution:
    """0.18 s of a prescribed motion, some 3 mm either way."""
    step, count, p = 5e-4, 361, ACTUATOR

    def given(k: int) -> Row:
        t = k * step
        motion = {"x_L": 0.24 + 3e-3 * math.sin(30.0 * t), "v_L": 0.09 * math.cos(30.0 * t)}
        return rounded({**motion, **demands(k, step)})

    def whole(x: Vector, u: Row) -> Vector:
        return np.array([u["x_L"], u["v_L"], x[0], x[1]])

    def rates(t: float, x: Vector, u: Row) -> Vector:
        state = whole(x, u)
        rise = float(x[2])
        return np.array([*paper.plant_rates(p, state, acting(u), rise)[2:], paper.heating(p, state, rise)])

    def outputs(t: float, x: Vector, u: Row) -> Row:
        shown = paper.plant_outputs(p, whole(x, u), acting(u, later=True))
        own = {name: value for name, value in shown.items() if name not in MECHANICAL}
        return {**own, "motor.temperature_rise": float(x[2])}

    inputs = [given(k) for k in range(count)]
    solution = solved(step, effective(inputs), [0.0, 0.0, 0.0], rates, outputs)
    return Solution(step, named(inputs), solution.outputs)


# ---- the observer: a position that it trails and overtakes ------------------------------------


def observer() -> Solution:
    """1 s with the published gains; eta_hat falls from 1 to what the innovation sustains."""
    step, count = 2.5e-3, 401
    o = paper.Observer()

    def given(k: int) -> Row:
        t = k * step
        return rounded(
            {
                "y": 0.245 + 0.004 * math.sin(6.0 * t) + (0.002 if t >= 0.4 else 0.0),
                "i_q_ref": 4.0 * math.cos(7.0 * t),
                "i_q": 3.9 * math.cos(7.0 * t),
            }
        )

    return solved(
        step,
        [given(k) for k in range(count)],
        [0.24, 0.0, 0.0, 1.0, 0.0],
        lambda t, s, u: paper.observer_rates(o, t, s, u["y"], u["i_q_ref"]),
        lambda t, s, u: paper.observer_outputs(o, t, s, u["y"]),
    )


# ---- a load that is not rigid: its observer, and the commands of the screw ----------------------

LOAD = load_control.Load(k=4e6, m=500.0, c=2e3, b=4e-4)
LOAD_OBSERVER = load_control.Observer(LOAD, (700.0, 2e5, 2e7))


def load_observer() -> Solution:
    """0.3 s; the load swings, and an unknown force pushes it from 0.12 s on."""
    step, count = 1e-3, 301

    def given(k: int) -> Row:
        t = k * step
        swing, pushed = 3e-5 * math.sin(85.0 * t) * (1.0 - math.exp(-t / 0.02)), 2e-5 * (t >= 0.12)
        x_1 = 0.24 + 2e-3 * (1.0 - math.cos(14.0 * t))
        return rounded({"y": x_1 - 1.2e-3 + swing - pushed, "x_1": x_1, "v_1": 0.028 * math.sin(14.0 * t)})

    inputs = [given(k) for k in range(count)]
    return Solution(step, inputs, LOAD_OBSERVER.run(inputs, step))


COMMAND = load_control.Command(
    LOAD,
    approach=(0.1, 0.4),
    v_max=0.06,  # the move alone needs it at its peak
    notches=((7.8, 0.02), (13.0, 0.1)),
    gains=(27.0, 0.18, 0.01),
    limit=3e-4,
)


def screw_command() -> Solution:
    """0.6 s: a start 3 mm off, a move, a force that reverses, and a correction that meets its limit."""
    step, count = 2e-3, 301
    move = paper.Motion((0.243, 0.251), (0.15,), (0.25,))

    def given(k: int) -> Row:
        t = k * step
        x_d, v_d, a_d = paper.reference(move, t)
        force = 4e3 if t < 0.2 else 4e3 + 2e4 * (t - 0.2) if t < 0.45 else -2e3
        pushed = 5e-4 * (t >= 0.35)
        return rounded(
            {
                "x_d": x_d,
                "v_d": v_d,
                "a_d": a_d,
                "x_1": 0.2412 + 1e-3 * math.sin(9.0 * t),
                "F_hat": force,
                "load.x": x_d - 3e-3 * math.exp(-12.0 * t) + 4e-5 * math.cos(50.0 * t) + pushed,
                "load.v": v_d + 0.036 * math.exp(-12.0 * t) - 2e-3 * math.sin(50.0 * t),
                "load.a": a_d - 0.432 * math.exp(-12.0 * t) - 0.1 * math.cos(50.0 * t),
            }
        )

    inputs = [given(k) for k in range(count)]
    return Solution(step, inputs, COMMAND.run(inputs, step))


OMEGA_U = 50.0
"""Bandwidth in 1/s of the controller's estimates of d_3 and d_4."""


# ---- the controller: errors of a size that the published gains can live with --------------------


def controller() -> Solution:
    """0.4 s along a quintic move; i_q* of some 50 A, and currents that follow it closely.

    With estimates of the disturbances. What z_q and z_d integrate is the voltage of the last step's end.
    """
    step, count = 1e-3, 401
    c = paper.Controller(compensate=True, omega_u=OMEGA_U)
    move = paper.Motion((0.240, 0.252), (0.0,), (0.4,))

    def given(k: int) -> Row:
        t = k * step
        x_d, v_d, a_d = paper.reference(move, t)
        v_hat = v_d + 2e-4 * math.sin(30.0 * t)
        # the printed law wants v_hat = -beta_1 / 2 P_1; what differs from it is P_2
        x_hat = x_d - v_hat / 1500.0 + 8e-7 * math.cos(17.0 * t)
        i_d = 0.05 * math.sin(11.0 * t)
        d_hat = 0.3 * math.sin(9.0 * t)
        row = {"x_hat": x_hat, "v_hat": v_hat, "i_q": 0.0, "i_d": i_d, "x_d": x_d, "v_d": v_d, "a_d": a_d}
        row |= {"d_hat": d_hat, "u_available": 440.0}
        wanted = paper.control(c, np.zeros(4), (x_hat, v_hat, 0.0, i_d), (x_d, v_d, a_d), d_hat).i_q_ref
        return rounded({**row, "i_q": wanted + 0.5 * math.cos(23.0 * t)})

    def signals(s: Vector, u: Row) -> paper.Signals:
        x, x_d = (u["x_hat"], u["v_hat"], u["i_q"], u["i_d"]), (u["x_d"], u["v_d"], u["a_d"])
        return paper.control(c, s[:4], x, x_d, u["d_hat"], s[4:])

    def rates(s: Vector, u: Row, voltage: tuple[float, float]) -> Vector:
        now = signals(s, u)
        before = replace(now, u_q=voltage[0], u_d=voltage[1])
        x = (u["x_hat"], u["v_hat"], u["i_q"], u["i_d"])
        return np.array([*paper.adaptation(c, s[:4], now), *paper.currents_of_known(c, x, s[4:], before)])

    inputs, s, voltage = [given(k) for k in range(count)], np.zeros(6), (0.0, 0.0)
    shown = [paper.controller_outputs(s, signals(s, inputs[0]))]
    for k, u in enumerate(inputs[:-1]):
        times = [k * step, (k + 1) * step]
        s = paper.solve(lambda _, s, u=u, v=voltage: rates(s, u, v), s, times, rtol=TOLERANCE, atol=1e-16)[-1]
        now = signals(s, u)
        shown.append(paper.controller_outputs(s[:4], now, s[4:]))
        voltage = (now.u_q, now.u_d)
    return Solution(step, inputs, shown)


# ---- the controllers that it is compared with: the same move, and a start that asks for too much ----


def compared_with(c: compared.Foc | compared.Cac | compared.Anatc, states: int) -> Solution:
    """0.1 s with the default gains: first at the limits of current or voltage, later the supply sags."""
    step, count = 1e-3, 101
    move = paper.Motion((0.240, 0.252), (0.0,), (0.4,))

    def given(k: int) -> Row:
        t = k * step
        x_d, v_d, a_d = paper.reference(move, t)
        return rounded(
            {
                "x_hat": x_d - 2e-3 * math.exp(-60.0 * t) + 3e-6 * math.cos(17.0 * t),
                "v_hat": v_d + 0.12 * math.exp(-60.0 * t) + 2e-4 * math.sin(30.0 * t),
                "d_hat": 0.3 * math.sin(9.0 * t),
                "i_q": 20.0 + 15.0 * math.sin(25.0 * t),
                "i_d": 0.5 * math.sin(11.0 * t),
                "u_available": 440.0 - (390.0 if 0.07 <= t < 0.08 else 0.0),
                "x_d": x_d,
                "v_d": v_d,
                "a_d": a_d,
            }
        )

    def at(u: Row) -> compared.Given:
        x = u["x_hat"], u["v_hat"], u["i_q"], u["i_d"]
        return compared.Given(x, (u["x_d"], u["v_d"], u["a_d"]), u["d_hat"], u["u_available"])

    return solved(
        step,
        [given(k) for k in range(count)],
        [0.0] * states,
        lambda t, s, u: c.evaluate(t, s, at(u))[0],
        lambda t, s, u: c.evaluate(t, s, at(u))[1],
    )


# ---- a shared supply: joints that draw, return more than others need, and draw again ------------

LINK = {"C": 1e-3, "u_start": 560.0, "u_0": 565.0, "R": 0.5, "u_on": 650.0, "band": 8.0, "R_chopper": 30.0}
U_MAX = (330.0, 326.0, 328.0)
"""Voltages in V of the joints with power; the others have the default."""


def shared_supply() -> Solution:
    """0.4 s; the state of this solution is the voltage, that of the block the stored energy."""
    step, count, k, root = 1e-3, 401, LINK, math.sqrt(3.0)

    def given(n: int) -> Row:
        t = n * step
        powers = [4e3 * math.sin(20.0 * t), 3e3 - 22e3 * (0.15 <= t < 0.25), -1.5e3 * math.cos(9.0 * t)]
        sags = [0.1 if 0.3 <= t < 0.32 else 0.0, 0.0, 0.0]
        filled_up = {"joint.P_el": powers, "joint.sag": sags}
        return rounded(
            {f"{name}[{i}]": ([*x, *[0.0] * 5])[i - 1] for name, x in filled_up.items() for i in range(1, 9)}
        )

    def currents(u: float) -> tuple[float, float]:
        duty = min(max((u - k["u_on"]) / k["band"], 0.0), 1.0)
        return max(k["u_0"] - u, 0.0) / k["R"], duty * u / k["R_chopper"]

    def joints(u: Row) -> list[float]:
        return [u[f"joint.P_el[{i}]"] for i in range(1, 9)]

    def rates(_: float, x: Vector, u: Row) -> Vector:
        voltage, powers = float(x[0]), joints(u)
        source, chopper = currents(voltage)
        return np.array(
            [
                (source - chopper - sum(powers) / voltage) / k["C"],
                k["u_0"] * source,
                k["R"] * source**2,
                voltage * chopper,
                sum(p for p in powers if p > 0.0),
                -sum(p for p in powers if p < 0.0),
            ]
        )

    def outputs(_: float, x: Vector, u: Row) -> Row:
        voltage, *energies = x.tolist()
        source, chopper = currents(voltage)
        names = ("source.energy", "source.loss", "chopper.energy", "joint.drawn", "joint.returned")
        u_max = [*U_MAX, *[445.0] * 5]
        return {
            **dict(zip(names, energies, strict=True)),
            "link.stored": 0.5 * k["C"] * (voltage**2 - k["u_start"] ** 2),
            "link.u": voltage,
            "source.P": k["u_0"] * source,
            "chopper.P": voltage * chopper,
            **{
                f"supply.sag[{i}]": 1.0
                - (1.0 - u[f"joint.sag[{i}]"]) * min(voltage / (root * u_max[i - 1]), 1.0)
                for i in range(1, 9)
            },
        }

    return solved(step, [given(n) for n in range(count)], [k["u_start"], *[0.0] * 5], rates, outputs)


# ---- the reference: way-points out and back, again after a period -------------------------------

MOTION = paper.Motion(
    waypoints=(0.05, 0.1333, 0.2167, 0.30, 0.2375, 0.175, 0.1125, 0.08, 0.05),
    starts=(0.3, 1.5, 2.6, 3.9, 5.0, 6.05, 7.1, 8.0),
    durations=(1.2, 1.0, 1.1, 0.9, 0.95, 1.05, 0.8, 0.6),
    period=9.1,
)


def reference() -> Solution:
    """12 s: one period and part of the next."""
    step, count = 0.025, 481
    rows = [
        dict(zip(("x_d", "v_d", "a_d"), paper.reference(MOTION, k * step), strict=True)) for k in range(count)
    ]
    return Solution(step, [], rows)


# ---- the disturbance: six load levels with ripple, (82) of the lift and (83) --------------------

SURROUNDINGS = paper.Surroundings(
    levels=(7e3, 20e3, 40e3, 60e3, 70e3, -5e3),
    level_starts=(1.0, 2.5, 4.0, 6.0, 8.0),
    ramp=0.5,
    ripple=(2.5e3, 2.0 * math.pi, 0.0),
    sines_2=((0.8, 8.0, 0.0), (0.7, 20.0, math.pi / 4.0)),
    arctan_2=1.2,
    decay_2=0.3,
    cosines_3=((0.42, 8.0, math.pi / 3.0), (0.032, 5.0, -math.pi / 2.0)),
    cosine_4=(-0.15, 12.0, math.pi / 6.0),
    sag=(0.2, 3.01, 0.5),
)


def disturbance() -> Solution:
    """10 s; the speed enters through an arctan only."""
    step, count = 0.02, 501
    inputs = [rounded({"v_L": 0.06 * math.sin(2.0 * k * step)}) for k in range(count)]
    held = [inputs[0], *inputs]
    return Solution(
        step, inputs, [paper.disturbance(SURROUNDINGS, k * step, held[k]["v_L"]) for k in range(count)]
    )


# ---- the fault: a signal that freezes and comes back --------------------------------------------

FREEZE = (0.3, 0.25)
"""When it begins and how long it lasts, in s."""


def signal_fault() -> Solution:
    """1 s; what is kept is the last value before it begins."""
    step, count = 5e-3, 201
    inputs = [rounded({"u": 0.2 + 0.1 * math.sin(9.0 * k * step)}) for k in range(count)]
    held = [inputs[0]["u"], *(row["u"] for row in inputs)]
    first, end = round(FREEZE[0] / step), round(sum(FREEZE) / step)
    outputs = [
        {"y": held[first - 1] if first <= k < end else held[k], "active": float(first <= k < end)}
        for k in range(count)
    ]
    return Solution(step, inputs, outputs)


# ---- the sequence of a holding brake: two phases, in the second of which the reference moves ----

PHASES, ENGAGE, RELEASE = ((0.2, 0.5), (0.6, 0.9)), 0.05, 0.1
"""Start and end of hold phases, and delays to engage and release, in s."""


def holding_brake() -> Solution:
    """1 s; while the drive is off, estimates and the demand of the last step take the place of signals."""
    step, count = 5e-3, 201
    inputs = list[Row]()
    for k in range(count):
        t = k * step
        wave = {
            name: math.sin((5.0 + i) * t + i) for i, name in enumerate(("x_hat", "i_q", "i_d", "i_q_ref"))
        }
        v_d = 0.05 * math.sin(20.0 * t) if t < 0.15 or t > 0.7 else 0.0
        inputs.append(rounded({"x_d": 0.3 + 0.01 * t, "v_d": v_d, "a_d": 10.0 * v_d, **wave}))
    outputs = list[Row]()
    for k in range(count):
        # what is held during a step is shown at its end
        u, last = inputs[max(k - 1, 0)], inputs[max(k - 1, 0)]["i_q_ref"] if k else 0.0

        def at(after: float, before: float, k: int = k) -> bool:
            n, (a, b) = k, (round(after / step), round(before / step))
            return any(round(s / step) + a <= n < round(e / step) - b for s, e in PHASES)

        holds, off = at(0.0, 0.0), at(ENGAGE, RELEASE)
        outputs.append(
            {
                "x_r": u["x_hat"] if off else u["x_d"],
                "v_r": 0.0 if off else u["v_d"],
                "a_r": 0.0 if off else u["a_d"],
                "i_q_c": last if off else u["i_q"],
                "i_d_c": 0.0 if off else u["i_d"],
                "holds": float(holds),
                "moves": float(holds and u["v_d"] != 0.0),
                "engaged": float(at(ENGAGE, 0.0)),
                "disabled": float(off),
            }
        )
    return Solution(step, inputs, outputs)


# ---- the manipulator: motions of all three strokes, and a payload that becomes lighter ----------

JOINTS = ("lift", "tilt", "telescope")
MIDDLE, SWING, RATE = np.array([0.25, 0.35, 0.5]), np.array([0.2, 0.2, 0.35]), np.array([2.0, 2.6, 1.7])
MANIPULATOR = Lagrangian()


def payload(t: float) -> float:
    """In kg."""
    return 470.0 if t < 0.5 else 400.0


def elements(**arrays: Vector) -> Row:
    """Elements of arrays by FMI name."""
    return {n: float(x) for name, values in arrays.items() for n, x in indexed(name, values).items()}


def place(tip: Vector) -> Row:
    """Where the tip is, by FMI name."""
    return {"tip.x": float(tip[0]), "tip.y": float(tip[1])}


def manipulator() -> Solution:
    """1.5 s with speeds of up to 0.6 m/s and the most part of the strokes."""
    step, count = 1e-2, 151

    def given(k: int) -> Row:
        t = k * step
        x_L, v_L = MIDDLE + SWING * np.sin(RATE * t), SWING * RATE * np.cos(RATE * t)
        motion = elements(x_L=x_L, v_L=v_L, a_L=-SWING * RATE**2 * np.sin(RATE * t))
        return rounded({**motion, "payload.m": payload(t)})

    def shown(u: Row) -> Row:
        x_L, v_L, a_L = ([u[name] for name in indexed(n, JOINTS)] for n in ("x_L", "v_L", "a_L"))
        tip = MANIPULATOR.at(x_L, v_L, u["payload.m"])[3]
        F_L = MANIPULATOR.forces(x_L, v_L, a_L, u["payload.m"])
        return {**elements(F_L=F_L), **place(tip)}

    inputs = [given(k) for k in range(count)]
    return Solution(step, inputs, [shown(u) for u in [inputs[0], *inputs[:-1]]])


MERGED = Merged(
    J=(0.018, 0.013, 0.00110),
    B_BS=(50.0, 40.0, 30.0),
    C_eq=(2.0, 1.0, 0.5),
    eta_GB=(0.85, 0.9, 0.95),
    F_2=(0.1, 0.2, 0.3),
)
START = ((0.244, 0.389, 0.499), (0.01, -0.02, 0.03))


def merged_plant() -> Solution:
    """1 s: torques that shake what they carry."""
    step, count = 5e-3, 201
    bearing, shaking = np.array([30.0, 7.5, -5.2]), np.array([6.0, 8.0, 0.4])

    def given(k: int) -> Row:
        t = k * step
        tau_m = bearing + shaking * np.cos(np.array([9.0, 12.0, 7.0]) * t)
        d_2 = np.array([0.8, 0.5, 0.6]) * np.cos(np.array([8.0, 20.0, 30.0]) * t)
        return rounded({**elements(tau_m=tau_m, d_2=d_2), "payload.m": payload(t)})

    def moved(x: Vector, u: Row) -> tuple[Vector, Vector]:
        tau_m, d_2 = (np.array([u[name] for name in indexed(n, JOINTS)]) for n in ("tau_m", "d_2"))
        return MERGED.acceleration(x, tau_m, d_2, u["payload.m"])

    def outputs(t: float, x: Vector, u: Row) -> Row:
        a_L, F_L = moved(x, u)
        tip = MERGED.lagrangian.at(x[:3], x[3:], u["payload.m"])[3]
        arrays = elements(x_L=x[:3], v_L=x[3:], a_L=a_L, F_L=F_L)
        return {**arrays, **place(tip), "energy": MERGED.energy(x, u["payload.m"])}

    def rates(t: float, x: Vector, u: Row) -> Vector:
        return np.array([*x[3:], *moved(x, u)[0]])

    return solved(step, [given(k) for k in range(count)], [*START[0], *START[1]], rates, outputs)


# ---- the trajectory: a spline that begins late, ends early, and has a knot twice ----------------

CURVE = BSpline(
    np.array([0.5] * 5 + [1.0, 1.75, 3.0, 3.0, 4.5, 6.1, 7.0, 8.8] + [9.5] * 5),
    np.array(
        [
            [0.20, 0.22, 0.21, 0.25, 0.30, 0.28, 0.33, 0.35, 0.31, 0.26, 0.27, 0.24, 0.25],
            [0.40, 0.41, 0.45, 0.43, 0.38, 0.36, 0.39, 0.44, 0.48, 0.47, 0.42, 0.43, 0.41],
            [0.50, 0.45, 0.30, 0.35, 0.52, 0.70, 0.66, 0.40, 0.22, 0.18, 0.33, 0.48, 0.52],
        ]
    ).T,
    4,
)


def trajectory() -> Solution:
    """10 s; scipy's splines are not ours."""
    step, count = 0.025, 401
    first, last = CURVE.t[0], CURVE.t[-1]

    def row(t: float) -> Row:
        x_d, v_d, a_d = (CURVE(min(max(t, first), last), nu=order) for order in range(3))
        moves = float(first - 1e-9 <= t <= last + 1e-9)
        return elements(x_d=x_d, v_d=moves * v_d, a_d=moves * a_d)

    return Solution(step, [], [row(k * step) for k in range(count)])


# ---- files --------------------------------------------------------------------------------------

SOLUTIONS: dict[str, Callable[[], Solution]] = {
    "EmlaPlant": plant,
    "EmlaCompliantPlant": compliant_plant,
    "EmlaAxis": lambda: plant(lever),
    "EmlaCompliantAxis": lambda: compliant_plant(lever),
    "EmlaMotor": motor,
    "EmlaObserver": observer,
    "LoadObserver": load_observer,
    "ScrewCommand": screw_command,
    "Reference": reference,
    "Disturbance": disturbance,
    "RsbaController": controller,
    "FocController": lambda: compared_with(compared.Foc(omega_d=500.0), 3),
    "CacController": lambda: compared_with(compared.Cac(omega_n=(500.0, 1000.0)), 11),
    "AnatcController": lambda: compared_with(compared.Anatc(), 6),
    "HoldingBrake": holding_brake,
    "SharedSupply": shared_supply,
    "SignalFault": signal_fault,
    "HdrmManipulator": manipulator,
    "HdrmPlant": merged_plant,
    "Trajectory": trajectory,
}
"""What makes the files of each model."""


def indexed(name: str, values: Iterable[Any], first: int = 1) -> dict[str, Any]:
    """Elements of an array variable by FMI name."""
    return {f"{name}[{i}]": value for i, value in enumerate(values, first)}


def filled(values: Vector, length: int) -> list[float]:
    """Values, the last one as often as it takes."""
    return [*values.tolist(), *[float(values[-1])] * (length - len(values))]


def waves(name: str, given: Sequence[paper.Wave]) -> dict[str, float]:
    """Arrays of amplitude, omega and phase."""
    parts = zip(("amplitude", "omega", "phase"), zip(*given, strict=True), strict=True)
    return {k: x for part, values in parts for k, x in indexed(f"{name}.{part}", values).items()}


def attributes(group: str, part: Any, **names: str) -> dict[str, float]:
    """Attributes of a part of the reference model by FMI name."""
    return {f"{group}.{name}": getattr(part, attribute) for attribute, name in names.items()}


_ELECTRICAL = {
    "solver.internal_step": 1e-5,
    "inverter.delay": 1e-3,
    **attributes("inverter", DRIVE.dead_time, seconds="dead_time", frequency="f_PWM", i_0="i_0"),
}
_WINDING = attributes(
    "motor",
    DRIVE.winding,
    i_N="i_N",
    permitted_rise="permitted_rise",
    time_constant="tau_th",
    alpha_R="alpha_R",
)
_MOTOR = {
    **attributes("motor.cogging", DRIVE.cogging, amplitude="amplitude", periods="periods"),
    **attributes("sensor", DRIVE.encoder, eccentricity="eccentricity"),
    **attributes("screw", DRIVE.encoder, lead_error="lead_error", wobble="wobble"),
}
_PLANT = {
    **_ELECTRICAL,
    **attributes("friction", DRIVE.friction, F_C="F_C", F_S="F_S", v_S="v_S"),
    "friction.v_0": DRIVE.v_0,
    **attributes("screw", DRIVE.end_stops, low="q_LB", high="q_UB"),
    **attributes("stop", DRIVE.end_stops, k="stiffness", c="damping"),
    **_WINDING,
    **_MOTOR,
    "gearbox.directional": True,
    "gearbox.eta_back": DRIVE.eta_back,
}
_COMPLIANT_PLANT = {
    **_PLANT,
    "load.m": TRANSMISSION.m,
    **attributes("transmission", TRANSMISSION, k="stiffness", c="damping", b="backlash"),
    "start.deflection": DEFLECTION,
}
_LEVER = {
    **indexed("load.table.position", filled(LEVER[0], 32)),
    **indexed("load.table.force", filled(LEVER[1], 32)),
    "load.table.interpolation": 2,
    "brake.torque": BRAKE.limit,
    "brake.frequency": BRAKE.frequency,
    "brake.damping_ratio": BRAKE.zeta,
}
START_VALUES: dict[str, dict[str, Any]] = {
    "EmlaPlant": _PLANT,
    "EmlaCompliantPlant": _COMPLIANT_PLANT,
    "EmlaAxis": _PLANT | _LEVER,
    "EmlaCompliantAxis": _COMPLIANT_PLANT | _LEVER,
    "EmlaMotor": {**_ELECTRICAL, **_WINDING, **_MOTOR},
    "EmlaObserver": {},
    "LoadObserver": {
        **attributes("model", LOAD, k="stiffness", m="m_load", c="damping", b="backlash"),
        **dict(zip(("l_1", "l_2", "l_3"), LOAD_OBSERVER.gains, strict=True)),
    },
    "ScrewCommand": {
        **attributes("model", LOAD, k="stiffness", m="m_load", b="backlash"),
        **dict(zip(("approach.duration", "approach.a_max"), COMMAND.approach, strict=True)),
        "limit.v_max": COMMAND.v_max,
        **indexed("notch.frequency", [f for f, _ in COMMAND.notches]),
        **indexed("notch.damping_ratio", [zeta for _, zeta in COMMAND.notches]),
        **{f"feedback.k_{i}": k for i, k in enumerate(COMMAND.gains)},
        "feedback.limit": COMMAND.limit,
    },
    "Reference": {
        **indexed("waypoint", MOTION.waypoints),
        **indexed("move.start", MOTION.starts),
        **indexed("move.duration", MOTION.durations),
        "period": MOTION.period,
    },
    "Disturbance": {
        **indexed("load.level", SURROUNDINGS.levels),
        **indexed("load.start", SURROUNDINGS.level_starts, first=2),
        "load.ramp": SURROUNDINGS.ramp,
        "load.ripple": 2.0 * SURROUNDINGS.ripple[0],  # the width is twice the amplitude
        "load.ripple_omega": SURROUNDINGS.ripple[1],
        **waves("d_2", SURROUNDINGS.sines_2),
        "d_2.arctan": SURROUNDINGS.arctan_2,
        "d_2.decay": SURROUNDINGS.decay_2,
        **waves("d_3", SURROUNDINGS.cosines_3),
        "d_4.amplitude": SURROUNDINGS.cosine_4[0],
        "d_4.omega": SURROUNDINGS.cosine_4[1],
        "d_4.phase": SURROUNDINGS.cosine_4[2],
        **dict(zip(("supply.depth", "supply.start", "supply.duration"), SURROUNDINGS.sag, strict=True)),
    },
    "RsbaController": {"compensate": True, "omega_u": OMEGA_U},
    "FocController": {"omega_d": 500.0},
    "CacController": indexed("omega_n", (500.0, 1000.0)),  # the defaults are too fast for RK4 to be exact
    "AnatcController": {},
    "HoldingBrake": {
        **indexed("phase.start", [start for start, _ in PHASES]),
        **indexed("phase.end", [end for _, end in PHASES]),
        "engage.delay": ENGAGE,
        "release.delay": RELEASE,
    },
    "SharedSupply": {
        "solver.internal_step": 1e-5,
        **indexed("joint.u_max", [*U_MAX, *[445.0] * 5]),
        **{f"link.{name}": LINK[name] for name in ("C", "u_start")},
        **{f"source.{name}": LINK[name] for name in ("u_0", "R")},
        **{
            f"chopper.{name}": LINK[key]
            for name, key in (("u_on", "u_on"), ("band", "band"), ("R", "R_chopper"))
        },
    },
    "SignalFault": {"freeze": True, "start": FREEZE[0], "duration": FREEZE[1]},
    "HdrmManipulator": {},
    "HdrmPlant": {
        **indexed("coupling.J_c", (1.2e-3, 1.5e-3, 1e-4)),
        **indexed("gearbox.J_GB", (0.8e-3, 1e-3, 1.5e-4)),
        **indexed("gearbox.eta_GB", MERGED.eta_GB),
        **indexed("screw.B_BS", MERGED.B_BS),
        **indexed("screw.C_eq", MERGED.C_eq),
        **indexed("uncertainty.F_2", MERGED.F_2),
        **indexed("start.x_L", START[0]),
        **indexed("start.v_L", START[1]),
    },
    "Trajectory": {
        "degree": CURVE.k,
        **indexed("knot", filled(CURVE.t, 54)),
        **indexed("coefficient.lift", filled(CURVE.c[:, 0], 48)),
        **indexed("coefficient.tilt", filled(CURVE.c[:, 1], 48)),
        **indexed("coefficient.telescope", filled(CURVE.c[:, 2], 48)),
    },
}
"""Start values that differ from the FMU's, by model and FMI name."""


RELATIVE = {
    # Of the range of every output: RK4 with the internal step of the start values against reference
    # solutions that are exact to 1e-11. Machines differ in their last digits, so these are not closer.
    "EmlaPlant": 2e-7,  # 1e-5 s; phase currents turn with up to 2000 rad/s: 8e-8
    "EmlaCompliantPlant": 1e-6,  # contacts begin and end within an internal step
    "EmlaAxis": 2e-7,
    "EmlaCompliantAxis": 1e-6,
    "EmlaMotor": 2e-7,
    "EmlaObserver": 2e-10,  # eta_hat falls with 200 rad/s: 3e-11
    "LoadObserver": 1e-8,  # f_hat and a_hat contain positions times 1e4 1/s2: 2e-9
    "ScrewCommand": 1e-8,  # so does a_s: 1e-9
    "RsbaController": 1e-8,  # P_3 loses eight of 16 digits; 2e-9 in hosts that sum up time
    # limits that act and end within an internal step
    "FocController": 1e-5,
    "CacController": 1e-4,
    "AnatcController": 1e-9,
    # closed forms: rounding, and that time is summed up step by step
    "Reference": 1e-12,
    "Disturbance": 1e-12,
    "HoldingBrake": 1e-12,
    "SharedSupply": 2e-5,  # the chopper begins and ends within an internal step
    "SignalFault": 1e-12,
    "HdrmManipulator": 1e-12,
    "HdrmPlant": 1e-11,  # 1e-3 s, where nothing is fast: 2e-13
    "Trajectory": 1e-12,
}
"""Tolerances of comparisons, by model: relative to the range of an output, and without any in time."""

MADE_BY = "python -m fmus.make_references: the paper's equations written independently, solved to 1e-12"


def about(model: str) -> str:
    """The TOML file of a model's reference."""
    values = "".join(f'"{name}" = {json.dumps(value)}\n' for name, value in START_VALUES[model].items())
    start = f"\n[set]\n{values}" if values else ""
    tolerance = f'"*" = {{ relative = {RELATIVE[model]!r}, time = 0.0 }}'
    return f'made_by = "{MADE_BY}"\n{start}\n[tolerance]\n{tolerance}\n'


def csv(step: float, rows: Sequence[Row]) -> str:
    """Rows as text, numbers with the digits that bring back the same double."""
    names = list(rows[0])
    lines = [[round(k * step, 9), *(row[name] + 0.0 for name in names)] for k, row in enumerate(rows)]
    return "\n".join([",".join(["time", *names]), *(",".join(map(repr, line)) for line in lines)]) + "\n"


def files(model: str) -> dict[str, str]:
    """All files of a model: their text by name."""
    solution = SOLUTIONS[model]()
    options = {
        "StartTime": 0.0,
        "StopTime": round((len(solution.outputs) - 1) * solution.step, 9),
        "StepSize": solution.step,
        "RelTol": TOLERANCE,
        "OutputIntervalLength": solution.step,
    }
    text = {
        f"{model}_ref.csv": csv(solution.step, solution.outputs),
        f"{model}_ref.opt": "".join(f"{name}, {value!r}\n" for name, value in options.items()),
        f"{model}_ref.toml": about(model),
    }
    if solution.inputs:
        text[f"{model}_in.csv"] = csv(solution.step, solution.inputs)
    return text | experiments(model, solution.step, options["StopTime"], bool(solution.inputs))


SMOKE_STEPS = 10
"""Steps of a smoke test."""


def experiments(model: str, step: float, stop: float, has_inputs: bool) -> dict[str, str]:
    """The parameter set and the experiments by file name."""
    text, named = dict[str, str](), {"Parameters": f"{model}_ref.ssv", "Stimuli": f"{model}_in.csv"}
    if values := START_VALUES[model]:
        types = {bool: "Boolean", int: "Integer", float: "Real"}
        parameters = tuple(SsvParameter(n, types[type(v)], v) for n, v in values.items())
        text[named["Parameters"]] = format_parameter_set(
            ParameterSet(f"{model} reference", parameters)
        ).decode()
    used = {"Parameters": bool(values), "Stimuli": has_inputs}
    given = {element: file for element, file in named.items() if used[element]}
    ends = {"validation": stop, "smoke_test": min(stop, SMOKE_STEPS * step)}
    for name, end in ends.items():
        files = given | ({"References": f"{model}_ref.csv"} if name == "validation" else {})
        root = Element("Experiments", name=model)
        times = {"startTime": "0.0", "stopTime": repr(end), "stepSize": repr(step)}
        inside = SubElement(root, "Experiment", name=name.replace("_", " "), **times)
        for element, file in files.items():
            SubElement(inside, element, source=file)
        text[f"{model}_{name}.exp"] = format_xml(root).decode()
    return text


def main() -> None:
    """Write everything."""
    for model in SOLUTIONS:
        for name, text in files(model).items():
            (FMUS / model / name).write_text(text, encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
