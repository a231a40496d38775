"""Communication points are the decimal times that were asked for, and steps join them to the last bit."""

from collections.abc import Mapping
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from emla_cosim.base.errors import CommandError
from emla_cosim.master.algorithms.registry import Explicit, GaussSeidel, Jacobi, Strong
from emla_cosim.master.instances.fmu_instance import DiscardedStepError
from emla_cosim.master.network import Link, Network
from emla_cosim.master.stepping.error_control import ErrorControl
from emla_cosim.master.stepping.step_size_control import FixedSteps
from emla_cosim.master.stepping.timing import (
    MAXIMUM_STEPS,
    make_clock,
    make_communication_points,
)
from tests.support.simulated import begun, recorded
from tests.support.slaves import FakeSlave

DECIMAL_STEPS = (1e-4, 5e-6, 3e-5, 1.25e-6, 0.1, 0.7, 2.0**-13, 0.000123, 1.0, 50.0)
OTHER_STEPS = (1.0 / 3.0, 2.0 / 3.0, 1e-4 / 3.0, 1.0 / 44100.0, 2.0**-40, np.pi, 1e-200, 1e200)
STARTS = (0.0, 0.1, -2.5, 17.0, 1e3)
counts = st.integers(0, 10**7)


def exact(start: float, step: float, k: int) -> Fraction:
    """The point k of these decimal numbers."""
    return Fraction(repr(start)) + k * Fraction(repr(step))


# ---- points ------------------------------------------------------------------------------------


@given(st.sampled_from(STARTS), st.sampled_from(DECIMAL_STEPS), counts | st.integers(0, MAXIMUM_STEPS))
@example(0.0, 1e-4, 3)
def test_points_are_the_doubles_nearest_to_the_decimal_times(start: float, step: float, k: int) -> None:
    assert make_clock(start, step).point(k) == float(exact(start, step, k))


@given(st.integers(1, 900_000), st.integers(-9999, 9999), st.integers(0, 12), counts)
def test_points_of_any_short_decimal_numbers_are_nearest(p: int, s: int, digits: int, k: int) -> None:
    start, step = s / 10**digits, p / 10**digits
    assert make_clock(start, step).point(k) == float(exact(start, step, k))


@given(st.sampled_from([0.0, 0.1, 1.0 / 3.0]), st.sampled_from(OTHER_STEPS), counts)
@example(1.0 / 3.0, 1e-4, 12345)
def test_numbers_without_a_short_decimal_form_represent_themselves(start: float, step: float, k: int) -> None:
    assert make_clock(start, step).point(k) == start + k * step


# ---- steps of instances ----------------------------------------------------------------------


class Watch(FakeSlave):
    """Notes the steps that the master sets, and adds them up by itself."""

    interpolates = True

    def __init__(self, name: str, longest: float = np.inf) -> None:
        super().__init__(name, 1, [1.0], self._advance_state)
        self.longest = longest
        self.steps_taken: list[tuple[float, float]] = []

    def set_input_derivatives(self, derivatives: np.ndarray) -> None:
        pass

    def _advance_state(self, u: np.ndarray, x: np.ndarray, time: float, step: float) -> np.ndarray:
        if step > self.longest:
            raise DiscardedStepError(self.name, "doStep", "fmi2Discard", [])
        self.steps_taken.append((time, step))
        return x + step * (u - 2.0 * x)

    def save(self, state: object = None) -> object:
        return *super().save(), len(self.steps_taken)

    def restore(self, state: tuple) -> None:
        *rest, count = state
        super().restore(rest)
        del self.steps_taken[count:]

    def added_up(self, start: float) -> list[float]:
        """The times at which its own steps begin, and the last one's end."""
        times = [start]
        for _, step in self.steps_taken:
            times.append(times[-1] + step)
        return times


def watches(**longest: float) -> tuple[list[Watch], Network]:
    """Three of them in a ring."""
    slaves = [Watch(name, longest.get(name, np.inf)) for name in "abc"]
    return slaves, Network(slaves, [Link(i, 0, (i + 1) % 3, 0, False) for i in range(3)])


@pytest.mark.parametrize(("start", "step"), [(0.1, 1e-4), (1.0 / 3.0, 3e-5), (0.0, 1e-4 / 3.0)])
@pytest.mark.parametrize(("kind", "multiples"), [(Jacobi, {}), (GaussSeidel, {"b": 2, "c": 6})], ids=str)
def test_steps_of_instances_join(
    kind: type[Explicit], multiples: Mapping[str, int], step: float, start: float
) -> None:
    """Also where slaves step more rarely: each step begins at the end of the one before, to the last bit."""
    times = make_communication_points(start + 120 * step, step, start)
    slaves, network = watches()
    rows = recorded(FixedSteps(begun(network, kind("none", multiples), times), times))
    assert rows[:, 0].tolist() == [times.point(k) for k in range(121)]
    for slave in slaves:
        multiple = multiples.get(slave.name, 1)
        expected = rows[::multiple, 0].tolist()
        assert [time for time, _ in slave.steps_taken] == expected[:-1]
        assert slave.added_up(start) == expected


def test_halves_of_discarded_steps_join() -> None:
    times = make_communication_points(0.02, 1e-4)
    slaves, network = watches(a=3e-5)
    rows = recorded(FixedSteps(begun(network, Strong(), times), times))
    for slave in slaves:
        assert len(slave.steps_taken) == 4 * 200
        assert [time for time, _ in slave.steps_taken] == slave.added_up(0.0)[:-1]
        assert slave.added_up(0.0)[::4] == rows[:, 0].tolist()


@pytest.mark.parametrize("interval", [None, 1e-3, 3e-3])
def test_steps_chosen_by_their_error_join(interval: float | None) -> None:
    times = make_communication_points(0.06, 1e-4)
    slaves, network = watches()
    rows = recorded(ErrorControl(begun(network, Jacobi("fmu"), times), times, 1e-5, interval))
    if interval is not None:
        assert rows[:, 0].tolist() == [float(exact(0.0, interval, k)) for k in range(len(rows))]
    assert rows[-1, 0] == 0.06
    for slave in slaves:
        times_added = slave.added_up(0.0)
        assert [time for time, _ in slave.steps_taken] == times_added[:-1]
        assert set(rows[:, 0]) <= set(times_added[::2])


def test_a_run_that_begins_far_from_zero_has_as_many_steps() -> None:
    assert make_communication_points(1000000000.01, 1e-4, 1e9).steps == 100


def test_steps_below_the_resolution_of_doubles_are_refused() -> None:
    with pytest.raises(CommandError, match="are too coarse for steps of "):
        make_communication_points(1e15 + 1.0, 1e-4, 1e15)
