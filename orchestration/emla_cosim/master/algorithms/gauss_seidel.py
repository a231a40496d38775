"""Gauss-Seidel: one after the other, each with the newest values there are."""

from .algorithm import Algorithm


class GaussSeidel(Algorithm):
    """Slaves step in the network's order; who comes later reads what earlier ones just computed.

    Only connections against the order are late by one step.
    """

    def step(self, time: float, step: float) -> None:
        """Advance all slaves from `time` by `step`, in s."""
        network = self.network
        for i in network.order:
            slave = network.slaves[i]
            network.pass_inputs(i)
            slave.do_step(time, step)
            slave.get_outputs()
