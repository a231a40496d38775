"""Slaves with a step multiple sample like a drive: against difference equations written down by hand."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from emla_cosim.master.algorithms.explicit import Explicit
from emla_cosim.master.algorithms.gauss_seidel import GaussSeidel
from emla_cosim.master.algorithms.jacobi import Jacobi
from emla_cosim.master.network import Link, Network
from emla_cosim.master.stepping.timing import timing
from tests.support.linear import LinearSlave
from tests.support.simulated import simulated
from tests.support.slaves import FakeSlave, compilable

A, B = np.array([[0.0, 1.0], [-4.0, -0.3]]), np.array([[0.0], [2.0]])
START = np.array([0.3, 0.0])
KP, KD, KI = 8.0, 1.5, 6.0
STEP, MULTIPLE, STEPS = 1e-3, 10, 127


def loop() -> Network:
    """A mass on a spring, and a PID controller whose integral is a backward sum."""

    def integrated(u: np.ndarray, x: np.ndarray, time: float, step: float) -> Any:
        return x + step * u[:1]

    def force(u: np.ndarray, x: np.ndarray) -> list[float]:
        return [-KP * u[0] - KD * u[1] - KI * x[0]]

    plant = LinearSlave("plant", A, B, np.eye(2), np.zeros((2, 1)), START)
    controller = FakeSlave("controller", 2, [0.0], integrated, force)
    links = [Link(0, i, 1, i, True) for i in range(2)] + [Link(1, 0, 0, 0, False)]
    return Network([compilable(plant), compilable(controller)], links)


def by_hand(late: int) -> np.ndarray:
    """Position, speed and force at all points; a sample is older by `late` short steps."""
    joint = np.zeros((3, 3))
    joint[:2, :2], joint[:2, 2:] = A, B
    response = expm(joint * STEP)[:2]
    states, integral = [START], 0.0
    force = -KP * START[0] - KD * START[1]
    rows = [[*START, force]]
    for k in range(1, STEPS + 1):
        states.append(response @ [*states[-1], force])
        if k % MULTIPLE == 0:
            position, speed = states[k - late]
            integral += MULTIPLE * STEP * position
            force = -KP * position - KD * speed - KI * integral
        rows.append([*states[-1], force])
    return np.array(rows)


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize(("kind", "late"), [(GaussSeidel, 0), (Jacobi, 1)])
def test_a_sampled_controller_has_no_delay_of_its_own(
    kind: type[Explicit], late: int, compiled: bool
) -> None:
    """At the stop time the controller has been waiting for seven steps."""
    algorithm = kind(step_multiples={"controller": MULTIPLE})
    rows = simulated(loop(), algorithm, timing(STEPS * STEP, STEP), compiled=compiled)
    expected = by_hand(late)
    assert np.abs(rows[:, 1:] - expected).max() < 1e-12 * np.abs(expected).max()
    assert np.abs(by_hand(0) - by_hand(1)).max() > 1e-3  # so that the two can be told apart


def test_a_slow_slave_that_is_first_in_the_order_sees_what_was_a_short_step_ago() -> None:
    algorithm = GaussSeidel(step_multiples={"controller": MULTIPLE}, order=["controller", "plant"])
    rows = simulated(loop(), algorithm, timing(STEPS * STEP, STEP))[:, 1:]
    # the force of a sample drives the plant in the same pass already
    shown = np.abs(np.diff(rows[:, 2])) > 0.0
    assert (np.flatnonzero(shown) + 1).tolist() == list(range(MULTIPLE, STEPS + 1, MULTIPLE))
    k = MULTIPLE
    position, speed = rows[k - 1, :2]
    assert rows[k, 2] == pytest.approx(-(KP + KI * MULTIPLE * STEP) * position - KD * speed, rel=1e-12)


@pytest.mark.parametrize("compiled", [False, True])
def test_long_steps_begin_and_end_at_communication_points(compiled: bool) -> None:
    taken: list[tuple[float, float]] = []

    def noted(u: np.ndarray, x: np.ndarray, time: float, step: float) -> Any:
        taken.append((time, time + step))
        return x

    slave = compilable(FakeSlave("slow", 0, [0.0], noted))
    simulated(Network([slave], []), Jacobi(step_multiples={"slow": 3}), timing(1.1, 0.1), compiled=compiled)
    assert taken == [(0.0, 0.3), (0.3, 0.6), (0.6, 0.9)]


# ---- inputs that follow lines ------------------------------------------------------------------

SIGNAL = [0.0, 3.0, 1.0, 5.0, 5.0, 4.0, 9.0, 0.5, 0.25, 8.0, 7.0, 7.5, 1.0]
"""Of the source at its points; nothing about it is smooth."""


def jumping(extrapolation: str, kind: type[Explicit], compiled: bool) -> Sequence[float]:
    """The integral of the signal, by a slave that does three steps of 0.5 s at once."""
    source = FakeSlave("source", 0, SIGNAL[:1], lambda u, x, t, h: [SIGNAL[round((t + h) / 0.5)]])
    integral = LinearSlave("integral", [[0.0]], [[1.0]], [[1.0]], [[0.0]], [0.0])
    network = Network([compilable(source), compilable(integral)], [Link(0, 0, 1, 0, False)])
    algorithm = kind(extrapolation, {"integral": 3})
    rows = simulated(network, algorithm, timing(0.5 * (len(SIGNAL) - 1), 0.5), compiled=compiled)
    return rows[::3, 2].tolist()


@pytest.mark.parametrize("compiled", [False, True])
@pytest.mark.parametrize("extrapolation", ["master", "fmu"])
def test_the_line_of_an_input_goes_over_all_of_a_long_step(extrapolation: str, compiled: bool) -> None:
    """From what was taken last to what is there now, whatever the source did in between."""
    samples = np.array(SIGNAL[::3])
    expected = [0.0, *np.cumsum(1.5 * 0.5 * (samples[1:] + samples[:-1]))]
    assert jumping(extrapolation, GaussSeidel, compiled) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("compiled", [False, True])
def test_a_late_line_is_prolonged_by_a_short_step(compiled: bool) -> None:
    """`jacobi`: from the sample of a short step ago, along the chord over the three steps before it."""
    newest = np.array(SIGNAL[2::3])
    before = np.array([SIGNAL[0], *newest[:-1]])
    apart = np.array([1.0, *[1.5] * (len(newest) - 1)])
    middle = newest + (0.5 - 0.75) * (newest - before) / apart
    expected = [0.0, *np.cumsum(1.5 * middle)]
    assert jumping("fmu", Jacobi, compiled) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("compiled", [False, True])
def test_held_inputs_are_those_at_the_end_of_a_long_step(compiled: bool) -> None:
    expected = [0.0, *np.cumsum(1.5 * np.array(SIGNAL[3::3]))]
    assert jumping("none", GaussSeidel, compiled) == pytest.approx(expected, abs=1e-12)
