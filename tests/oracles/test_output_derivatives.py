"""Time derivatives of outputs: fmi2GetRealOutputDerivatives of native FMUs."""

import math
from typing import Any

import numpy as np
import pytest
from fmpy.fmi2 import FMU2Slave

from emla_cosim.fmu.models import MODELS
from tests.support.sessions import Session, refused


def slopes(session: Session, slave: FMU2Slave, *names: str) -> list[float]:
    return slave.getRealOutputDerivatives(session.references(names), [1] * len(names))


def move(session: Session, slave: FMU2Slave, **derivatives: tuple[float, ...]) -> None:
    """Set derivatives of inputs, from the first order on."""
    for name, values in derivatives.items():
        orders = range(1, len(values) + 1)
        slave.setRealInputDerivatives(session.references([name]) * len(values), orders, values)


# ---- against differences -----------------------------------------------------------------------

MOVING: dict[str, tuple[dict[str, Any], dict[str, tuple[float, ...]]]] = {
    "EmlaPlant": (
        {
            "u_q": 30.0,
            "u_d": -5.0,
            "F_L": 1e3,
            "v_L": 0.02,
            "i_q": 5.0,
            "i_d": 1.0,
            "motor.L_q": 3e-3,
            "start.x_L": 0.01,
            "motor.i_N": 30.0,
        },
        {"u_q": (200.0, -1e3), "u_d": (-40.0,), "F_L": (1e3, 1e4, 1e5), "d_2": (2.0,), "d_3": (1.0, 2.0)},
    ),
    "EmlaCompliantPlant": (
        {
            "u_q": 30.0,
            "F_L": 1e3,
            "v_L": 0.02,
            "i_q": 5.0,
            "i_d": 1.0,
            "start.x_L": 0.01,
            "load.v": 0.01,
            "transmission.stiffness": 1e6,
            "transmission.damping": 1e3,
            "start.deflection": 1e-3,
            "motor.i_N": 30.0,
        },
        {"u_q": (200.0, -1e3), "u_d": (-40.0,), "F_L": (1e3, 1e4, 1e5), "d_2": (2.0,), "d_3": (1.0, 2.0)},
    ),
    "EmlaMotor": (
        {"u_q": 30.0, "u_d": -5.0, "i_q": 5.0, "i_d": 1.0, "motor.L_q": 3e-3, "x_L": 0.01, "v_L": 0.02},
        {"u_q": (200.0, -1e3), "u_d": (-40.0,), "x_L": (0.02, 0.3), "v_L": (0.3, 2.0), "d_3": (1.0, 2.0)},
    ),
    "EmlaObserver": (
        {"y": 0.25, "i_q_ref": 10.0, "v_hat": 0.01},
        {"y": (0.03, 0.2, 1.0), "i_q_ref": (100.0,)},
    ),
    "RsbaController": (
        {
            "x_hat": 0.25,
            "x_d": 0.24,
            "v_hat": 0.01,
            "i_q": 5.0,
            "i_d": 1.0,
            "limit_acceleration": True,
            "feed_acceleration": True,
        }
        | {f"beta[{i}]": 50.0 for i in range(1, 5)}
        | {f"delta[{i}]": 1.0 for i in range(1, 5)},
        {"x_hat": (0.05, 0.3), "v_hat": (0.3,), "x_d": (0.01, 0.3, 2.0), "v_d": (0.3, 2.0), "i_q": (9.0,)},
    ),
    "FocController": (
        {
            "x_hat": 0.25,
            "x_d": 0.2501,
            "v_hat": 0.01,
            "d_hat": 0.2,
            "i_q": 5.0,
            "i_d": 1.0,
            "u_available": 400.0,
            "a_d": 0.1,
            "omega_d": 50.0,
            "w_c": 100.0,
            "w_i": 20.0,
        },
        {
            "x_hat": (0.01,),
            "v_hat": (0.3,),
            "x_d": (0.01, 0.03),
            "v_d": (0.03,),
            "i_q": (9.0,),
            "d_hat": (2.0,),
        },
    ),
    "CacController": (
        {
            "x_hat": 0.25,
            "x_d": 0.2501,
            "v_hat": 0.01,
            "d_hat": 0.2,
            "i_q": 5.0,
            "i_d": 1.0,
            "u_available": 400.0,
            "a_d": 0.1,
            "omega_n[1]": 50.0,
            "omega_n[2]": 80.0,
            "k[1]": 20.0,
            "k[2]": 30.0,
        },
        {
            "x_hat": (0.01,),
            "v_hat": (0.03,),
            "x_d": (0.01, 0.03),
            "v_d": (0.03,),
            "i_q": (9.0,),
            "d_hat": (2.0,),
        },
    ),
    "AnatcController": (
        {
            "x_hat": 0.25,
            "x_d": 0.2501,
            "v_hat": 0.01,
            "d_hat": 0.2,
            "i_q": 5.0,
            "i_d": 1.0,
            "u_available": 400.0,
            "a_d": 0.1,
            "k_1": 20.0,
            "g": 10.0,
        },
        {
            "x_hat": (0.01,),
            "v_hat": (0.03,),
            "x_d": (0.01, 0.03),
            "v_d": (0.03,),
            "i_q": (9.0,),
            "d_hat": (2.0,),
        },
    ),
    "Disturbance": (
        {
            "v_L": 0.1,
            "d_2.arctan": 3.0,
            "d_2.decay": 2.0,
            "d_2.amplitude[1]": 0.5,
            "d_2.omega[1]": 7.0,
            "d_3.amplitude[2]": 1.5,
            "d_3.omega[2]": 9.0,
            "d_4.amplitude": 2.5,
            "d_4.omega": 5.0,
            "d_4.phase": 0.5,
            "load.level[2]": 100.0,
            "load.start[2]": 0.1,
            "load.ripple": 7.0,
        },
        {"v_L": (0.4, 3.0, 2.0)},
    ),
    "Reference": ({"waypoint[2]": 0.3, "move.start[1]": 0.05}, {}),
    "Trajectory": (
        {f"knot[{i}]": 1.0 for i in range(7, 55)}
        | {"coefficient.lift[2]": 0.1, "coefficient.telescope[4]": 0.9},
        {},
    ),
    "HdrmManipulator": (
        {
            "x_L[1]": 0.2,
            "x_L[2]": 0.3,
            "x_L[3]": 0.4,
            "v_L[1]": 0.1,
            "v_L[2]": -0.2,
            "v_L[3]": 0.3,
            "a_L[1]": 1.0,
            "a_L[2]": 2.0,
            "a_L[3]": -3.0,
            "payload.m": 400.0,
        },
        {
            "x_L[1]": (0.1, 1.0),
            "x_L[2]": (-0.2, 2.0),
            "x_L[3]": (0.3, -3.0),
            "v_L[1]": (1.0,),
            "v_L[3]": (-3.0, 2.0),
            "a_L[2]": (5.0,),
            "payload.m": (30.0, 40.0),
        },
    ),
    "HdrmPlant": (
        {
            "tau_m[1]": 30.0,
            "tau_m[2]": 9.0,
            "tau_m[3]": -6.0,
            "d_2[1]": 0.1,
            "start.v_L[1]": 0.02,
            "start.v_L[2]": -0.05,
            "start.v_L[3]": 0.1,
            "screw.B_BS[1]": 50.0,
            "uncertainty.F_2[1]": 0.1,
        },
        {
            "tau_m[1]": (50.0, 10.0),
            "tau_m[2]": (-40.0, 20.0, 5.0),
            "tau_m[3]": (3.0,),
            "d_2[3]": (2.0, 1.0),
            "payload.m": (30.0,),
        },
    ),
    "SignalFault": ({"u": 0.2, "gain": 2.0, "offset": 3.0, "start": 0.1}, {"u": (0.4, 3.0, 2.0)}),
}
"""Start values, and derivatives of the inputs at the beginning of the step."""


@pytest.mark.parametrize("model", MODELS)
def test_they_are_the_slopes_of_the_outputs_over_time(sessions: dict[str, Session], model: str) -> None:
    """While the inputs move: central differences of sixth order over steps from one saved state."""
    session, (values, derivatives) = sessions[model], MOVING[model]
    names, h = session.names("output"), 1e-4
    if session.states:
        values = values | {"solver.internal_step": 1e-5}
    slave = session.instance(**values)
    slave.doStep(0.0, 0.3)
    move(session, slave, **derivatives)
    saved = slave.getFMUstate()
    at = {}
    for k in (-3, -2, -1, 1, 2, 3, 0):
        slave.setFMUstate(saved)
        slave.doStep(0.3, (10 + k) * h)
        at[k] = np.array(session.get(slave, *names))
    found = np.array(slopes(session, slave, *names))
    slave.freeFMUstate(saved)
    expected = (45.0 * (at[1] - at[-1]) - 9.0 * (at[2] - at[-2]) + (at[3] - at[-3])) / (60.0 * h)
    error = np.abs(found - expected) / (np.abs(expected) + 1e-4 * np.abs(at[0]) + 1e-9)
    assert dict(zip(names, error, strict=True)) == {n: pytest.approx(0.0, abs=1e-8) for n in names}


# ---- against closed forms ----------------------------------------------------------------------


def test_of_states_they_are_the_derivatives(sessions: dict[str, Session]) -> None:
    session = sessions["EmlaPlant"]
    slave = session.instance(**MOVING["EmlaPlant"][0])
    move(session, slave, **MOVING["EmlaPlant"][1])
    slave.doStep(0.0, 0.02)
    rates = session.get(slave, *(f"der({s})" for s in session.states))
    assert slopes(session, slave, *session.states) == rates
    assert 0.0 not in rates


def test_those_of_the_toy_are_what_the_product_rule_says(toy: Session) -> None:
    """The noise in its power holds between steps."""
    slave = toy.instance()
    move(toy, slave, force=(4.0, -16.0, 96.0))
    slave.doStep(0.0, 0.5)
    force, x, v, a = toy.get(slave, "force", "x", "v[1]", "der(v[1])")
    force_rate = 4.0 - 16.0 * 0.5 + 96.0 * 0.5**2 / 2.0
    assert slopes(toy, slave, "power", "inverse") == pytest.approx(
        [force_rate * v + force * a, v / (1.0 - x) ** 2], rel=1e-14
    )


def test_of_the_reference_they_are_the_next_outputs(sessions: dict[str, Session]) -> None:
    """Position, speed, acceleration: in moves, dwells and a later period."""
    session = sessions["Reference"]
    values = {"waypoint[2]": 0.3, "waypoint[3]": -0.2, "move.start[1]": 0.2, "move.start[2]": 1.5}
    slave = session.instance(**values, period=3.1)
    steps = [*np.random.default_rng(5).uniform(0.01, 0.2, size=60), 0.0625]
    time, moving = 0.0, 0
    for step in steps:
        slave.doStep(time, step)
        time += step
        v_d, a_d = session.get(slave, "v_d", "a_d")
        assert slopes(session, slave, "x_d", "v_d") == pytest.approx([v_d, a_d], rel=1e-10, abs=1e-12)
        moving += a_d != 0.0
    assert time > 3.1
    assert 20 < moving < len(steps)


def test_of_the_disturbance_they_are_those_of_its_formulas(sessions: dict[str, Session]) -> None:
    """While a load ramp is on and the speed moves."""
    session = sessions["Disturbance"]
    slave = session.instance(**MOVING["Disturbance"][0])
    move(session, slave, v_L=(0.4, 3.0))
    slave.doStep(0.0, 0.3)
    v, rate = 0.1 + 0.4 * 0.3 + 3.0 * 0.3**2 / 2.0, 0.4 + 3.0 * 0.3
    decaying = 3.0 * math.exp(-0.6) * (rate / (1.0 + v * v) - 2.0 * math.atan(v))
    expected = {
        "F_L": 100.0 / 0.5 + 0.5 * 7.0 * 2.0 * math.pi * math.cos(2.0 * math.pi * 0.3),
        "d_2": decaying + 0.5 * 7.0 * math.cos(7.0 * 0.3),
        "d_3": -1.5 * 9.0 * math.sin(9.0 * 0.3),
        "d_4": -2.5 * 5.0 * math.sin(5.0 * 0.3 + 0.5),
    }
    assert slopes(session, slave, *expected) == pytest.approx(list(expected.values()), rel=1e-12)


# ---- when --------------------------------------------------------------------------------------

TOY = ("x", "v[1]", "v[2]", "power", "inverse")


def test_a_later_change_of_inputs_does_not_change_them(toy: Session) -> None:
    """Nor the der(x); outputs are those of the last communication point."""
    slave = toy.instance()
    move(toy, slave, force=(4.0, 8.0))
    slave.doStep(0.0, 0.5)
    rates = toy.get(slave, "der(x)", "der(v[1])", "der(v[2])")
    before = slopes(toy, slave, *TOY)
    toy.set(slave, force=-77.0)
    assert slopes(toy, slave, *TOY) == before
    move(toy, slave, force=(55.0, 6.0))
    assert slopes(toy, slave, *TOY) == before
    assert toy.get(slave, "der(x)", "der(v[1])", "der(v[2])") == rates
    assert toy.get(slave, "force") == [-77.0]


def test_a_discarded_step_does_not_change_them(toy: Session) -> None:
    slave = toy.instance()
    move(toy, slave, force=(4.0,))
    slave.doStep(0.0, 0.5)
    before = slopes(toy, slave, *TOY)
    toy.set(slave, force=math.inf)
    with refused(2):
        slave.doStep(0.5, 0.1)
    assert slopes(toy, slave, *TOY) == before


def test_asking_for_them_changes_nothing(toy: Session) -> None:
    asked, other = toy.instance("asked"), toy.instance("other")
    for k in range(3):
        for slave in (asked, other):
            toy.set(slave, force=float(k))
            slave.doStep(0.1 * k, 0.1)
        slopes(toy, asked, *TOY)
        toy.get(asked, "der(x)")
        toy.set(asked, force=99.0)
        slopes(toy, asked, *TOY)
    assert toy.get(asked, *TOY, "random") == toy.get(other, *TOY, "random")


def test_before_the_first_step_they_are_those_of_the_start(toy: Session) -> None:
    """With the derivatives that inputs have had since before."""
    slave = toy.instance(running=False, x_0=0.5)
    move(toy, slave, force=(4.0, 8.0))
    slave.exitInitializationMode()
    power = 4.0 * 0.5 + 0.5 * (0.5 - 3.0 * 0.5 - 0.1 * 0.5) / 2.0
    assert slopes(toy, slave, "inverse", "power") == pytest.approx([2.0, power], rel=1e-15)


def test_after_termination_they_are_what_they_were(toy: Session) -> None:
    """Whatever was set since the last step."""
    slave = toy.instance()
    slave.doStep(0.0, 0.1)
    before, rates = slopes(toy, slave, *TOY), toy.get(slave, "der(v[1])", "power")
    toy.set(slave, force=-77.0)
    slave.terminate()
    assert slopes(toy, slave, *TOY) == before
    assert toy.get(slave, "der(v[1])", "power") == rates


def test_a_saved_state_carries_them(toy: Session) -> None:
    """Also of inputs that moved, to which something else was done since."""
    slave, other = toy.instance("slave"), toy.instance("other")
    move(toy, slave, force=(4.0, 8.0))
    slave.doStep(0.0, 0.5)
    before = slopes(toy, slave, *TOY)
    toy.set(slave, force=-77.0)
    saved = slave.getFMUstate()
    slave.doStep(0.5, 0.5)
    assert slopes(toy, slave, *TOY) != before
    copy = other.deSerializeFMUstate(slave.serializeFMUstate(saved))
    slave.setFMUstate(saved)
    other.setFMUstate(copy)
    assert slopes(toy, slave, *TOY) == slopes(toy, other, *TOY) == before
    slave.freeFMUstate(saved)
    other.freeFMUstate(copy)


@pytest.mark.parametrize("order", [0, 2, -1])
def test_other_orders_than_the_first_are_refused(toy: Session, order: int) -> None:
    slave = toy.instance()
    with refused():
        slave.getRealOutputDerivatives(toy.references(["x", "power"]), [1, order])
    assert toy.log.lines("toy") == [f"toy: power: the order {order} of the derivative is not 1."]


@pytest.mark.parametrize(
    ("name", "complaint"),
    [
        ("force", "toy: force is not an output, state or derivative to differentiate."),
        ("body.mass", "toy: body.mass is not an output, state or derivative to differentiate."),
        ("random", "toy: random is not an output, state or derivative to differentiate."),
        ("der(x)", "toy: der(x) is not an output."),
        ("count", "toy: count is of type Integer."),
    ],
)
def test_what_is_no_real_output_is_refused(toy: Session, name: str, complaint: str) -> None:
    slave = toy.instance()
    with refused():
        slopes(toy, slave, "x", name)
    assert toy.log.lines("toy") == [complaint]


def test_during_initialization_they_are_refused(toy: Session) -> None:
    slave = toy.instance(running=False)
    with refused():
        slopes(toy, slave, "x")
    assert toy.log.lines("toy") == ["toy: cannot get output derivatives in phase initialization."]
