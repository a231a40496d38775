"""Split a step into tasks, with the dependencies between them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from .extrapolation import Exchange
from .program import Call, Operation


@dataclass(frozen=True)
class StepTask:
    """A part of a step that one thread does: the step of a group of instances, or one call of an instance.

    Args:
        instances: Positions of the instances that it calls.
        after: Places of the tasks that must be finished before. All are smaller than its own place, so that
            one thread can do all tasks in order, with the same results.
        steps: Whether instances do their step in it.
    """

    instances: tuple[int, ...]
    after: tuple[int, ...]
    steps: bool


def plan_tasks(
    exchange: Exchange, operations: Sequence[Operation], groups: Sequence[Sequence[int]] = ()
) -> list[StepTask]:
    """Return the tasks of a step by place: groups of instances first, then operations."""
    network, task_list = exchange.network, _TaskList(len(exchange.network.instances))
    sources = [sorted(set(exchange.owners[signals].tolist())) for signals in network.sources]
    for members in groups:
        read = {source for i in members for source in sources[i]}
        task_list.add(members, reads=read - set(members), writes=members, steps=True)
    for operation in operations:
        i, call = operation.instance, operation.call
        reads, writes = (sources[i] if call == Call.SET else ()), ((i,) if call == Call.GET else ())
        task_list.add((i,), reads, writes, steps=call == Call.STEP)
    return task_list.tasks


class _TaskList:
    """Tasks so far, and which of them last called each instance, and last wrote and read its outputs."""

    def __init__(self, instances: int) -> None:
        self.tasks: list[StepTask] = []
        self._called: list[set[int]] = [set() for _ in range(instances)]
        self._written: list[set[int]] = [set() for _ in range(instances)]
        self._read: list[list[int]] = [[] for _ in range(instances)]

    def add(self, instances: Iterable[int], reads: Iterable[int], writes: Iterable[int], steps: bool) -> None:
        """Add a task that calls these instances, reads outputs of some, and writes those of others."""
        number, dependencies = len(self.tasks), set[int]()
        for i in instances:
            dependencies |= self._called[i]
            self._called[i] = {number}
        for i in reads:
            dependencies |= self._written[i]
            self._read[i].append(number)
        for i in writes:
            dependencies |= {*self._written[i], *self._read[i]}
            self._written[i], self._read[i] = {number}, []
        self.tasks.append(StepTask(tuple(instances), tuple(sorted(dependencies - {number})), steps))
