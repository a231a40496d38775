"""Gauss-Seidel: instances step one after the other, each with the newest values."""

from dataclasses import dataclass

from ..network import Link, Network
from .explicit import Explicit
from .in_order import InOrder
from .program import Call, Operation


@dataclass(eq=False)
class GaussSeidel(InOrder, Explicit):
    """Algorithm in which FMUs step one after the other and read what earlier ones just computed.

    Only connections against the order are late by one step.

    Args:
        extrapolation: as for `Algorithm`.
        step_multiples: number of communication steps that a component does at once, by name.
        order: names of all components in the order of their steps. Default: derived from the connections.
    """

    def table(self, network: Network) -> list[Operation]:
        """Return inputs, step and outputs of one FMU, then of the next."""
        return [Operation(call, i) for i in network.order for call in Call]

    def late(self) -> list[Link]:
        """Return the links against the order."""
        return self.network.find_feedback_links()
