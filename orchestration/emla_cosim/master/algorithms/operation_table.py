"""Slaves that step more rarely than others: tables of operations, run here or compiled."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ...base.errors import CommandError
from ...base.option import option
from ..network import Network
from .algorithm import Algorithm, Span
from .overlapped_steps import OverlappedSteps
from .tasks import Call, Operation, StepTask, perform, plan_tasks

MOST = 2**31
"""The largest step multiple."""


@dataclass(eq=False)
class OperationTableAlgorithm(Algorithm):
    """Algorithms in which a table of operations says who is called once per step, or more rarely.

    `step_multiples` gives, by name, slaves that step more rarely: one with the multiple m waits
    until the others come to an m-th communication point, and then does m steps at once in its place
    of the table, with the inputs that it finds there. It samples at these points: nothing is late
    that would not be late with short steps, and then by a short step.
    """

    step_multiples: Mapping[str, int] = option(
        {},
        help="Let a component run N times slower: it takes its inputs every N-th step (repeatable).",
        flag="--step-multiple",
        metavar="COMPONENT=N",
        identity="step multiples",
    )

    operations: list[Operation] = field(init=False, repr=False)

    def setup(self, network: Network) -> None:
        """Take the network; CommandError where multiples make no sense."""
        super().setup(network)
        names = [s.name for s in network.instances]
        for name, multiple in self.step_multiples.items():
            if name not in names:
                raise CommandError(f"there is no component '{name}' to step more rarely.")
            if not 1 <= multiple <= MOST:
                least = multiple < 1
                right = "at least 1" if least else f"at most {MOST}"
                raise CommandError(f"the step multiple {multiple} of {name} must be {right}.")
        self.multiples = np.array([self.step_multiples.get(n, 1) for n in names], dtype=np.int64)

    def use(self, operations: Sequence[Operation]) -> None:
        """Work through these operations, in order; part of `setup`."""
        self.operations = list(operations)
        self._calls = [(int(o.call), o.slave, int(self.multiples[o.slave])) for o in operations]
        apart = sum(self.network.instances[o.slave].steps_apart for o in operations if o.call == Call.STEP)
        self._apart = OverlappedSteps(self.exchange, self.operations, self.multiples) if apart > 1 else None

    def tasks(self) -> list[StepTask]:
        """What a step consists of, so that several threads can share it."""
        return plan_tasks(self.exchange, self.operations)

    def operate(self, time: float, step: float, span: Span) -> None:
        """Work through the table in the step from `time` of length `step`, both in s."""
        if self._apart is not None:
            self._apart.operate(time, step, span, self.steps + 1)
            return
        reached = self.steps + 1
        for call, i, multiple in self._calls:
            if reached % multiple == 0:
                begin, length = (time, step) if multiple == 1 else span(multiple)
                perform(self.exchange, call, i, begin, length, time + step)
