"""Overlap the steps of instances in other processes."""

from collections import deque
from collections.abc import Sequence
from heapq import heapify, heappop, heappush

from ...base.arrays import Indices
from .algorithm import Span
from .extrapolation import Exchange
from .program import Call, Operation
from .tasks import Perform, perform, plan_tasks


class OverlappedSteps:
    """Work through a table of operations with the result of its order, but let steps overlap.

    A step in another process begins as soon as its inputs are ready. It is awaited when nothing else can be
    done. All running steps end before the first failure, in the order of the table, is raised.

    Args:
        exchange: The values of the instances.
        operations: The table.
        multiples: Step multiples by instance.
        perform: Does one operation.
    """

    def __init__(
        self,
        exchange: Exchange,
        operations: Sequence[Operation],
        multiples: Indices,
        perform: Perform = perform,
    ) -> None:
        self._exchange, self._operations, self._multiples = exchange, operations, multiples
        self._perform = perform
        work = plan_tasks(exchange, operations)
        self._waits = [len(task.after) for task in work]
        self._followers = [list[int]() for _ in work]
        for place, task in enumerate(work):
            for before in task.after:
                self._followers[before].append(place)

    def operate(self, time: float, step: float, span: Span, reached: int) -> None:
        """Do the step from `time` of length `step`, both in s; `reached` is the number of steps after it."""
        instances, waits = self._exchange.network.instances, self._waits.copy()
        possible, under_way = [p for p, n in enumerate(waits) if not n], deque[int]()
        heapify(possible)
        failed, failure = len(waits), None
        while possible or under_way:
            place = heappop(possible) if possible else under_way.popleft()
            fresh = not waits[place]
            waits[place] = -1
            try:
                if fresh and place < failed and self._begins(place, time, step, span, reached):
                    under_way.append(place)
                    continue
                if not fresh:
                    instances[self._operations[place].instance].end_step()
            except Exception as error:
                if place < failed:
                    failed, failure = place, error
            for follower in self._followers[place]:
                waits[follower] -= 1
                if not waits[follower]:
                    heappush(possible, follower)
        if failure is not None:
            raise failure

    def _begins(self, place: int, time: float, step: float, span: Span, reached: int) -> bool:
        """Do an operation, or begin it. Return whether it is still running."""
        operation = self._operations[place]
        i, instance = operation.instance, self._exchange.network.instances[operation.instance]
        multiple = int(self._multiples[i])
        if reached % multiple:
            return False
        begin, length = (time, step) if multiple == 1 else span(multiple)
        if operation.call == Call.STEP and instance.steps_apart:
            instance.begin_step(begin, length)
            return True
        self._perform(self._exchange, operation.call, i, begin, length, time + step)
        return False
