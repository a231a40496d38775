"""Algorithms that call every slave once per step."""

from abc import abstractmethod
from dataclasses import dataclass

from ...base.errors import join_names
from ..network import Network
from .algorithm import Span
from .operation_table import OperationTableAlgorithm
from .tasks import Operation


@dataclass(eq=False)
class Explicit(OperationTableAlgorithm):
    """Works through a table of operations in every step."""

    def setup(self, network: Network) -> None:
        """Take the network; CommandError where multiples make no sense."""
        super().setup(network)
        self.exchange.rare = [bool(m > 1) for m in self.multiples]
        self.use(self.table(network))

    @abstractmethod
    def table(self, network: Network) -> list[Operation]:
        """The operations of one step, in order."""

    def warning(self) -> str | None:
        """That signals answer each other at once, some of which this algorithm hands on a step late."""
        loops = self.network.loops_without_delay()
        if not loops:
            return None
        return (
            f"{join_names(loops[0])} depend on each other without delay, but here some are a step late: "
            "where a "
            "round through such a loop amplifies (a spectral radius of more than 1, as of a load with more "
            "mass than what drives it), that diverges at any step size. Use the algorithm strong, which lets "
            "them agree."
        )

    def _step(self, time: float, step: float, span: Span) -> None:
        self.operate(time, step, span)
