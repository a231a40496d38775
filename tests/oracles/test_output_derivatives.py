"""Time derivatives of outputs: fmi2GetRealOutputDerivatives of native FMUs."""

import math

import numpy as np
import pytest
from fmpy.fmi2 import FMU2Slave

from tests.support.blocks import FACTS, OWN
from tests.support.sessions import Session, refused


def slopes(session: Session, slave: FMU2Slave, *names: str) -> list[float]:
    return slave.getRealOutputDerivatives(session.references(names), [1] * len(names))


def move(session: Session, slave: FMU2Slave, **derivatives: tuple[float, ...]) -> None:
    """Set derivatives of inputs, from the first order on."""
    for name, values in derivatives.items():
        orders = range(1, len(values) + 1)
        slave.setRealInputDerivatives(session.references([name]) * len(values), orders, values)


# ---- against differences -----------------------------------------------------------------------


@pytest.mark.parametrize("model", OWN)
def test_output_derivatives_match_differences(sessions: dict[str, Session], model: str) -> None:
    """While the inputs move: central differences of sixth order over steps from one saved state."""
    session, facts, h = sessions[model], FACTS[model], 1e-4
    names = session.names("output")
    step = {"solver.internal_step": 1e-5} if session.states else {}
    slave = session.instance(**facts.smooth, **step)
    slave.doStep(0.0, 0.3)
    for name, size in facts.inputs.items():
        if name not in facts.sampled:
            move(session, slave, **{name: (size, -2.0 * size, 3.0 * size)})
    saved = slave.getFMUstate()
    at = {}
    for k in (-3, -2, -1, 1, 2, 3, 0):
        slave.setFMUstate(saved)
        slave.doStep(0.3, (10 + k) * h)
        at[k] = np.array(session.get(slave, *names))
    actual = np.array(slopes(session, slave, *names))
    slave.freeFMUstate(saved)
    expected = (45.0 * (at[1] - at[-1]) - 9.0 * (at[2] - at[-2]) + (at[3] - at[-3])) / (60.0 * h)
    error = np.abs(actual - expected) / (np.abs(expected) + 1e-4 * np.abs(at[0]) + 1e-9)
    assert dict(zip(names, error, strict=True)) == {n: pytest.approx(0.0, abs=1e-8) for n in names}


# ---- against closed forms ----------------------------------------------------------------------


def test_output_derivatives_of_the_toy_follow_the_product_rule(toy: Session) -> None:
    """The noise in its power holds between steps."""
    slave = toy.instance()
    move(toy, slave, force=(4.0, -16.0, 96.0))
    slave.doStep(0.0, 0.5)
    force, x, v, a = toy.get(slave, "force", "x", "v[1]", "der(v[1])")
    force_rate = 4.0 - 16.0 * 0.5 + 96.0 * 0.5**2 / 2.0
    assert slopes(toy, slave, "power", "inverse") == pytest.approx(
        [force_rate * v + force * a, v / (1.0 - x) ** 2], rel=1e-14
    )


def test_output_derivatives_of_the_reference_are_its_next_outputs(sessions: dict[str, Session]) -> None:
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


# ---- when --------------------------------------------------------------------------------------

TOY = ("x", "v[1]", "v[2]", "power", "inverse")


def test_output_derivatives_stay_between_communication_points(toy: Session) -> None:
    """And the der(x), whatever happens to inputs: set, moved, a discarded step, the end."""
    slave = toy.instance()
    move(toy, slave, force=(4.0, 8.0))
    slave.doStep(0.0, 0.5)
    names = ("der(x)", "der(v[1])", "der(v[2])", "power")
    rates, before = toy.get(slave, *names), slopes(toy, slave, *TOY)

    def refuse_step() -> None:
        toy.set(slave, force=math.inf)
        with refused(2):
            slave.doStep(0.5, 0.1)

    for change in (
        lambda: toy.set(slave, force=-77.0),
        lambda: move(toy, slave, force=(55.0, 6.0)),
        refuse_step,
        slave.terminate,
    ):
        change()
        assert slopes(toy, slave, *TOY) == before
        assert toy.get(slave, *names) == rates


def test_reading_output_derivatives_changes_nothing(toy: Session) -> None:
    reading, silent = toy.instance("asked"), toy.instance("other")
    for k in range(3):
        for slave in (reading, silent):
            toy.set(slave, force=float(k))
            slave.doStep(0.1 * k, 0.1)
        slopes(toy, reading, *TOY)
        toy.get(reading, "der(x)")
        toy.set(reading, force=99.0)
        slopes(toy, reading, *TOY)
    assert toy.get(reading, *TOY, "random") == toy.get(silent, *TOY, "random")


def test_output_derivatives_before_the_first_step(toy: Session) -> None:
    """With the derivatives that inputs have had since before."""
    slave = toy.instance(running=False, x_0=0.5)
    move(toy, slave, force=(4.0, 8.0))
    slave.exitInitializationMode()
    power = 4.0 * 0.5 + 0.5 * (0.5 - 3.0 * 0.5 - 0.1 * 0.5) / 2.0
    assert slopes(toy, slave, "inverse", "power") == pytest.approx([2.0, power], rel=1e-15)


def test_saved_state_contains_output_derivatives(toy: Session) -> None:
    """Also of inputs that moved, to which something else was done since."""
    slave, second = toy.instance("slave"), toy.instance("other")
    move(toy, slave, force=(4.0, 8.0))
    slave.doStep(0.0, 0.5)
    before = slopes(toy, slave, *TOY)
    toy.set(slave, force=-77.0)
    saved = slave.getFMUstate()
    slave.doStep(0.5, 0.5)
    assert slopes(toy, slave, *TOY) != before
    copy = second.deSerializeFMUstate(slave.serializeFMUstate(saved))
    slave.setFMUstate(saved)
    second.setFMUstate(copy)
    assert slopes(toy, slave, *TOY) == slopes(toy, second, *TOY) == before
    slave.freeFMUstate(saved)
    second.freeFMUstate(copy)


@pytest.mark.parametrize(
    ("name", "order", "complaint"),
    [
        *(("power", k, f"power: the order {k} of the derivative is not 1.") for k in (0, 2, -1)),
        ("force", 1, "force is not an output, state or derivative to differentiate."),
        ("body.mass", 1, "body.mass is not an output, state or derivative to differentiate."),
        ("random", 1, "random is not an output, state or derivative to differentiate."),
        ("der(x)", 1, "der(x) is not an output."),
        ("count", 1, "count is of type Integer."),
    ],
)
def test_other_variables_and_orders_are_refused(toy: Session, name: str, order: int, complaint: str) -> None:
    slave = toy.instance()
    with refused():
        slave.getRealOutputDerivatives(toy.references(["x", name]), [1, order])
    assert toy.log.lines("toy") == [f"toy: {complaint}"]


def test_output_derivatives_are_refused_in_initialization(toy: Session) -> None:
    slave = toy.instance(running=False)
    with refused():
        slopes(toy, slave, "x")
    assert toy.log.lines("toy") == ["toy: cannot get output derivatives in phase initialization."]
