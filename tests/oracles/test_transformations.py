"""Factors and offsets of links do what the same factors and offsets within the slaves would do."""

from collections.abc import Sequence
from dataclasses import replace
from math import pi
from typing import Any

import numpy as np
import pytest

from emla_cosim.master.algorithms.extrapolation import EXTRAPOLATIONS
from emla_cosim.master.algorithms.registry import ALGORITHMS, Jacobi
from emla_cosim.master.network import Link, Network
from emla_cosim.master.stepping.error_control import ErrorControl
from emla_cosim.master.stepping.step_size_control import FixedSteps
from emla_cosim.master.stepping.timing import make_communication_points
from tests.support.linear import LinearSlave, connected
from tests.support.simulated import begun, recorded
from tests.support.slaves import FakeSlave
from tests.support.tiers import mostly_slow

RAD_S_PER_RPM, KELVIN = 2.0 * pi / 60.0, 273.15
WAYS = ["jacobi", "gauss-seidel", "strong"]
CONTROLLED = [f"{name}, controlled" for name in ALGORITHMS]
ALL_PAIRS = [(way, extrapolation) for way in WAYS + CONTROLLED for extrapolation in EXTRAPOLATIONS]
DEFAULT_PAIRS = [
    ("jacobi", "none"),
    ("jacobi", "master"),
    ("gauss-seidel", "master"),
    ("gauss-seidel", "fmu"),
    ("strong", "fmu"),
    ("strong", "none"),
    ("jacobi, controlled", "fmu"),
    ("strong, controlled", "none"),
]
all_pairs = pytest.mark.parametrize(("way", "extrapolation"), mostly_slow(ALL_PAIRS, DEFAULT_PAIRS))
Transformation = tuple[float, float]
"""Factor and offset."""


def run(network: Network, way: str, extrapolation: str) -> np.ndarray:
    """All rows of a run over 1 s."""
    name, _, how = way.partition(", ")
    times, algorithm = make_communication_points(1.0, 0.02), ALGORITHMS[name](extrapolation)
    begun(network, algorithm, times)
    if how == "controlled":
        return recorded(ErrorControl(algorithm, times, 5e-2, 0.1))
    return recorded(FixedSteps(algorithm, times))


# ---- slaves that integrate without error -------------------------------------------------------


class Speaking(LinearSlave):
    """Understands its inputs as factor * input + offset by itself, and gives its outputs times `gains`."""

    def __init__(self, *matrices: Any, wants: Sequence[Transformation] = (), gains: Any = 1.0) -> None:
        super().__init__(*matrices)
        self.factors, self.offsets = np.array(wants, dtype=float).reshape(-1, 2).T
        self.gains = gains * np.ones(len(self.outputs))
        self.nominals = np.abs(self.gains)
        self.inputs -= self.offsets
        self.inputs /= np.where(self.factors == 0.0, np.inf, self.factors)

    def set_inputs(self) -> None:
        super().set_inputs()
        self.held[:] = self.factors * self.inputs + self.offsets

    def set_input_derivatives(self, derivatives: np.ndarray) -> None:
        self.slopes[:] = self.factors * derivatives

    def get_outputs(self) -> None:
        super().get_outputs()
        self.outputs *= self.gains


WIRES = [(1, 0, 2, 0), (1, 1, 2, 1), (2, 1, 1, 0), (0, 0, 1, 1)]
NO_TRANSFORMATIONS = [(1.0, 0.0)] * 4


def network(
    on_links: Sequence[Transformation],
    in_slaves: Sequence[Transformation] = NO_TRANSFORMATIONS,
    gains: Sequence[Any] = (1.0, 1.0, 1.0),
) -> Network:
    """A swinging source drives a mass, which drives another, whose force shows inputs at once.

    Transformations are given in the order of `WIRES`.
    """
    swing, mass, second = [[0, 1.5], [-1.5, 0]], [[0, 1], [-4, -0.3]], [[0, 1], [-3, -0.4]]
    B_a, B_b = [[0, 0], [1, 1]], [[0, 0], [2, 0.4]]
    C_b, D_b = [[1, 0], [1, 0.2]], [[0, 0], [-1, -0.2]]
    slaves = [
        Speaking("source", swing, [], [1, 0], np.empty((1, 0)), [0, 1], gains=gains[0]),
        Speaking("a", mass, B_a, np.eye(2), np.zeros((2, 2)), [1, 0], wants=in_slaves[2:], gains=gains[1]),
        Speaking("b", second, B_b, C_b, D_b, [0, 0.5], wants=in_slaves[:2], gains=gains[2]),
    ]
    links = zip(connected(slaves, WIRES).links, on_links, strict=True)
    return Network(slaves, [replace(link, factor=factor, offset=offset) for link, (factor, offset) in links])


ON_LINKS = {
    "all": [(RAD_S_PER_RPM, 0.0), (1.0, KELVIN), (-0.5, -1e-3), (0.0, 0.25)],
    "one": [(1.0, 0.0), (1.0 / 3.0, 7.0), (1.0, 0.0), (1.0, 0.0)],
}


@pytest.mark.parametrize(
    ("transformed", "way", "extrapolation"),
    mostly_slow(
        [(links, *pair) for links in ON_LINKS for pair in ALL_PAIRS],
        [("one", "jacobi", "fmu"), *(("all", *pair) for pair in DEFAULT_PAIRS)],
    ),
)
def test_transformation_on_a_link_or_in_its_target_is_the_same(
    transformed: str, way: str, extrapolation: str
) -> None:
    transformations = ON_LINKS[transformed]
    actual = run(network(transformations), way, extrapolation)
    expected = run(network(NO_TRANSFORMATIONS, transformations), way, extrapolation)
    assert actual.shape == expected.shape and (actual == expected).all()
    assert np.ptp(actual[:, 2]) > 0.1
    without = run(network(NO_TRANSFORMATIONS), way, extrapolation)
    assert actual.shape != without.shape or np.abs(actual - without).max() > 0.1


@all_pairs
def test_units_of_powers_of_two_change_no_bit(way: str, extrapolation: str) -> None:
    """Sources are in other units, and links convert; the motion is the same, also in its steps."""
    factors = [4.0, 2.0**-20, 64.0, 1.0, 0.125]
    source, *mass_factors = factors
    gains = [source, np.array(mass_factors[:2]), np.array(mass_factors[2:])]
    translated = [
        (1.0 / factor, 0.0) for factor in (mass_factors[0], mass_factors[1], mass_factors[3], source)
    ]
    rows = run(network(translated, gains=gains), way, extrapolation)
    rows[:, 1:] /= factors
    expected = run(network(NO_TRANSFORMATIONS), way, extrapolation)
    assert rows.shape == expected.shape and (rows == expected).all()


# ---- what is not transformed -------------------------------------------------------------------


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("transformation", [(1.0, 0.0), (2.0, 1.0)])
def test_plain_links_pass_on_every_bit(transformation: Transformation, way: str) -> None:
    """Also the sign of zero, and beside a link that is none."""
    values = [-0.0, 0.0, 5e-324, -1.7976931348623157e308, 0.1]
    source = FakeSlave("source", 0, values, lambda u, x, t, h: x)
    reader = FakeSlave("reader", len(values) + 1, [0.0], lambda u, x, t, h: x)
    links = [Link(0, i, 1, i, False) for i in range(len(values))]
    links.append(Link(0, 4, 1, 5, False, True, *transformation))
    run(Network([source, reader], links), way, "none")
    assert reader.held[:-1].tobytes() == np.array(values).tobytes()
    assert reader.held[-1] == transformation[0] * 0.1 + transformation[1]


# ---- initial values ----------------------------------------------------------------------------


def gate(name: str, output: Any, start: float = 0.0) -> tuple[FakeSlave, list[float]]:
    """A slave whose output is a function of its input, and the inputs that it saw."""
    received: list[float] = []
    slave = FakeSlave(
        name, 1, [0.0], lambda u, x, t, h: x, lambda u, x: [(received.append(u[0]), output(u[0]))[1]]
    )
    slave.inputs[:] = start
    del received[:]
    return slave, received


@pytest.mark.parametrize(("factor", "offset"), [(2.0, 0.0), (-0.25, 3.0), (1.0, 8.0)])
def test_start_values_replace_transformed_values(factor: float, offset: float) -> None:
    """The slave sees its own start value before its source has given a value."""
    (a, received), (b, _) = gate("a", lambda u: 5.0, start=7.0), gate("b", lambda u: 2.0 * u)
    links = [Link(0, 0, 1, 0, True, initial=True), Link(1, 0, 0, 0, False, False, factor, offset)]
    begun(Network([a, b], links), Jacobi(), make_communication_points(1.0, 0.1))
    assert list(dict.fromkeys(received)) == [7.0, factor * 10.0 + offset]
    assert (a.held[0], b.held[0]) == (factor * 10.0 + offset, 5.0)


@pytest.mark.parametrize("start", [-0.0, 0.1, 5e-324])
def test_start_values_of_plain_links_keep_every_bit(start: float) -> None:
    (a, received), (b, _) = gate("a", lambda u: 5.0, start=start), gate("b", lambda u: 2.0 * u)
    links = [Link(0, 0, 1, 0, True, initial=True), Link(1, 0, 0, 0, False, initial=False)]
    begun(Network([a, b], links), Jacobi(), make_communication_points(1.0, 0.1))
    assert list(dict.fromkeys(map(repr, received))) == [repr(np.float64(start)), repr(np.float64(10.0))]


def test_input_with_factor_0_needs_no_start_value() -> None:
    """A factor of 0 has no inverse."""
    (a, received), (b, _) = gate("a", lambda u: 5.0, start=7.0), gate("b", lambda u: 2.0 * u)
    links = [Link(0, 0, 1, 0, True, initial=True), Link(1, 0, 0, 0, False, False, 0.0, 3.0)]
    with np.errstate(all="raise"):
        network = begun(Network([a, b], links), Jacobi(), make_communication_points(1.0, 0.1)).network
    assert set(received) == {3.0}
    assert network.signals.tolist() == [5.0, 10.0]


@pytest.mark.parametrize(("factor", "offset"), [(0.5, 1.0), (-3.0, 2.0), (50.0, 0.0), (0.0, 4.0)])
def test_loops_of_initial_values_are_solved_with_their_transformations(factor: float, offset: float) -> None:
    """y = u + 1 with u = factor * y + offset."""
    (a, _), (b, _) = gate("a", lambda u: u + 1.0), gate("b", lambda u: u)
    links = [Link(1, 0, 0, 0, True, True, factor, offset), Link(0, 0, 1, 0, True)]
    network = begun(Network([a, b], links), Jacobi(), make_communication_points(1.0, 0.1)).network
    assert network.signals == pytest.approx([(offset + 1.0) / (1.0 - factor)] * 2, rel=1e-10)
    assert a.held[0] == pytest.approx(factor * network.signals[1] + offset, rel=1e-10)


@pytest.mark.parametrize(("factor", "offset"), [(0.5, 1.0), (-3.0, 2.0), (50.0, -7.0)])
def test_loops_of_steps_are_solved_with_their_transformations(factor: float, offset: float) -> None:
    """The same at every step: neither repetition nor a late value would do."""
    a = FakeSlave("a", 1, [0.0], lambda u, x, t, h: x + h, lambda u, x: u + 1.0 + x)
    b = FakeSlave("b", 1, [0.0], lambda u, x, t, h: x, lambda u, x: u)
    links = [Link(1, 0, 0, 0, True, True, factor, offset), Link(0, 0, 1, 0, True)]
    rows = run(Network([a, b], links), "strong", "none")
    assert rows[:, 1] == pytest.approx((offset + 1.0 + rows[:, 0]) / (1.0 - factor), rel=1e-6)
