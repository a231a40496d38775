"""The interface of all co-simulation algorithms."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from ...base.arrays import Vector
from ...base.errors import CommandError
from ...base.option import STEPPED, option, options_of
from ..instances.fmu_instance import FmuInstance
from ..network import Link, Network
from .extrapolation import EXTRAPOLATIONS, Exchange
from .initialization import initialize


@dataclass(eq=False)
class Algorithm(ABC):
    """Base class of co-simulation algorithms: advances a network by communication steps.

    Fields made with `option` are options of the algorithm. The master calls `setup` and `initialize` once for
    each run. Both may raise RunError; the algorithm is then not used any more.

    Args:
        extrapolation: values of inputs during a step: none (held), or extrapolated by the master or the FMU.

    Attributes:
        network: FMU instances and signals, since `setup`.
        exchange: how inputs get their values, since `setup`.
        steps: number of steps since `setup`.
    """

    extrapolation: str = option(
        "none",
        help="Inputs during a step: held (none), extrapolated by the master, or extrapolated by the FMU.",
        choices=lambda: EXTRAPOLATIONS,
        identity="extrapolation",
        commands=STEPPED,
    )

    network: Network = field(init=False, repr=False)
    exchange: Exchange = field(init=False, repr=False)
    steps: int = field(init=False, repr=False)
    """Steps done since `setup`."""

    def setup(self, network: Network) -> None:
        """Prepare for a run.

        Args:
            network: FMU instances that have not been initialized yet.

        Raises:
            CommandError: an FMU lacks an ability that the algorithm needs.
        """
        for own in options_of(type(self)):
            own.check(getattr(self, own.name))
        self.network = network
        self.exchange = Exchange(network, self.extrapolation)
        self.steps = 0

    def initialize(self, start_time: float, stop_time: float | None) -> None:
        """Initialize all FMU instances; the signals then have their initial values.

        Args:
            start_time: in s.
            stop_time: in s; None for a run without a fixed end.
        """
        initialize(self.network, start_time, stop_time)
        self.exchange.begin(start_time)

    @abstractmethod
    def late(self) -> list[Link]:
        """Return the links whose target gets values of its source one step late, or extrapolated."""

    def warning(self) -> str | None:
        """Return why the algorithm may have caused a failure; None if it did not."""
        return None

    def report(self) -> dict[str, Any]:
        """Return how the steps are made, as plain data for run.json."""
        together = [list(s.components) for s in self.network.instances if len(s.components) > 1]
        report: dict[str, Any] = {"late_connections": [link.name for link in self.late()]}
        return report | ({"integrated_together": together} if together else {})

    @abstractmethod
    def memory(self) -> dict[str, Vector]:
        """Return what steps have changed, as arrays by name."""

    @abstractmethod
    def remember(self, memory: Mapping[str, Vector]) -> None:
        """Continue from what `memory` returned in an algorithm of the same class."""

    def close(self) -> None:  # noqa: B027 - most hold nothing
        """Free what the algorithm holds of the FMU instances; never raises."""

    @property
    def accuracy(self) -> int:
        """Order of accuracy in the step size, for states in smooth motion."""
        return self.exchange.accuracy


def require(instances: Sequence[FmuInstance], ability: str, flag: str, purpose: str) -> None:
    """Raise CommandError if an instance lacks a capability.

    Args:
        instances: The instances to check.
        ability: Attribute of `FmuInstance` that says whether it has the capability.
        flag: Name of the capability in FMI.
        purpose: What needs the capability, for the error message.
    """
    lacking = [instance.name for instance in instances if not getattr(instance, ability)]
    if lacking:
        raise CommandError(f"{purpose} needs FMUs with {flag}; {', '.join(lacking)} cannot do it.")
