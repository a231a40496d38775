"""Gauss-Seidel: one after the other, each with the newest values there are."""

from dataclasses import dataclass

from ..network import Link, Network
from .explicit import Explicit
from .in_order import InOrder
from .tasks import Call, Operation


@dataclass(eq=False)
class GaussSeidel(InOrder, Explicit):
    """Slaves step in the network's order; who comes later reads what earlier ones just computed.

    Only connections against the order are late by one step; see `Network.find_feedback_links`.
    """

    def table(self, network: Network) -> list[Operation]:
        """Inputs, step and outputs of one slave, then of the next."""
        return [Operation(call, i) for i in network.order for call in Call]

    def late(self) -> list[Link]:
        """Those against the order."""
        return self.network.find_feedback_links()
