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
    """Base class of algorithms that work through a table of calls in each step.

    Examples:
        >>> import emla_cosim as ec
        >>> class Backwards(ec.Explicit):
        ...     def table(self, network):
        ...         places = reversed(range(len(network.instances)))
        ...         return [ec.Operation(call, i) for i in places for call in ec.Call]
        ...
        ...     def late(self):
        ...         return [link for link in self.network.links if link.source <= link.target]
        >>> result = ec.load("lift", stop_time=0.01).prepare().run(algorithm=Backwards())
        >>> result.steps
        100
    """

    def setup(self, network: Network) -> None:
        """Prepare for a run; raise CommandError if step multiples do not fit."""
        super().setup(network)
        self.exchange.rare = [bool(m > 1) for m in self.multiples]
        self.use(self.table(network))

    @abstractmethod
    def table(self, network: Network) -> list[Operation]:
        """Return the calls of one step, in order."""

    def warning(self) -> str | None:
        """Return a warning if components in a loop without delay get values one step late."""
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
