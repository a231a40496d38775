"""Jacobi: everyone steps with the values of the last communication point."""

from .algorithm import initialize_network
from .network import Network


class Jacobi:
    """All slaves get their inputs, all step, then all outputs are read.

    The order of the slaves does not matter; every connection is late by one step.
    """

    def setup(self, network: Network) -> None:
        """Take the network to work on."""
        self._network = network

    def initialize(self, start_time: float, stop_time: float) -> None:
        """Bring all slaves through initialization mode."""
        initialize_network(self._network, start_time, stop_time)

    def step(self, time: float, step: float) -> None:
        """Advance all slaves from `time` by `step`, in s."""
        network = self._network
        for i in range(len(network.slaves)):
            network.pass_inputs(i)
        for slave in network.slaves:
            slave.do_step(time, step)
        for slave in network.slaves:
            slave.get_outputs()
