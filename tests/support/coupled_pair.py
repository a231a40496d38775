"""Pairs of linear slaves stepped by an algorithm, with the energies of their bonds and the exact solution."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.linalg import expm

from emla_cosim.master.algorithms.continuous_connections import (
    list_continuous_connections,
    loop_responses,
)
from emla_cosim.master.algorithms.registry import ALGORITHMS
from emla_cosim.master.stepping.fixed_steps import FixedSteps
from emla_cosim.master.stepping.timing import make_communication_points
from emla_cosim.recorders.bond_energies import BondEnergies
from emla_cosim.recorders.recorder import Outline
from emla_cosim.system.bond import Bond
from tests.support.linear import LinearSlave, Whole, Wire, connected
from tests.support.simulated import step_by_step

Parts = tuple[list[LinearSlave], list[Wire]]


def spring_pair(k: float, kc: float, damping: float = 0.0) -> Parts:
    """Two masses of 1 kg on springs of k and 1000 N/m, and a spring kc between them, in the second part."""
    A, load = [[0, 1], [-k, -2 * damping]], [[0, 1], [-kc - 1000.0, -damping]]
    first = LinearSlave("first", A, [0, 1], [[1, 0], [0, 1]], [[0], [0]], [0.01, 0])
    B, D = [[0, 0], [kc, damping]], [[-kc, -damping]]
    second = LinearSlave("second", load, B, [kc, damping], D, [0, 0])
    return [first, second], [(0, 0, 1, 0), (0, 1, 1, 1), (1, 0, 0, 0)]


def rigid_pair(ratio: float) -> Parts:
    """A mass of 1 kg on a spring, and one fixed to it that answers its acceleration with a force."""
    k, c = 400.0, 2.0
    C, D = [[1, 0], [0, 1], [-k, -c]], [[0], [0], [1]]
    first = LinearSlave("first", [[0, 1], [-k, -c]], [0, 1], C, D, [0.1, 0])
    return [first, LinearSlave("second", [], [], [], [[-ratio]], [])], [(0, 2, 1, 0), (1, 0, 0, 0)]


@dataclass(frozen=True)
class PairRun:
    """Rows of a run, the time first, the same in closed form, and the bond of the pair."""

    rows: np.ndarray
    exact: np.ndarray
    outline: Outline
    stepping: FixedSteps
    bonds: dict[str, Bond]

    @property
    def error(self) -> float:
        """The largest error of the first mass's position, as a part of its range."""
        return float(np.abs(self.rows[:, 1] - self.exact[:, 1]).max() / np.ptp(self.exact[:, 1]))

    def energies(self, blocks: Sequence[int] = (700,), resumed: bool = False) -> BondEnergies:
        """Hand the rows over in blocks of these lengths in turn, maybe with a new object for each."""
        bonds, place, number = self._energies(), 0, 0
        while place < len(self.rows):
            if resumed:
                memory = json.loads(json.dumps(bonds.memory()))
                bonds = self._energies()
                bonds.begin(self.outline, memory)
            length = blocks[number % len(blocks)]
            bonds.write(self.rows[place : place + length])
            place, number = place + length, number + 1
        return bonds

    def _energies(self) -> BondEnergies:
        units, algorithm = dict.fromkeys(self.outline.names), self.stepping.algorithm
        connections = list_continuous_connections(algorithm)
        return BondEnergies(self.bonds, units, connections, partial(loop_responses, algorithm))


def run_pair(
    parts: Parts,
    algorithm: str,
    step: float = 1e-3,
    stop: float = 5.0,
    extrapolation: str = "none",
    bond: tuple[int, int] | None = None,
    start: float = 0.0,
) -> PairRun:
    """Run a pair; `bond` has the positions of effort and flow among all outputs."""
    slaves, wires = parts
    network = connected(slaves, wires)
    made = ALGORITHMS[algorithm](extrapolation=extrapolation)
    made.setup(network)
    times = make_communication_points(start + stop, step, start)
    stepping = FixedSteps(made, times)
    names = network.names
    bonds = {} if bond is None else {"pair": Bond(names[bond[0]], names[bond[1]])}
    outline = Outline(names, [None] * len(names), times, range(len(names)))
    made.initialize(start, times.stop)
    rows = [np.array([start, *network.signals])]
    for k in step_by_step(made, times):
        rows.append(np.array([times.point(k + 1), *network.signals]))
    whole = Whole(slaves, wires)
    onward, states = expm(whole.M * step), [whole.x_0]
    for _ in range(times.steps):
        states.append(onward @ states[-1])
    exact = np.array([[row[0], *(whole.N @ x)] for row, x in zip(rows, states, strict=True)])
    return PairRun(np.array(rows), exact, outline, stepping, bonds)
