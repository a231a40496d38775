"""The interface of all co-simulation algorithms, and what they share."""

from abc import ABC, abstractmethod

import numpy as np

from ..errors import RunError
from .network import Network


class Algorithm(ABC):
    """Advances a network by communication steps.

    The calling order is `setup` once, `initialize` once, then `step` for each step. All may
    raise SlaveError; after that the algorithm is not used again.
    """

    network: Network

    def setup(self, network: Network) -> None:
        """Take the network to work on; nothing has been called on its slaves yet."""
        self.network = network

    def initialize(self, start_time: float, stop_time: float) -> None:
        """Bring all slaves through initialization mode; signals then hold the initial outputs.

        Values are exchanged in initialization mode until they agree, and once more after it.
        Raises RunError where they do not agree.
        """
        network = self.network
        for slave in network.slaves:
            slave.enter_initialization(start_time, stop_time)
        _exchange_until_agreed(network)
        for slave in network.slaves:
            slave.exit_initialization()
        for slave in network.slaves:
            slave.get_outputs()
        for i in network.order:
            network.pass_inputs(i)

    @abstractmethod
    def step(self, time: float, step: float) -> None:
        """Advance all slaves from `time` by `step`, in s; signals then hold the outputs at the end."""


def _exchange_until_agreed(network: Network) -> None:
    rounds = len(network.slaves) + 20
    moving: list[str] = []
    network.signals[:] = 0.0
    for _ in range(rounds):
        moving = []
        for i in network.order:
            network.pass_inputs(i)
            slave = network.slaves[i]
            old = slave.outputs.copy()
            slave.get_outputs()
            if not np.array_equal(slave.outputs, old, equal_nan=True):
                moving.append(slave.name)
        if not moving:
            return
    raise RunError(
        f"the initial values do not settle in {rounds} exchanges; outputs still change in "
        f"{', '.join(moving)}. Break the loop of direct feedthrough between them."
    )
