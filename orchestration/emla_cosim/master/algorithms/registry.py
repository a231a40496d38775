"""The co-simulation algorithms: explicit ones, strong coupling, and their registry."""

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

from ...base.errors import join_names
from ...base.option import STEPPED, option
from ..network import Link, Network
from .algorithm import Algorithm, InOrder
from .program import Call, Instruction, Operation, Solve


@dataclass(eq=False)
class Strong(InOrder):
    """Algorithm in which each FMU steps with the values of its sources at the end of the step.

    FMUs outside of loops step once, in the order of the connections. The FMUs of a loop repeat their step,
    with quasi-Newton acceleration, until no exchanged value changes by more than `coupling_tolerance` of its
    size. A step that an FMU discards, or that finds no agreement, is done in halves.

    A component in `step_multiples`, also with 1, is sampled as a digital controller is: it steps after all
    loops have agreed, with the values at the end of the step. During the step, the others see its earlier
    outputs, so that no loop goes through it.

    Args:
        extrapolation: as for `Algorithm`.
        step_multiples: number of communication steps that a component does at once, by name.
        order: names of all components in the order of their steps. Default: derived from the connections.
        coupling_tolerance: difference at which values count as agreed, relative to the size of each signal.

    Attributes:
        sweeps: number of times that a loop was stepped.

    Examples:
        >>> import emla_cosim as ec
        >>> simulation = ec.load("lift", stop_time=0.01).prepare()
        >>> simulation.run(algorithm=ec.Strong(coupling_tolerance=1e-6)).steps
        100
    """

    coupling_tolerance: float = option(  # pyright: ignore[reportIncompatibleVariableOverride]
        1e-8,
        help="Convergence of algebraic loops: the largest difference of a value, as a fraction of its "
        "signal's size.",
        above=0.0,
        below=1.0,
        identity="coupling tolerance",
        commands=STEPPED,
    )

    def setup(self, network: Network) -> None:
        """Prepare for a run.

        Raises:
            CommandError: an FMU of a loop cannot restore its state, or step multiples do not fit.
        """
        super().setup(network)
        self._sampled = self._find_sampled_instances()
        if self._sampled:
            # they sample after all loops have agreed on the values of a point
            network.hold_back(self._sampled, bool(self.order))
        self.exchange.mark_sampled(self._sampled)
        groups = network.groups(lambda link: link.source not in self._sampled)
        loops = [Solve(group) for group in groups if group[0] not in self._sampled]
        self.use(
            [*loops, *(Operation(call, i) for i in network.order if i in self._sampled for call in Call)]
        )

    def _find_sampled_instances(self) -> set[int]:
        """Return the positions of instances with a step multiple, and of the followers of their outputs."""
        network = self.network
        sampled = {i for i, instance in enumerate(network.instances) if instance.name in self.step_multiples}
        for _ in network.followers:  # one may follow another
            links = [link for link in network.links if link.target in network.followers]
            sampled |= {link.target for link in links if link.source in sampled}
        return sampled

    def late(self) -> list[Link]:
        """Return the links from sampled components to others, and against the order of the sampled."""
        return [link for link in self.network.find_feedback_links() if link.source in self._sampled]


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


ALGORITHMS: dict[str, type[Algorithm]] = {"jacobi": Jacobi, "gauss-seidel": GaussSeidel, "strong": Strong}
"""Algorithms by name. Add a class to select it by its name in Python, in files and on the command line."""
