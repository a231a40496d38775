"""Inputs that move within a step: fmi2SetRealInputDerivatives of native FMUs."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from fmpy.fmi2 import FMU2Slave
from numpy.polynomial import Polynomial
from scipy.integrate import solve_ivp

from tests.support.sessions import DISCARD, Session, refused
from tests.support.toy import Shape

STATES = ("x", "v[1]", "v[2]")
MASS, GAINS, X_0, V_0 = 2.0, (3.0, 0.25), 0.125, (0.5, -0.5)

FORCES = {1: Polynomial([0.5, 4.0]), 2: Polynomial([0.5, -4.0, 9.0]), 3: Polynomial([0.5, 3.0, -9.0, 5.0])}
"""Forces over time by their order."""


def move(session: Session, slave: FMU2Slave, force: Polynomial, time: float) -> None:
    """Set the derivatives that the force has at this time."""
    order = force.degree()
    slopes = [float(force.deriv(k)(time)) for k in range(1, order + 1)]
    slave.setRealInputDerivatives(session.references(["force"]) * order, range(1, order + 1), slopes)


def run(session: Session, force: Polynomial, times: Sequence[float], **values: Any) -> np.ndarray:
    """The states at the end of a run in which only the first value of the force is set."""
    slave = session.instance(force=float(force(times[0])), time=times[0], **values)
    for start, end in pairwise(times):
        move(session, slave, force, start)
        slave.doStep(start, end - start)
    return np.array(session.get(slave, *STATES))


def solution(force: Polynomial, end: float, cubic: bool) -> np.ndarray:
    """The toy's equations, written again."""

    def rates(t: float, s: np.ndarray) -> list[float]:
        x, v, w = s
        spring = GAINS[1] * x**3 if cubic else GAINS[0] * x
        return [v, (force(t) - spring - 0.1 * v) / MASS, math.cos(t) - w / 3.0]

    actual = solve_ivp(rates, (0.0, end), [X_0, *V_0], method="DOP853", rtol=1e-13, atol=1e-14)
    return actual.y[:, -1]


@pytest.mark.parametrize(("order", "shape"), [(1, Shape.LINEAR), (2, Shape.CUBIC), (3, Shape.CUBIC)])
def test_polynomial_force_gives_the_solution_with_that_force(
    session: Session, order: int, shape: Shape
) -> None:
    """Over steps of uneven length; the force follows its derivatives from step to step."""
    times = [0.0, 0.1, 0.35, 0.4, 0.7, 1.0]
    actual = run(session, FORCES[order], times, shape=shape, **{"solver.internal_step": 1e-3})
    assert actual == pytest.approx(solution(FORCES[order], 1.0, shape == Shape.CUBIC), rel=1e-11)


def test_input_keeps_its_last_value_after_a_step(session: Session) -> None:
    """The second step holds it, as that of an instance which knows no derivatives."""
    slave = session.new()
    move(session, slave, FORCES[3], 0.0)  # for the first step
    session.initialize(slave)
    slave.doStep(0.0, 0.25)
    force, x, *v = session.get(slave, "force", *STATES)
    assert force == pytest.approx(float(FORCES[3](0.25)), rel=1e-15)
    held_inputs = session.instance("held", time=0.25, force=force, x_0=x, **{"v[1]": v[0], "v[2]": v[1]})
    for each in (slave, held_inputs):
        each.doStep(0.25, 0.25)
    assert session.get(slave, "force", *STATES) == session.get(held_inputs, "force", *STATES)


def test_outputs_see_the_input_at_the_end_of_the_step(session: Session) -> None:
    slave = session.instance()
    before = session.get(slave, "force", "v[1]", "power")
    noise = before[2] - before[0] * before[1]
    slave.setRealInputDerivatives(session.references(["force"]), [1], [4.0])
    slave.doStep(0.0, 0.5)
    force, speed, power, random = session.get(slave, "force", "v[1]", "power", "random")
    assert force == 2.5
    assert noise == pytest.approx(3 * 7 / 2147483647)
    assert power == pytest.approx(2.5 * speed + 3 * random / 2147483647, rel=1e-14)


def test_last_value_of_a_derivative_counts(session: Session) -> None:
    """A value of the input that is set after the derivatives leaves them as they are; a reset does not."""
    slave, force = session.instance(), session.references(["force"])
    slave.setRealInputDerivatives(force * 2, [1, 1], [4.0, 5.0])
    slave.setRealInputDerivatives(force, [1], [6.0])
    session.set(slave, force=-1.0)
    slave.doStep(0.0, 0.5)
    assert session.get(slave, "force") == [2.0]
    slave.setRealInputDerivatives(force, [1], [4.0])
    slave.reset()
    session.initialize(slave)
    slave.doStep(0.0, 0.5)
    assert session.get(slave, "force") == [0.5]


def test_derivative_of_zero_changes_no_bit(session: Session) -> None:
    still, zero = session.instance("still"), session.instance("zero")
    for k in range(5):
        zero.setRealInputDerivatives(session.references(["force"]) * 3, [1, 2, 3], [0.0] * 3)
        for slave in (still, zero):
            slave.doStep(0.1 * k, 0.1)
    assert session.get(still, *STATES, "power") == session.get(zero, *STATES, "power")


def test_discarded_step_keeps_inputs_and_derivatives(session: Session) -> None:
    """A force that grows by 1e154 N/s has a power beyond the numbers after 10 s, but not after 0.1 s."""
    names = ("force", *STATES, "power", "random")
    rolled_back, straight = session.instance("tried"), session.instance("straight")
    for slave in (rolled_back, straight):
        slave.doStep(0.0, 0.5)
        slave.setRealInputDerivatives(session.references(["force"]) * 2, [1, 3], [math.nan, 1e153])
        before = session.get(rolled_back, *names)
        with refused(DISCARD):
            slave.doStep(0.5, 0.1)
        slave.setRealInputDerivatives(session.references(["force"]), [1], [1e154])
    for _ in range(2):
        with refused(DISCARD):
            rolled_back.doStep(0.5, 10.0)
        assert session.get(rolled_back, *names) == before
    for slave in (rolled_back, straight):
        slave.doStep(0.5, 0.1)
    assert session.get(rolled_back, *names) == session.get(straight, *names)
    assert session.get(rolled_back, "force")[0] > 1e152


@pytest.mark.parametrize(
    ("name", "order", "complaint"),
    [
        *(("force", k, f"force: the order {k} of the derivative is not 1 to 3.") for k in (0, 4, -1)),
        ("body.mass", 1, "body.mass is not an input."),
        ("count", 1, "count is of type Integer."),
    ],
)
def test_other_variables_and_orders_are_refused(
    session: Session, name: str, order: int, complaint: str
) -> None:
    """All of the call, of which nothing is set; and everything after termination."""
    slave = session.instance()
    with refused():
        slave.setRealInputDerivatives(session.references(["force", name]), [1, order], [4.0, 4.0])
    slave.doStep(0.0, 0.5)
    assert session.get(slave, "force") == [0.5]
    slave.terminate()
    with refused():
        slave.setRealInputDerivatives(session.references(["force"]), [1], [4.0])
    assert session.log.lines("toy") == [
        f"toy: {complaint}",
        "toy: cannot set input derivatives in phase terminated.",
    ]
