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

MOST = 2**31
"""The largest step multiple."""


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

    `step_multiples` gives, by name, slaves that step more rarely: one with the multiple m waits
    until the others come to an m-th communication point, and then does m steps at once in its place
    of the table, with the inputs that it finds there. It samples at these points: nothing is late
    that would not be late with short steps, and then by a short step.
    """

    step_multiples: Mapping[str, int] = option(
        {},
        help="Let a component sample at every N-th point and do N steps at once (repeatable).",
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
            if not 1 <= multiple <= MOST:
                least = multiple < 1
                right = "at least 1" if least else f"at most {MOST}"
                raise CommandError(f"the step multiple {multiple} of {name} must be {right}.")
        self.multiples = np.array([self.step_multiples.get(n, 1) for n in names], dtype=np.int64)
        self.exchange.rare = [bool(m > 1) for m in self.multiples]
        self.operations = self.table(network)
        self._calls = [(int(o.call), o.slave, int(self.multiples[o.slave])) for o in self.operations]

    @abstractmethod
    def table(self, network: Network) -> list[Operation]:
        """The operations of one step, in order."""

    def _step(self, time: float, step: float, span: Span) -> None:
        exchange, slaves, reached = self.exchange, self.network.slaves, self.steps + 1
        for call, i, multiple in self._calls:
            if reached % multiple:
                continue
            begin, length = (time, step) if multiple == 1 else span(multiple)
            if call == _SET:
                exchange.pass_inputs(i, begin, length)
            elif call == _STEP:
                slaves[i].do_step(begin, length)
            else:
                exchange.shift(i, time + step)
                slaves[i].get_outputs()
