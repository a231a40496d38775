"""Algorithms and the stepping loop, with fake slaves of a few lines."""

import pytest

from emla_cosim.base.errors import CommandError
from emla_cosim.master.algorithms.registry import GaussSeidel, Jacobi, Strong
from emla_cosim.master.network import Link, Network
from emla_cosim.master.stepping.step_size_control import FixedSteps
from emla_cosim.master.stepping.timing import make_communication_points
from tests.support.simulated import begun, recorded, step_by_step
from tests.support.slaves import FakeSlave


def oscillator() -> Network:
    """x' = v in one slave, v' = -x in another: coupled by states only."""
    position = FakeSlave("position", 1, [1.0], lambda u, x, t, h: x + h * u)
    speed = FakeSlave("speed", 1, [0.0], lambda u, x, t, h: x - h * u)
    return Network([position, speed], [Link(1, 0, 0, 0, False), Link(0, 0, 1, 0, False)])


def test_jacobi_uses_old_values_and_gauss_seidel_new_ones() -> None:
    """One step of the oscillator by hand, h = 0.1, from x = 1, v = 0."""
    for algorithm, expected in ((Jacobi(), [1.0, -0.1]), (GaussSeidel(), [1.0, -0.1])):
        system, times = oscillator(), make_communication_points(0.2, 0.1)
        steps = step_by_step(begun(system, algorithm, times), times)
        next(steps)
        assert system.signals.tolist() == expected
        next(steps)
        # position moves with the old speed in both; then speed sees the old or the new position
        assert system.signals[0] == 0.99
        expected_input = 1.0 if isinstance(algorithm, Jacobi) else 0.99
        assert system.signals[1] == pytest.approx(-0.1 - 0.1 * expected_input)


@pytest.mark.parametrize(
    ("name", "multiple", "message"),
    [
        ("speed", 0, "the step multiple 0 of speed must be at least 1."),
        ("speed", 2**31 + 1, "the step multiple 2147483649 of speed must be at most 2147483648."),
        ("sped", 2, "there is no component 'sped' for a step multiple."),
    ],
)
def test_invalid_step_multiples_are_refused(name: str, multiple: int, message: str) -> None:
    with pytest.raises(CommandError, match=f"^{message}$"):
        Strong(step_multiples={name: multiple}).setup(oscillator())
    GaussSeidel(step_multiples={"speed": 1, "position": 2**31}).setup(oscillator())


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
