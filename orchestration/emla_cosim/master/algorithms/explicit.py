"""Algorithms that call every slave once per step."""

from abc import abstractmethod
from dataclasses import dataclass

from ...errors import listed
from ..network import Network
from .algorithm import Span
from .sampling import Operation, Sampling


@dataclass(eq=False)
class Explicit(Sampling):
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
        """That components answer each other at once, which this algorithm hands on a step late."""
        loops = [group for group in self.network.groups(lambda link: link.direct) if len(group) > 1]
        if not loops:
            return None
        names = [self.network.slaves[i].name for i in loops[0]]
        return (
            f"Outputs of {listed(names)} depend on each other without delay, and this algorithm hands some of "
            "them on a step late: where a round through such a loop amplifies (its spectral radius is more "
            "than 1, as where a force answers an acceleration of less mass), that diverges at any step size. "
            "The algorithm strong makes them agree."
        )

    def _step(self, time: float, step: float, span: Span) -> None:
        self.operate(time, step, span)
