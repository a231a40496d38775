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
"""Where so many communication steps up to the end of the present one begin, and their length, in s."""


@dataclass(eq=False)
class Algorithm(ABC):
    """Advances a network by communication steps.

    Its fields are its options; `setup` begins everything else anew, so that one can serve many runs.

    The calling order is `setup` once, `initialize` once, then `step` for each step. All may
    raise InstanceError; after that the algorithm is not used again, except that a step which raised
    StepDiscardedError may be tried anew from a snapshot.
    """

    extrapolation: str = option(
        "none",
        help="How inputs go on during a step: held, extrapolated by us, or by the FMU itself.",
        choices=lambda: EXTRAPOLATIONS,
        identity="extrapolation",
    )

    network: Network = field(init=False, repr=False)
    exchange: Exchange = field(init=False, repr=False)
    steps: int = field(init=False, repr=False)
    """Steps done since `setup`."""

    def setup(self, network: Network) -> None:
        """Take the network to work on; nothing has been called on its slaves yet.

        Raises CommandError where a slave lacks an ability that the algorithm needs.
        """
        for own in options_of(type(self)):
            own.check(getattr(self, own.name))
        self.network = network
        self.exchange = Exchange(network, self.extrapolation)
        self.steps = 0

    def initialize(self, start_time: float, stop_time: float | None) -> None:
        """Bring all slaves through initialization mode; signals then hold the initial outputs.

        Without a stop time slaves have to be ready for steps without end.
        """
        initialize(self.network, start_time, stop_time)
        self.exchange.begin(start_time)

    def step(self, time: float, step: float, span: Span | None = None) -> None:
        """Advance all slaves from `time` by `step`, in s; signals then hold the outputs at the end.

        `span` knows the steps that some slaves do at once, whose lengths rounding may make differ
        from multiples of `step`.
        """
        self._step(time, step, span or (lambda count: (time - (count - 1) * step, count * step)))
        self.steps += 1

    @abstractmethod
    def late(self) -> list[Link]:
        """Links whose target sees its source one step late, or extrapolated."""

    def warning(self) -> str | None:
        """A sentence on why a run may have failed that is the algorithm's doing; None where it is not."""
        return None

    def report(self) -> dict[str, Any]:
        """How the steps are made, as plain data for run.json."""
        return {"late_connections": [link.name for link in self.late()]}

    def memory(self) -> dict[str, Vector]:
        """What the algorithm remembers besides the signals, as arrays by name; see `remember`."""
        return self.kept | {"steps": np.array([float(self.steps)])}

    def remember(self, memory: Mapping[str, Vector]) -> None:
        """Take over what an algorithm of the same kind remembered."""
        self.steps = int(memory["steps"][0])
        for name, present in self.kept.items():
            present[:] = memory[name]

    def close(self) -> None:  # noqa: B027 - most hold nothing
        """Free what the algorithm holds of the slaves; never raises."""

    @abstractmethod
    def _step(self, time: float, step: float, span: Span) -> None:
        """One step."""

    @property
    def accuracy(self) -> int:
        """Order of accuracy in the step size, of states in smooth motion."""
        return self.exchange.accuracy

    @property
    def kept(self) -> dict[str, Vector]:
        """The arrays, by name, that go back with a snapshot; they are changed in place."""
        return vars(self.exchange.history)


def require(slaves: Sequence[FmuInstance], ability: str, flag: str, purpose: str) -> None:
    """Raise CommandError unless all slaves have an ability; `flag` is its name in the FMI."""
    lacking = [slave.name for slave in slaves if not getattr(slave, ability)]
    if lacking:
        raise CommandError(f"{purpose} needs FMUs with {flag}; {', '.join(lacking)} cannot do it.")
