"""Split a step into tasks, with the dependencies between them."""

from collections import deque
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from heapq import heapify, heappop, heappush

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


def count_waits(tasks: Sequence[StepTask]) -> tuple[list[int], list[list[int]]]:
    """Return how many tasks each one waits for, and which tasks wait for it."""
    followers = [list[int]() for _ in tasks]
    for task_number, task in enumerate(tasks):
        for before in task.after:
            followers[before].append(task_number)
    return [len(task.after) for task in tasks], followers


def find_split_steps(exchange: Exchange, operations: Sequence[Operation]) -> set[int]:
    """Return the instances whose steps can overlap: those in other processes, if there are several."""
    stepped = {o.instance for o in operations if o.call == Call.STEP}
    separate = {i for i in stepped if exchange.network.instances[i].steps_apart}
    return separate if len(separate) > 1 else set()


def overlap_steps(
    exchange: Exchange, operations: Sequence[Operation], split: Collection[int]
) -> list[tuple[Operation, bool]]:
    """Return operations with the same result in an order in which steps overlap.

    A step in another process begins as soon as its inputs are ready. It is awaited when nothing else can
    be done.

    Args:
        exchange: The values of the instances.
        operations: Operations with the present signals, in their order.
        split: Positions of the instances in other processes.

    Returns:
        Each operation, and whether it is the end of a step that another entry begins.
    """
    if not split:
        return [(operation, False) for operation in operations]
    waits, followers = count_waits(plan_tasks(exchange, operations))
    ready, running = [task_number for task_number, n in enumerate(waits) if not n], deque[int]()
    # the smallest number first, so that the order stays near that of the program
    heapify(ready)
    ordered = list[tuple[Operation, bool]]()
    while ready or running:
        is_end = not ready
        task_number = running.popleft() if is_end else heappop(ready)
        operation = operations[task_number]
        ordered.append((operation, is_end))
        if not is_end and operation.call == Call.STEP and operation.instance in split:
            running.append(task_number)
            continue
        for follower in followers[task_number]:
            waits[follower] -= 1
            if not waits[follower]:
                heappush(ready, follower)
    return ordered
