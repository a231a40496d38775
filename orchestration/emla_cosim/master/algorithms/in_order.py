"""Algorithms for which it matters who comes first."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ...base.option import option
from ..network import Network
from .algorithm import Algorithm


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",")]


@dataclass(eq=False)
class InOrder(Algorithm):
    """Goes through the slaves in an order: the user's, or the one that the network finds good."""

    order: Sequence[str] = option(
        [],
        help="Order in which components step, with commas between. Default: derived from the connections.",
        parse=_names,
        identity="order",
    )

    def setup(self, network: Network) -> None:
        """Take the network; CommandError where the order does not name every slave once."""
        if self.order:
            network.reorder(self.order)
        super().setup(network)

    def report(self) -> dict[str, Any]:
        """Also the order."""
        return {**super().report(), "order": [self.network.instances[i].name for i in self.network.order]}
