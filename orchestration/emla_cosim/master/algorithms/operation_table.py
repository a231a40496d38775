"""Algorithms that work through a table of operations, with instances that step more rarely."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ...base.errors import CommandError
from ...base.option import STEPPED, option
from ..network import Network
from .algorithm import Algorithm, Span
from .overlapped_steps import OverlappedSteps
from .tasks import Call, Operation, Perform, StepTask, perform, plan_tasks

MOST = 2**31
"""The largest step multiple."""


@dataclass(eq=False)
class OperationTableAlgorithm(Algorithm):
    """Work through a table of operations: each instance is called once per step, or more rarely.

    An instance with the step multiple m waits until the others reach every m-th communication point. Then
    it does m steps at once, in its place of the table, with the inputs of that moment. It samples at these
    points: the same connections are late as with short steps, and only by a short step.
    """

    step_multiples: Mapping[str, int] = option(
        {},
        help="Let a component run N times slower: it takes its inputs every N-th step (repeatable).",
        flag="--step-multiple",
        metavar="COMPONENT=N",
        identity="step multiples",
        commands=STEPPED,
    )

    operations: list[Operation] = field(init=False, repr=False)

    def setup(self, network: Network) -> None:
        """Prepare for a run; CommandError if a step multiple is invalid."""
        super().setup(network)
        names = [s.name for s in network.instances]
        for name, multiple in self.step_multiples.items():
            group = next((i for i in network.instances if name in i.components), None)
            if group is not None and len(group.components) > 1:
                raise CommandError(
                    f"{name} cannot have a step multiple: it is integrated together with other components. "
                    "Add --no-together."
                )
            if name not in names:
                raise CommandError(f"there is no component '{name}' for a step multiple.")
            if not 1 <= multiple <= MOST:
                least = multiple < 1
                right = "at least 1" if least else f"at most {MOST}"
                raise CommandError(f"the step multiple {multiple} of {name} must be {right}.")
        self.multiples = np.array([self.step_multiples.get(n, 1) for n in names], dtype=np.int64)

    def use(self, operations: Sequence[Operation]) -> None:
        """Use this table of operations, in order; call it in `setup`."""
        self.operations = list(operations)
        self._calls = [(int(o.call), o.instance, int(self.multiples[o.instance])) for o in operations]
        self._apart = self._overlapped(self.operations)

    def _overlapped(
        self, operations: Sequence[Operation], perform: Perform = perform
    ) -> OverlappedSteps | None:
        """Return what overlaps the steps of a table; None if it has less than two that can overlap."""
        apart = sum(self.network.instances[o.instance].steps_apart for o in operations if o.call == Call.STEP)
        return OverlappedSteps(self.exchange, operations, self.multiples, perform) if apart > 1 else None

    def tasks(self) -> list[StepTask]:
        """Return the tasks of a step, which several threads can share."""
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
