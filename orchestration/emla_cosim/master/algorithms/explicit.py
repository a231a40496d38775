"""Algorithms that call every slave once per step: tables of operations, run here or compiled."""

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from ...errors import CommandError
from ...option import option
from ..network import Network
from .algorithm import Algorithm, Span


class Call(IntEnum):
    """What is done with a slave."""

    SET = 0
    STEP = 1
    GET = 2


_SET, _STEP, _GET = (int(call) for call in Call)  # comparing numbers is cheaper in the loop


@dataclass(frozen=True)
class Operation:
    """One call on the slave at this position."""

    call: Call
    slave: int


@dataclass(eq=False)
class Explicit(Algorithm):
    """Works through a table of operations in every step.

    `step_multiples` gives, by name, slaves that step more rarely: one with the multiple m gets its
    inputs and does a step of m communication steps at every m-th of them; the others see its new
    outputs when they have reached the same time.
    """

    step_multiples: Mapping[str, int] = option(
        {},
        help="Step a component at every N-th step (repeatable).",
        flag="--step-multiple",
        metavar="COMPONENT=N",
        identity="step multiples",
    )

    operations: list[Operation] = field(init=False, repr=False)

    def setup(self, network: Network) -> None:
        """Take the network; CommandError where multiples make no sense."""
        super().setup(network)
        names = [s.name for s in network.slaves]
        for name, multiple in self.step_multiples.items():
            if name not in names:
                raise CommandError(f"there is no component '{name}' to step more rarely.")
            if multiple < 1:
                raise CommandError(f"the step multiple {multiple} of {name} must be at least 1.")
        self.multiples = np.array([self.step_multiples.get(n, 1) for n in names], dtype=np.int64)
        self.operations = self.table(network)
        self._calls = [(int(o.call), o.slave, int(self.multiples[o.slave])) for o in self.operations]

    @abstractmethod
    def table(self, network: Network) -> list[Operation]:
        """The operations of one step, in order."""

    def _step(self, time: float, step: float, span: Span) -> None:
        exchange, slaves, done = self.exchange, self.network.slaves, self.steps
        for call, i, multiple in self._calls:
            if (done + 1 if call == _GET else done) % multiple:
                continue
            if call == _SET:
                exchange.pass_inputs(i, time, step if multiple == 1 else span(multiple))
            elif call == _STEP:
                slaves[i].do_step(time, step if multiple == 1 else span(multiple))
            else:
                exchange.shift(i, time + step)
                slaves[i].get_outputs()
