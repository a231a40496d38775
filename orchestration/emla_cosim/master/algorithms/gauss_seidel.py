"""Gauss-Seidel: instances step one after the other, each with the newest values."""

from dataclasses import dataclass

from ..network import Link, Network
from .explicit import Explicit
from .in_order import InOrder
from .tasks import Call, Operation


@dataclass(eq=False)
class GaussSeidel(InOrder, Explicit):
    """Step the instances in the order of the network; later ones read the new outputs of earlier ones.

    Only connections against the order are one step late; see `Network.find_feedback_links`.
    """

    def table(self, network: Network) -> list[Operation]:
        """Return the operations: inputs, step and outputs of one instance, then of the next."""
        return [Operation(call, i) for i in network.order for call in Call]

    def late(self) -> list[Link]:
        """Return the links against the order."""
        return self.network.find_feedback_links()
