"""Algorithms that step instances in an order."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from ...base.option import STEPPED, option
from ..network import Network
from .algorithm import Algorithm


def _split_names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",")]


@dataclass(eq=False)
class InOrder(Algorithm):
    """Step instances in the user's order, or in one that the network derives from the connections."""

    order: Sequence[str] = option(
        [],
        help="Order in which components step, with commas between. Default: derived from the connections.",
        parse=_split_names,
        identity="order",
        commands=STEPPED,
    )

    def setup(self, network: Network) -> None:
        """Prepare for a run; CommandError if the order does not name every instance once."""
        if self.order:
            network.reorder(self.order)
        super().setup(network)

    def report(self) -> dict[str, Any]:
        """Add the order to the report."""
        return {**super().report(), "order": [self.network.instances[i].name for i in self.network.order]}
