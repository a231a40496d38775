"""Order the calls of a step so that FMUs in other processes step at the same time."""

from collections import deque
from collections.abc import Collection, Sequence
from heapq import heapify, heappop, heappush

from .extrapolation import Exchange
from .program import Call, Operation
from .tasks import plan_tasks


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
    tasks = plan_tasks(exchange, operations)
    waits, followers = [len(task.after) for task in tasks], [list[int]() for _ in tasks]
    for task_number, task in enumerate(tasks):
        for before in task.after:
            followers[before].append(task_number)
    ready, running = [task_number for task_number, n in enumerate(waits) if not n], deque[int]()
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
