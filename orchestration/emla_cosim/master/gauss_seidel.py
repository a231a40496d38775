"""Gauss-Seidel: one after the other, each with the newest values there are."""

from .algorithm import initialize_network
from .network import Network


class GaussSeidel:
    """Slaves step in the network's order; who comes later reads what earlier ones just computed.

    Only connections against the order are late by one step.
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
        for i in network.order:
            slave = network.slaves[i]
            network.pass_inputs(i)
            slave.do_step(time, step)
            slave.get_outputs()
