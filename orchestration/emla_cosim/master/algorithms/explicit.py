"""Algorithms that call instances one after the other."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

from ...base.errors import join_names
from ..network import Link, Network
from .algorithm import Algorithm, InOrder
from .program import Call, Instruction, Operation


@dataclass(eq=False)
class Explicit(Algorithm):
    """Base class of algorithms with a program of your own.

    Examples:
        >>> import emla_cosim as ec
        >>> class Backwards(ec.Explicit):
        ...     def table(self, network):
        ...         positions = reversed(range(len(network.instances)))
        ...         return [ec.Operation(call, i) for i in positions for call in ec.Call]
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
        self.use(self.table(network))
        self.exchange.rare = [bool(m > 1) for m in self.multiples]

    @abstractmethod
    def table(self, network: Network) -> Sequence[Instruction]:
        """Return the program of one step: calls of instances and other instructions, in order."""

    def warning(self) -> str | None:
        """Return a warning if components in a loop without delay get values one step late."""
        loops = [] if self.loops else self.network.loops_without_delay()
        if not loops:
            return None
        return (
            f"{join_names(loops[0])} depend on each other without delay, but this algorithm passes some of "
            "them on one step late. If the loop amplifies (spectral radius above 1, for example a load with "
            "more mass than its drive), the run diverges at any step size. Use the algorithm strong, which "
            "iterates the loop."
        )


@dataclass(eq=False)
class Jacobi(Explicit):
    """Algorithm in which all FMUs get their inputs, then all step, then all outputs are read.

    The order of the FMUs does not matter. Each connection is late by one step.
    """

    def table(self, network: Network) -> list[Operation]:
        """Return all inputs, all steps, then all outputs."""
        return [Operation(call, i) for call in Call for i in range(len(network.instances))]

    def late(self) -> list[Link]:
        """Return all links."""
        return self.network.links


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
