"""Slaves with a step multiple sample like a drive: against difference equations written down by hand."""

from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from emla_cosim.master.algorithms.algorithm import Algorithm
from emla_cosim.master.algorithms.registry import GaussSeidel, Jacobi, Strong
from emla_cosim.master.instances.fmu_instance import DiscardedStepError
from emla_cosim.master.network import Link, Network
from emla_cosim.master.stepping.timing import make_communication_points
from tests.support.linear import LinearSlave
from tests.support.simulated import simulated
from tests.support.slaves import FakeSlave

A, B = np.array([[0.0, 1.0], [-4.0, -0.3]]), np.array([[0.0], [2.0]])
START = np.array([0.3, 0.0])
KP, KD, KI = 8.0, 1.5, 6.0
STEP, MULTIPLE, STEPS = 1e-3, 10, 127


def pid(calls: list[str] | None = None) -> FakeSlave:
    """A PID controller whose integral is a backward sum; it shows its inputs at once."""

    def integrate(u: np.ndarray, x: np.ndarray, time: float, step: float) -> Any:
        return x + step * u[:1]

    return FakeSlave(
        "controller", 2, [0.0], integrate, lambda u, x: [-KP * u[0] - KD * u[1] - KI * x[0]], calls
    )


def loop() -> Network:
    """A mass on a spring, and a PID controller whose integral is a backward sum."""

    plant = LinearSlave("plant", A, B, np.eye(2), np.zeros((2, 1)), START)
    links = [Link(0, i, 1, i, True) for i in range(2)] + [Link(1, 0, 0, 0, False)]
    return Network([plant, pid()], links)


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


@pytest.mark.parametrize(("kind", "late"), [(GaussSeidel, 0), (Jacobi, 1), (Strong, 0)])
def test_sampled_controller_adds_no_delay(kind: type[Algorithm], late: int) -> None:
    """At the stop time the controller has been waiting for seven steps."""
    algorithm = kind(step_multiples={"controller": MULTIPLE})
    rows = simulated(loop(), algorithm, make_communication_points(STEPS * STEP, STEP))
    expected = by_hand(late)
    assert np.abs(rows[:, 1:] - expected).max() < 1e-12 * np.abs(expected).max()
    assert np.abs(by_hand(0) - by_hand(1)).max() > 1e-3  # so that the two differ


def test_slow_slave_that_is_first_in_the_order_is_late_by_a_short_step() -> None:
    algorithm = GaussSeidel(step_multiples={"controller": MULTIPLE}, order=["controller", "plant"])
    rows = simulated(loop(), algorithm, make_communication_points(STEPS * STEP, STEP))[:, 1:]
    # the force of a sample drives the plant in the same pass already
    has_changed = np.abs(np.diff(rows[:, 2])) > 0.0
    assert (np.flatnonzero(has_changed) + 1).tolist() == list(range(MULTIPLE, STEPS + 1, MULTIPLE))
    k = MULTIPLE
    position, speed = rows[k - 1, :2]
    assert rows[k, 2] == pytest.approx(-(KP + KI * MULTIPLE * STEP) * position - KD * speed, rel=1e-12)


def test_long_steps_begin_and_end_at_communication_points() -> None:
    spans: list[tuple[float, float]] = []

    def noted(u: np.ndarray, x: np.ndarray, time: float, step: float) -> Any:
        spans.append((time, time + step))
        return x

    slave = FakeSlave("slow", 0, [0.0], noted)
    algorithm = Jacobi(step_multiples={"slow": 3})
    simulated(Network([slave], []), algorithm, make_communication_points(1.1, 0.1))
    assert spans == [(0.0, 0.3), (0.3, 0.6), (0.6, 0.9)]


# ---- inputs that follow lines ------------------------------------------------------------------

SIGNAL = [0.0, 3.0, 1.0, 5.0, 5.0, 4.0, 9.0, 0.5, 0.25, 8.0, 7.0, 7.5, 1.0]
"""Of the source at its points; nothing about it is smooth."""


JUMPING = {"integral": 3}
"""The slave that integrates does three steps of 0.5 s at once."""


def integrated(algorithm: Algorithm) -> list[float]:
    """The integral of the signal in steps of 0.5 s."""
    source = FakeSlave("source", 0, SIGNAL[:1], lambda u, x, t, h: [SIGNAL[round((t + h) / 0.5)]])
    integral = LinearSlave("integral", [[0.0]], [[1.0]], [[1.0]], [[0.0]], [0.0])
    network = Network([source, integral], [Link(0, 0, 1, 0, False)])
    times = make_communication_points(0.5 * (len(SIGNAL) - 1), 0.5)
    return simulated(network, algorithm, times)[:, 2].tolist()


@pytest.mark.parametrize("extrapolation", ["master", "fmu"])
def test_line_of_an_input_covers_a_long_step(extrapolation: str) -> None:
    """From what was taken last to what is there now, whatever the source did in between."""
    samples = np.array(SIGNAL[::3])
    expected = [0.0, *np.cumsum(1.5 * 0.5 * (samples[1:] + samples[:-1]))]
    assert integrated(GaussSeidel(extrapolation, JUMPING))[::3] == pytest.approx(expected, abs=1e-12)


def test_late_line_is_extrapolated_by_a_short_step() -> None:
    """`jacobi`: from the sample of a short step ago, along the chord over the three steps before it."""
    newest = np.array(SIGNAL[2::3])
    before = np.array([SIGNAL[0], *newest[:-1]])
    distances = np.array([1.0, *[1.5] * (len(newest) - 1)])
    middle = newest + (0.5 - 0.75) * (newest - before) / distances
    expected = [0.0, *np.cumsum(1.5 * middle)]
    assert integrated(Jacobi("fmu", JUMPING))[::3] == pytest.approx(expected, abs=1e-12)


def test_held_inputs_are_those_at_the_end_of_a_long_step() -> None:
    expected = [0.0, *np.cumsum(1.5 * np.array(SIGNAL[3::3]))]
    assert integrated(GaussSeidel("none", JUMPING))[::3] == pytest.approx(expected, abs=1e-12)


# ---- sampled in strong coupling ----------------------------------------------------------------

LOAD = 2.5
"""kg, fixed to an actuator of 1 kg."""


def machine(controller: FakeSlave, *more: FakeSlave) -> Network:
    """A load that is fixed to an actuator; the controller reads position and speed and gives a force."""
    b, c, d = [[0.0, 0.0], [1.0, 1.0]], [[1.0, 0.0], [0.0, 1.0], A[1]], [[0.0, 0.0], [0.0, 0.0], [1.0, 1.0]]
    actuator = LinearSlave("actuator", A, b, c, d, START)
    load = LinearSlave("load", [], [], [], [[-LOAD]], [])
    slaves = [controller, actuator, load, *more]
    for slave in (actuator, load):
        slave.calls = controller.calls
    links = [
        Link(1, 2, 2, 0, True, name="a"),
        Link(2, 0, 1, 0, True, name="F"),
        Link(1, 0, 0, 0, True, name="x"),
        Link(1, 1, 0, 1, True, name="v"),
        Link(0, 0, 1, 1, True, name="u"),
    ]
    return Network(slaves, links)


def machine_by_hand(multiple: int, steps: int) -> np.ndarray:
    """Force of the controller, position and speed: the implicit step of the mechanics, in closed form."""
    joint = np.zeros((3, 3))
    joint[:2, :2], joint[:2, 2] = A, [0.0, 1.0]
    response = expm(joint * STEP)[:2]
    state, integral = START, 0.0
    force = -KP * state[0] - KD * state[1]
    rows = [[force, *state]]
    for k in range(1, steps + 1):
        # x+ = R (x, F + u) and F = -m a+, a+ = (-4, -0.3) x+ + F + u
        free = response @ [*state, force]
        row, gain = A[1], response[:, 2]
        load = -LOAD * (row @ free + force) / (1.0 + LOAD * (row @ gain + 1.0))
        state = free + gain * load
        if k % multiple == 0:
            integral += multiple * STEP * state[0]
            force = -KP * state[0] - KD * state[1] - KI * integral
        rows.append([force, *state])
    return np.array(rows)


@pytest.mark.parametrize("multiple", [1, MULTIPLE])
def test_controller_samples_the_solution_of_a_loop(multiple: int) -> None:
    """At the end of the step, once, and holds its answer; the loop has one value to agree on."""
    controller = pid([])
    algorithm = Strong(step_multiples={"controller": multiple}, coupling_tolerance=1e-13)
    rows = simulated(machine(controller), algorithm, make_communication_points(STEPS * STEP, STEP))
    expected = machine_by_hand(multiple, STEPS)
    assert np.abs(rows[:, 1:4] - expected).max() < 1e-10 * np.abs(expected).max()
    assert np.abs(machine_by_hand(1, STEPS) - machine_by_hand(MULTIPLE, STEPS)).max() > 1e-3
    assert controller.calls.count("controller.step") == STEPS // multiple
    assert controller.calls.count("load.step") == algorithm.sweeps > STEPS
    assert [algorithm.network.instances[i].name for loop in algorithm.loops for i in loop] == [
        "actuator",
        "load",
    ]
    assert algorithm.report()["late_connections"] == ["u"]
    assert algorithm.report()["order"] == ["actuator", "load", "controller"]


def test_without_sampling_the_controller_is_in_the_loop() -> None:
    algorithm = Strong()
    algorithm.setup(machine(pid([])))
    assert [len(loop) for loop in algorithm.loops] == [3]
    assert algorithm.late() == []


def test_sampled_slaves_follow_each_other_without_delay() -> None:
    """An observer, whose output is a fault on its way, before the controller that reads it."""
    calls: list[str] = []

    def passing(name: str) -> FakeSlave:
        return FakeSlave(name, 1, [0.0], lambda u, x, t, h: u, None, calls)

    plant = FakeSlave("plant", 1, [0.0], lambda u, x, t, h: [t + h], None, calls)
    slaves = [passing("controller"), passing("fault"), passing("observer"), plant]
    links = [
        Link(3, 0, 2, 0, False),
        Link(2, 0, 1, 0, True),
        Link(1, 0, 0, 0, False),
        Link(0, 0, 3, 0, False),
    ]
    algorithm = Strong(step_multiples={"observer": 1, "controller": 2})
    rows = simulated(Network(slaves, links, followers=[1]), algorithm, make_communication_points(1.0, 0.25))
    assert [call for call in calls if call.endswith("step")][-4:] == [
        "plant.step",
        "observer.step",
        "fault.step",
        "controller.step",
    ]
    # controller, fault, observer, plant: each shows the time, the controller at every other point
    assert rows[:, 1].tolist() == [0.0, 0.0, 0.5, 0.5, 1.0]
    assert (rows[:, 2:] == rows[:, :1]).all()
    assert algorithm.late() == [links[3]]


@pytest.mark.parametrize("extrapolation", ["master", "fmu"])
def test_outputs_of_a_sampled_slave_are_held(extrapolation: str) -> None:
    """However inputs are treated: the integral of what was sampled is a sum of rectangles."""
    expected = [0.0, *np.cumsum(0.5 * np.array(SIGNAL[:-1]))]
    assert integrated(Strong(extrapolation, {"source": 1})) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("extrapolation", ["master", "fmu"])
def test_line_of_a_sampled_input_covers_both_halves_of_a_step(extrapolation: str) -> None:
    """It goes from the value at the beginning of the step to that at its end."""

    def moving(u: np.ndarray, x: np.ndarray, time: float, step: float) -> Any:
        if step > 0.3:
            raise DiscardedStepError("source", "doStep", "fmi2Discard", [])
        return [(time + step) ** 2]

    integral = LinearSlave("integral", [[0.0]], [[1.0]], [[1.0]], [[0.0]], [0.0])
    network = Network([FakeSlave("source", 0, [0.0], moving), integral], [Link(0, 0, 1, 0, False)])
    rows = simulated(network, Strong(extrapolation, {"integral": 1}), make_communication_points(2.0, 0.5))
    squares = rows[:, 0] ** 2
    expected = [0.0, *np.cumsum(0.5 * 0.5 * (squares[1:] + squares[:-1]))]
    assert rows[:, 2].tolist() == pytest.approx(expected, abs=1e-12)
