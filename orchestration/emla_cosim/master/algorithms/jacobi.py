"""Jacobi: everyone steps with the values of the last communication point."""

from dataclasses import dataclass

from ..network import Link, Network
from .explicit import Explicit
from .tasks import Call, Operation


@dataclass(eq=False)
class Jacobi(Explicit):
    """All slaves get their inputs, all step, then all outputs are read.

    The order of the slaves does not matter; every connection is late by one step.
    """

    def table(self, network: Network) -> list[Operation]:
        """All inputs, all steps, all outputs."""
        return [Operation(call, i) for call in Call for i in range(len(network.instances))]

    def late(self) -> list[Link]:
        """All of them."""
        return self.network.links
