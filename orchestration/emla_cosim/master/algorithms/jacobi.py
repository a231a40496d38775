"""Jacobi: everyone steps with the values of the last communication point."""

from .algorithm import Algorithm


class Jacobi(Algorithm):
    """All slaves get their inputs, all step, then all outputs are read.

    The order of the slaves does not matter; every connection is late by one step.
    """

    def step(self, time: float, step: float) -> None:
        """Advance all slaves from `time` by `step`, in s."""
        network = self.network
        for i in range(len(network.slaves)):
            network.pass_inputs(i)
        for slave in network.slaves:
            slave.do_step(time, step)
        for slave in network.slaves:
            slave.get_outputs()
