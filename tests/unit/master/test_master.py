"""Algorithms and the stepping loop, with fake slaves of a few lines."""

import numpy as np
import pytest

from emla_cosim.base.errors import CommandError
from emla_cosim.master.algorithms.gauss_seidel import GaussSeidel
from emla_cosim.master.algorithms.jacobi import Jacobi
from emla_cosim.master.algorithms.operation_table import OperationTableAlgorithm
from emla_cosim.master.algorithms.registry import ALGORITHMS
from emla_cosim.master.algorithms.strong import Strong
from emla_cosim.master.instances.fmu_instance import InstanceError
from emla_cosim.master.network import Link, Network, stepping_order
from emla_cosim.master.run_loop import simulate
from emla_cosim.master.stepping.fixed_steps import FixedSteps
from emla_cosim.master.stepping.timing import make_communication_points
from tests.support.simulated import Table, begun, recorded, simulated
from tests.support.slaves import FakeSlave


def oscillator(calls: list[str] | None = None) -> Network:
    """x' = v in one slave, v' = -x in another: coupled by states only."""
    position = FakeSlave("position", 1, [1.0], lambda u, x, t, h: x + h * u, calls=calls)
    speed = FakeSlave("speed", 1, [0.0], lambda u, x, t, h: x - h * u, calls=calls)
    return Network([position, speed], [Link(1, 0, 0, 0, False), Link(0, 0, 1, 0, False)])


@pytest.mark.parametrize("kind", [Jacobi, GaussSeidel])
def test_calling_order(kind: type[Jacobi] | type[GaussSeidel]) -> None:
    calls: list[str] = []
    system, algorithm = oscillator(calls), kind()
    algorithm.setup(system)
    algorithm.initialize(0.0, 1.0)
    del calls[:]
    algorithm.step(0.0, 0.1)
    names, order = ["position", "speed"], ["set", "step", "get"]
    if kind is Jacobi:
        assert calls == [f"{name}.{call}" for call in order for name in names]
    else:
        assert calls == [f"{name}.{call}" for name in names for call in order]


def test_jacobi_uses_old_values_and_gauss_seidel_new_ones() -> None:
    """One step of the oscillator by hand, h = 0.1, from x = 1, v = 0."""
    for algorithm, expected in ((Jacobi(), [1.0, -0.1]), (GaussSeidel(), [1.0, -0.1])):
        system = oscillator()
        algorithm.setup(system)
        algorithm.initialize(0.0, 1.0)
        algorithm.step(0.0, 0.1)
        assert system.signals.tolist() == expected
        algorithm.step(0.1, 0.1)
        # position moves with the old speed in both; then speed sees the old or the new position
        assert system.signals[0] == 0.99
        seen = 1.0 if isinstance(algorithm, Jacobi) else 0.99
        assert system.signals[1] == pytest.approx(-0.1 - 0.1 * seen)


@pytest.mark.parametrize(
    ("name", "multiple", "message"),
    [
        ("speed", 0, "the step multiple 0 of speed must be at least 1."),
        ("speed", 2**31 + 1, "the step multiple 2147483649 of speed must be at most 2147483648."),
        ("sped", 2, "there is no component 'sped' for a step multiple."),
    ],
)
@pytest.mark.parametrize("kind", [GaussSeidel, Strong])
def test_invalid_step_multiples_are_refused(
    kind: type[OperationTableAlgorithm], name: str, multiple: int, message: str
) -> None:
    with pytest.raises(CommandError, match=f"^{message}$"):
        kind(step_multiples={name: multiple}).setup(oscillator())
    kind(step_multiples={"speed": 1, "position": 2**31}).setup(oscillator())


@pytest.mark.parametrize("name", ALGORITHMS)
def test_first_order_on_the_oscillator(name: str) -> None:
    errors = []
    for steps in (1000, 2000, 4000):
        system = oscillator()
        simulated(system, ALGORITHMS[name](), make_communication_points(1.0, 1.0 / steps))
        errors.append(np.abs(system.signals - [np.cos(1.0), -np.sin(1.0)]).max())
    assert np.log2(np.array(errors[:-1]) / errors[1:]) == pytest.approx([1.0, 1.0], abs=0.05)


def test_stepping_order_puts_direct_feedthrough_last() -> None:
    """reference, plant, disturbance, observer, controller of a joint, with its real links."""
    reference, plant, disturbance, observer, controller = range(5)
    links = [
        Link(reference, 0, controller, 0, True),
        Link(disturbance, 0, plant, 0, False),
        Link(plant, 0, disturbance, 0, True),
        Link(plant, 0, observer, 0, False),
        Link(plant, 0, controller, 0, True),
        Link(observer, 0, controller, 0, True),
        Link(controller, 0, plant, 0, False),
        Link(controller, 0, observer, 0, False),
    ]
    order = stepping_order(5, links)
    assert order.index(plant) < order.index(disturbance)
    assert order.index(plant) < order.index(observer) < order.index(controller)
    assert order[-1] == controller


def test_stepping_order_of_a_loop_has_all_instances() -> None:
    loop = [Link(0, 0, 1, 0, True), Link(1, 0, 2, 0, True), Link(2, 0, 0, 0, True), Link(0, 0, 0, 0, True)]
    assert sorted(stepping_order(3, loop)) == [0, 1, 2]


def test_time_is_never_accumulated() -> None:
    times: list[float] = []
    clock = FakeSlave("clock", 0, [0.0], lambda u, x, t, h: (times.append(t), [t + h])[1])
    rows = simulated(Network([clock], []), Jacobi(), make_communication_points(100.0, 0.1))
    assert times == [k / 10 for k in range(1000)]
    assert rows[:, 0].tolist() == [k / 10 for k in range(1001)]


def test_row_zero_is_the_initial_state_and_rows_are_labelled_with_their_end() -> None:
    counter = FakeSlave("counter", 0, [0.0], lambda u, x, t, h: x + 1)
    rows = simulated(Network([counter], []), Jacobi(), make_communication_points(0.3, 0.1))
    assert rows[:, 0] == pytest.approx([0.0, 0.1, 0.2, 0.3])
    assert rows[:, 1].tolist() == [0.0, 1.0, 2.0, 3.0]


def test_failing_instance_ends_the_run_at_its_step() -> None:
    def fail(u: np.ndarray, x: np.ndarray, t: float, h: float) -> np.ndarray:
        if t > 0.45:
            raise InstanceError("bad", "doStep", "fmi2Error", ["I am tired."])
        return x + 1

    times = make_communication_points(1.0, 0.1)
    stepping = FixedSteps(begun(Network([FakeSlave("bad", 0, [0.0], fail)], []), Jacobi(), times), times)
    table = Table(2)
    with pytest.raises(InstanceError, match=r"bad answered doStep with fmi2Error. It said: I am tired."):
        simulate(stepping, table)
    assert (table.rows[-1, 0], stepping.time) == (0.5, 0.5)


def test_an_interruption_ends_between_two_steps() -> None:
    times, slave = make_communication_points(1e6, 0.1), FakeSlave("s", 0, [0.0], lambda u, x, t, h: x + 1)
    stepping = FixedSteps(begun(Network([slave], []), Jacobi(), times), times)
    rows = recorded(stepping, interrupted=lambda: stepping.steps > 4)
    assert rows[-1].tolist() == [stepping.time, stepping.steps]
    assert 4 < stepping.steps < 1e7


@pytest.mark.parametrize(
    ("stop", "step", "message"),
    [
        (1.0, 0.0, "step size 0 s must be a positive"),
        (1.0, -1e-3, "step size -0.001 s must be a positive"),
        (1.0, float("nan"), "step size nan s must be a positive"),
        (0.0, 1e-3, "stop time 0 s must be"),
        (-1.0, 1e-3, "stop time -1 s must be"),
        (float("inf"), 1e-3, "stop time inf s must be"),
        (1.0, 0.3, "stop time 1 s is not a whole number of steps of 0.3 s; 0.9 s would be"),
        (1.0, 2.0, "stop time 1 s is not a whole number of steps of 2 s; 2 s would be"),
        (1.0, 1e-15, "are more than 1e"),
    ],
)
def test_invalid_times_are_refused(stop: float, step: float, message: str) -> None:
    with pytest.raises(CommandError, match=message):
        make_communication_points(stop, step)


def test_input_without_a_source_is_refused() -> None:
    with pytest.raises(ValueError, match="needs a link"):
        Network([FakeSlave("s", 1, [0.0], lambda u, x, t, h: x)], [])
