"""The interface of all co-simulation algorithms."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ...base.arrays import Vector
from ...base.errors import CommandError
from ...base.option import option, options_of
from ..instances.fmu_instance import FmuInstance
from ..network import Link, Network
from .extrapolation import EXTRAPOLATIONS, Exchange
from .initialization import initialize

Span = Callable[[int], tuple[float, float]]
"""Maps a number of steps, counted back from the end of the present one, to their begin and length in s."""


@dataclass(eq=False)
class Algorithm(ABC):
    """Advance a network by communication steps.

    The fields are options. Call `setup` once, `initialize` once, then `step` for each step. `setup` resets
    everything else, so that one algorithm can serve many runs.

    All three may raise InstanceError. Then call `setup` before you use the algorithm again. After
    DiscardedStepError you can also restore a snapshot and try another step.
    """

    extrapolation: str = option(
        "none",
        help="Inputs during a step: held (none), extrapolated by the master, or extrapolated by the FMU.",
        choices=lambda: EXTRAPOLATIONS,
        identity="extrapolation",
    )

    network: Network = field(init=False, repr=False)
    exchange: Exchange = field(init=False, repr=False)
    steps: int = field(init=False, repr=False)
    """Steps done since `setup`."""

    def setup(self, network: Network) -> None:
        """Prepare for a run.

        Args:
            network: Its instances are instantiated but not initialized.

        Raises:
            CommandError: An instance lacks a capability that the algorithm needs.
        """
        for own in options_of(type(self)):
            own.check(getattr(self, own.name))
        self.network = network
        self.exchange = Exchange(network, self.extrapolation)
        self.steps = 0

    def initialize(self, start_time: float, stop_time: float | None) -> None:
        """Initialize all instances; signals then hold the initial outputs.

        Args:
            start_time: In s.
            stop_time: In s; None if the run has no fixed end.
        """
        initialize(self.network, start_time, stop_time)
        self.exchange.begin(start_time)

    def step(self, time: float, step: float, span: Span | None = None) -> None:
        """Advance all instances; signals then hold the outputs at the end of the step.

        Args:
            time: Where the step begins, in s.
            step: Its length in s.
            span: Begin and length of several steps at once, for instances with a step multiple. Rounding can
                make this length differ from a multiple of `step`.
        """
        self._step(time, step, span or (lambda count: (time - (count - 1) * step, count * step)))
        self.steps += 1

    @abstractmethod
    def late(self) -> list[Link]:
        """Return the links whose target reads its source one step late, or extrapolated."""

    def warning(self) -> str | None:
        """Return a warning that explains how the algorithm may have made a run fail; None without one."""
        return None

    def report(self) -> dict[str, Any]:
        """Return how the steps were done, as plain data for run.json."""
        return {"late_connections": [link.name for link in self.late()]}

    def memory(self) -> dict[str, Vector]:
        """Return the state of the algorithm without the signals, as arrays by name; see `remember`."""
        return self.kept | {"steps": np.array([float(self.steps)])}

    def remember(self, memory: Mapping[str, Vector]) -> None:
        """Restore the state from `memory` of an algorithm of the same class."""
        self.steps = int(memory["steps"][0])
        for name, present in self.kept.items():
            present[:] = memory[name]

    def close(self) -> None:  # noqa: B027 - most algorithms hold no resources
        """Free saved FMU states; never raises."""

    @abstractmethod
    def _step(self, time: float, step: float, span: Span) -> None:
        """Do one step."""

    @property
    def accuracy(self) -> int:
        """Order of accuracy of states with respect to the step size, in smooth motion."""
        return self.exchange.accuracy

    @property
    def kept(self) -> dict[str, Vector]:
        """Arrays by name that a snapshot copies and restores; the algorithm changes them in place."""
        return vars(self.exchange.history)


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
