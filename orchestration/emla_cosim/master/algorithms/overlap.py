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
    apart = {i for i in stepped if exchange.network.instances[i].steps_apart}
    return apart if len(apart) > 1 else set()


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
    for place, task in enumerate(tasks):
        for before in task.after:
            followers[before].append(place)
    possible, under_way = [place for place, n in enumerate(waits) if not n], deque[int]()
    heapify(possible)
    ordered = list[tuple[Operation, bool]]()
    while possible or under_way:
        is_end = not possible
        place = under_way.popleft() if is_end else heappop(possible)
        operation = operations[place]
        ordered.append((operation, is_end))
        if not is_end and operation.call == Call.STEP and operation.instance in split:
            under_way.append(place)
            continue
        for follower in followers[place]:
            waits[follower] -= 1
            if not waits[follower]:
                heappush(possible, follower)
    return ordered
