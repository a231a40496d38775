"""Jacobi: every instance steps with the values of the last communication point."""

from dataclasses import dataclass

from ..network import Link, Network
from .explicit import Explicit
from .tasks import Call, Operation


@dataclass(eq=False)
class Jacobi(Explicit):
    """Set all inputs, step all instances, then read all outputs.

    The order of the instances does not matter; every connection is one step late.
    """

    def table(self, network: Network) -> list[Operation]:
        """Return the operations: all inputs, all steps, all outputs."""
        return [Operation(call, i) for call in Call for i in range(len(network.instances))]

    def late(self) -> list[Link]:
        """Return all links."""
        return self.network.links
