"""Order of accuracy of every algorithm with every extrapolation, against the whole as one equation."""

from collections.abc import Callable, Mapping
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from emla_cosim.fmu.models import fmu_path
from emla_cosim.master.algorithms.algorithm import Algorithm
from emla_cosim.master.algorithms.extrapolation import EXTRAPOLATIONS
from emla_cosim.master.algorithms.registry import ALGORITHMS
from emla_cosim.master.assembly import Assembly
from emla_cosim.master.stepping.timing import make_communication_points
from tests.support.linear import LinearSlave, Whole, Wire, connected
from tests.support.simulated import simulated
from tests.support.smooth_lift import STATE_SIGNALS, lift, whole
from tests.support.tiers import mostly_slow

STEPS, SAMPLES = (80, 160), 10
"""In a second."""
STATES = [1, 2, 3]
"""Signals that are states of slaves with inputs."""
DIRECT_OUTPUTS = [4]
"""A signal in which inputs show at once."""


def masses(load_by_force: bool) -> tuple[list[LinearSlave], list[Wire]]:
    """A swinging source that drives one mass, which drives another; that one gives a force as well.

    The first mass takes the force, with direct feedthrough, or else the displacement.
    """
    source = LinearSlave("source", [[0, 1.5], [-1.5, 0]], [], [1, 0], np.empty((1, 0)), [0, 1])
    a = LinearSlave("a", [[0, 1], [-4, -0.3]], [[0, 0], [1, 1]], np.eye(2), np.zeros((2, 2)), [1, 0])
    D = [[0, 0], [-1, -0.2]]
    b = LinearSlave("b", [[0, 1], [-3, -0.4]], [[0, 0], [2, 0.4]], [[1, 0], [1, 0.2]], D, [0, 0.5])
    wires = [(1, 0, 2, 0), (1, 1, 2, 1), (2, int(load_by_force), 1, 0), (0, 0, 1, 1)]
    return [source, a, b], wires


def orders(make: Callable[[], Algorithm], load_by_force: bool, stop: int = 1) -> tuple[np.ndarray, int]:
    """The order of every signal from two steps, and the one that the algorithm claims."""
    errors, claimed = [], 0
    for steps in STEPS:
        part, algorithm = masses(load_by_force), make()
        rows = simulated(connected(*part), algorithm, make_communication_points(stop, 1.0 / steps))[
            :: steps // SAMPLES
        ]
        closed_form = Whole(*part)
        errors.append(np.abs(rows[:, 1:] - [closed_form.outputs(t) for t in rows[:, 0]]).max(axis=0))
        claimed = algorithm.accuracy
    with np.errstate(invalid="ignore", divide="ignore"):  # the source makes no error
        return np.log2(errors[0] / errors[1]), claimed


DEFAULT_PAIRS = [("jacobi", "none"), ("jacobi", "fmu"), ("gauss-seidel", "master"), ("strong", "fmu")]
all_pairs = pytest.mark.parametrize(
    ("name", "extrapolation"), mostly_slow(product(ALGORITHMS, EXTRAPOLATIONS), DEFAULT_PAIRS)
)


@all_pairs
def test_slaves_coupled_by_states(name: str, extrapolation: str) -> None:
    """Held inputs cost an order. After `master` an unconnected force is that of the middle."""
    measured, claimed = orders(lambda: ALGORITHMS[name](extrapolation), False)
    assert claimed == (1 if extrapolation == "none" else 2)
    assert measured[STATES] == pytest.approx([claimed] * 3, abs=0.05)
    assert measured[DIRECT_OUTPUTS] == pytest.approx(2 if extrapolation == "fmu" else 1, abs=0.05)


@all_pairs
def test_slaves_coupled_with_direct_feedthrough(name: str, extrapolation: str) -> None:
    """After `master` the force of the middle is late by half a step for the mass that takes it."""
    measured, claimed = orders(lambda: ALGORITHMS[name](extrapolation), True)
    assert claimed == (2 if extrapolation == "fmu" else 1)
    assert measured[STATES + DIRECT_OUTPUTS] == pytest.approx([claimed] * 4, abs=0.05)


MULTIPLES = [{"b": 4}, {"a": 2}, {"a": 2, "b": 4}]


@pytest.mark.parametrize(
    ("name", "extrapolation", "multiples", "load_by_force"),
    mostly_slow(
        product(["jacobi", "gauss-seidel"], EXTRAPOLATIONS, MULTIPLES, [False, True]),
        [
            ("jacobi", "none", {"b": 4}, True),
            ("jacobi", "master", {"a": 2}, False),
            ("jacobi", "fmu", {"a": 2, "b": 4}, True),
            ("gauss-seidel", "none", {"a": 2}, False),
            ("gauss-seidel", "master", {"a": 2, "b": 4}, True),
            ("gauss-seidel", "fmu", {"b": 4}, False),
        ],
    ),
)
def test_slaves_that_step_more_rarely(
    name: str, extrapolation: str, multiples: Mapping[str, int], load_by_force: bool
) -> None:
    make: Callable[..., Algorithm] = ALGORITHMS[name]
    measured, claimed = orders(lambda: make(extrapolation, multiples), load_by_force, stop=2)
    direct = load_by_force and extrapolation == "master"
    assert claimed == (1 if direct or extrapolation == "none" else 2)
    # longer steps, longer terms of the next order
    assert measured[STATES] == pytest.approx([claimed] * 3, abs=0.15)
    assert measured[DIRECT_OUTPUTS] == pytest.approx(2 if extrapolation == "fmu" else 1, abs=0.15)


@pytest.mark.parametrize(
    ("name", "extrapolation", "order"),
    mostly_slow(
        [(name, *way) for name in ALGORITHMS for way in (("none", 1), ("master", 1), ("fmu", 2))],
        [("jacobi", "none", 1), ("gauss-seidel", "fmu", 2)],
    ),
)
def test_lift_joint(name: str, extrapolation: str, order: int, fmu_folder: Path) -> None:
    """Native FMUs against the joint as one equation; its controller and disturbance show inputs at once."""
    system, stop, steps, sample = lift(), 0.01, (2e-5, 1e-5), 5e-4
    solution = whole(np.linspace(0.0, stop, round(stop / sample) + 1))
    fmus = {c.name: fmu_path(c.model, "native", fmu_folder) for c in system.components}
    errors = []
    for step in steps:
        with Assembly(system, fmus) as assembly:
            columns = [1 + assembly.network.names.index(n) for n in STATE_SIGNALS[:6]]
            algorithm = ALGORITHMS[name](extrapolation)
            rows = simulated(assembly.network, algorithm, make_communication_points(stop, step))[
                :: round(sample / step)
            ]
        assert algorithm.accuracy == order
        difference = np.abs(rows[:, columns] - solution[:, :6]).max(axis=0)
        errors.append((difference / np.ptp(solution[:, :6], axis=0)).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.1)
