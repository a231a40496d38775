"""A network stepped to the end, with everything recorded in one array."""

from collections.abc import Callable, Iterator

import numpy as np

from emla_cosim.master.algorithms.algorithm import Algorithm
from emla_cosim.master.network import Network
from emla_cosim.master.run_loop import simulate
from emla_cosim.master.stepping.step_size_control import FixedSteps
from emla_cosim.master.stepping.stepping_base import Stepping
from emla_cosim.master.stepping.timing import CommunicationPoints


class Table:
    """Rows that are all kept; the room for new ones is small, so that blocks end often."""

    def __init__(self, width: int, steps_per_row: int = 1, room: int = 7) -> None:
        self.steps_per_row = steps_per_row
        self._block = np.empty((room, width))
        self._blocks: list[np.ndarray] = [np.empty((0, width))]

    def room(self, most: int) -> np.ndarray:
        return self._block[:most]

    def commit(self, count: int) -> None:
        self._blocks.append(self._block[:count].copy())

    @property
    def rows(self) -> np.ndarray:
        return np.vstack(self._blocks)


def begun(network: Network, algorithm: Algorithm, times: CommunicationPoints) -> Algorithm:
    """The algorithm, set up on the network and initialized."""
    algorithm.setup(network)
    algorithm.initialize(times.start, times.stop)
    return algorithm


def step_by_step(algorithm: Algorithm, times: CommunicationPoints) -> Iterator[int]:
    """Do the steps one by one, from where the algorithm is; yields the number of each after it."""
    stepping, table = FixedSteps(algorithm, times), Table(1 + len(algorithm.network.signals))
    try:
        while not stepping.finished:
            stepping.advance(table, 1)
            yield stepping.steps - 1
    finally:
        stepping.close()


def recorded(
    stepping: Stepping, steps_per_row: int = 1, interrupted: Callable[[], bool] = lambda: False, room: int = 7
) -> np.ndarray:
    """All rows from where the stepping is to where it ends, time first."""
    table = Table(1 + len(stepping.algorithm.network.signals), steps_per_row, room)
    stepping.record(table)
    try:
        simulate(stepping, table, interrupted)
    finally:
        stepping.close()
        stepping.algorithm.close()
    return table.rows


def simulated(
    network: Network, algorithm: Algorithm, times: CommunicationPoints, steps_per_row: int = 1
) -> np.ndarray:
    """All rows of a run in fixed steps, time first."""
    return recorded(FixedSteps(begun(network, algorithm, times), times), steps_per_row)
