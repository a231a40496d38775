"""Algorithms that call every instance once per step."""

from abc import abstractmethod
from dataclasses import dataclass

from ...base.errors import join_names
from ..network import Network
from .algorithm import Span
from .operation_table import OperationTableAlgorithm
from .tasks import Operation


@dataclass(eq=False)
class Explicit(OperationTableAlgorithm):
    """Work through a table of operations in every step."""

    def setup(self, network: Network) -> None:
        """Prepare for a run; CommandError if a step multiple is invalid."""
        super().setup(network)
        self.exchange.rare = [bool(m > 1) for m in self.multiples]
        self.use(self.table(network))

    @abstractmethod
    def table(self, network: Network) -> list[Operation]:
        """Return the operations of one step, in order."""

    def warning(self) -> str | None:
        """Return a warning if the network has an algebraic loop, which can diverge here."""
        loops = self.network.loops_without_delay()
        if not loops:
            return None
        return (
            f"{join_names(loops[0])} depend on each other without delay, but this algorithm passes some of "
            "them on one step late. If the loop amplifies (spectral radius above 1, for example a load with "
            "more mass than its drive), the run diverges at any step size. Use the algorithm strong, which "
            "iterates the loop."
        )

    def _step(self, time: float, step: float, span: Span) -> None:
        self.operate(time, step, span)
