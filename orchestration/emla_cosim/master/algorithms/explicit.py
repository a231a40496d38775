"""Algorithms that call every slave once per step."""

from abc import abstractmethod
from dataclasses import dataclass

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

    def _step(self, time: float, step: float, span: Span) -> None:
        self.operate(time, step, span)
