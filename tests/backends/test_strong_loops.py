"""Strong coupling with directional derivatives: they spare sweeps, and loops have those of their answer."""

from pathlib import Path

import numpy as np
import pytest

from emla_cosim.fmu.models import fmu_path
from emla_cosim.master.algorithms.group import loop_derivatives
from emla_cosim.master.algorithms.newton import estimate_jacobian
from emla_cosim.master.algorithms.registry import Strong
from emla_cosim.master.network import Link, Network
from emla_cosim.master.stepping.timing import make_communication_points
from tests.support.linear import LinearSlave, connected
from tests.support.simulated import begun, step_by_step
from tests.support.slaves import fmu_slave
from tests.support.two_masses import rigid_load

TIMES = make_communication_points(1.0, 1.0 / 32.0)


def lag(name: str, feedthrough: list[list[float]], x: float) -> LinearSlave:
    outputs, inputs = np.shape(feedthrough)
    return LinearSlave(name, [[-2.0]], np.ones(inputs), np.ones(outputs), feedthrough, [x])


def two_loops() -> tuple:
    """Of two signals, and of one that reads the first; and a slave before and one behind."""
    slaves = [
        lag("sink", [[1.0]], 0.5),
        lag("a", [[1.5, -4.0], [3.0, 2.5]], 1.0),
        lag("b", [[2.0, 1.0], [-1.0, 3.0]], -1.0),
        LinearSlave("source", [[-1.0]], [], [1.0], np.empty((1, 0)), [1.0]),
        lag("c", [[1.0, 5.0]], 2.0),
        lag("d", [[1.0]], 0.25),
    ]
    inside = [(2, 0, 1, 0), (2, 1, 1, 1), (1, 0, 2, 0), (1, 1, 2, 1)]
    return slaves, [*inside, (5, 0, 0, 0), (3, 0, 4, 0), (5, 0, 4, 1), (4, 0, 5, 0)]


def test_directional_derivatives_of_an_fmu_match_its_outputs(fmu_folder: Path) -> None:
    """Against differences in initialization mode, where outputs follow inputs."""
    path = fmu_path("EmlaPlant", "native", fmu_folder)
    inputs, outputs = ["u_q", "F_L", "d_2"], ["a_L", "v_L", "tau_m"]
    with fmu_slave(path, inputs, outputs) as slave:
        assert slave.differentiates
        slave.enter_initialization(0.0, 1.0)
        at, direction = np.array([20.0, 1e4, 0.1]), np.array([3.0, 500.0, 0.2])
        outputs_on_sides = []
        for side in (-1.0, 1.0):
            slave.inputs[:] = at + side * direction
            slave.set_inputs()
            slave.get_outputs()
            outputs_on_sides.append(slave.outputs.copy())
        differences = 0.5 * (outputs_on_sides[1] - outputs_on_sides[0])
        assert differences[0] != 0.0
        assert slave.directional_derivative(direction) == pytest.approx(differences, rel=1e-9, abs=1e-12)


class Differentiable(LinearSlave):
    """A slave with the directional derivatives of its outputs."""

    differentiates = True

    def directional_derivative(self, direction: np.ndarray) -> np.ndarray | None:
        return self.D @ direction


@pytest.mark.parametrize("extrapolation", ["none", "fmu"])
def test_directional_derivatives_spare_sweeps(extrapolation: str) -> None:
    """With them the first step takes two sweeps of each loop, if it is too short for states to count."""
    sweeps = []
    for kind in (Differentiable, LinearSlave):
        slaves, wires = two_loops()
        slaves = [kind(s.name, s.A, s.B, s.C, s.D, s.x_0) for s in slaves]
        one_step = make_communication_points(1e-12, 1e-12)
        algorithm = begun(connected(slaves, wires), Strong(extrapolation), one_step)
        algorithm.network.signals[:] += 1.0  # so that there is something to agree on
        assert list(step_by_step(algorithm, one_step)) == [0]
        sweeps.append(algorithm.sweeps)
    assert sweeps[0] == 2 * 2
    assert sweeps[1] >= sweeps[0] + 3  # one value of a loop costs a sweep to learn


def test_derivatives_of_a_loop_match_its_answer() -> None:
    """With factors of units, and where inputs take the middle of their lines."""
    slaves, _ = two_loops()
    a, b = (Differentiable(s.name, s.A, s.B, s.C, s.D, s.x_0) for s in slaves[1:3])
    a.interpolates = False
    links = [Link(1, 0, 0, 0, True, True, 2.0, 1.0), Link(1, 1, 0, 1, True, True, -3.0)]
    links += [Link(0, 0, 1, 0, True), Link(0, 1, 1, 1, True, True, 0.5)]
    algorithm = begun(Network([a, b], links), Strong("fmu"), TIMES)
    (group,) = algorithm.groups
    assert group.coupling_variables.tolist() == [2, 3]
    first = 0.5 * np.array([[1.5, -4.0], [3.0, 2.5]]) @ np.diag([2.0, -3.0])
    expected = np.array([[2.0, 1.0], [-1.0, 3.0]]) @ np.diag([1.0, 0.5]) @ first
    derivatives = loop_derivatives(algorithm.exchange, group)
    assert derivatives == pytest.approx(expected, rel=1e-14)
    inverse = expected @ np.linalg.inv(expected - np.eye(2))
    assert group.jacobian == pytest.approx(inverse, rel=1e-12)
    b.differentiates = False
    assert loop_derivatives(algorithm.exchange, group) is None


def test_useless_derivatives_are_ignored() -> None:
    """Of x = x, which has no solution or many, and infinite ones."""
    assert estimate_jacobian(1, np.array([[3.0]])) == pytest.approx(np.array([[1.5]]))
    for derivative in (1.0, np.inf, np.nan):
        assert (estimate_jacobian(1, np.array([[derivative]])) == estimate_jacobian(1)).all()


def test_without_derivatives_of_a_slave_the_loop_is_learned() -> None:
    slaves, wires = rigid_load(1.5)
    slaves = [Differentiable(s.name, s.A, s.B, s.C, s.D, s.x_0) for s in slaves]
    with_derivatives = begun(connected(slaves, wires), Strong(), TIMES).groups[0].jacobian.copy()
    assert with_derivatives == pytest.approx(np.array([[1.5 / 2.5]]))
    slaves[1].directional_derivative = lambda direction: None
    without = begun(connected(slaves, wires), Strong(), TIMES).groups[0].jacobian
    assert (without == estimate_jacobian(1)).all()
