"""Jacobi: every instance steps with the values of the last communication point."""

from dataclasses import dataclass

from ..network import Link, Network
from .explicit import Explicit
from .program import Call, Operation


@dataclass(eq=False)
class Jacobi(Explicit):
    """Algorithm in which all FMUs get their inputs, then all step, then all outputs are read.

    The order of the FMUs does not matter. Each connection is late by one step.
    """

    def table(self, network: Network) -> list[Operation]:
        """Return all inputs, all steps, then all outputs."""
        return [Operation(call, i) for call in Call for i in range(len(network.instances))]

    def late(self) -> list[Link]:
        """Return all links."""
        return self.network.links
