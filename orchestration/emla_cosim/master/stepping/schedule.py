"""Distribute the tasks of a step among threads: list scheduling by the cost of the tasks.

T. L. Adam, K. M. Chandy, J. R. Dickson: A comparison of list schedules for parallel processing systems,
Commun. ACM 17 (1974), doi:10.1145/361604.361619.
"""

import random
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush

from ..algorithms.tasks import StepTask, count_waits

_TRIALS, _MAX_TRIED_TASKS = 40, 4000
"""Number of orders to try, and the limit of their tasks in all: with many tasks, orders differ little."""


@dataclass(frozen=True)
class ThreadSchedule:
    """The places of the tasks of each lane, in order, and the length of a step in the unit of costs."""

    lanes: list[list[int]]
    length: float


def schedule_tasks(
    tasks: Sequence[StepTask], costs: Sequence[float], count: int, first_only: Collection[int] = ()
) -> ThreadSchedule:
    """Distribute tasks among lanes, with all calls of an instance in the same lane.

    The task with the longest path to the end of the step goes first. That is close to the optimum. A few
    trials with random changes of the lengths, from a fixed seed, come closer.

    Args:
        tasks: The tasks of a step.
        costs: Cost of a step, per instance; all other tasks cost nothing.
        count: Largest number of lanes. Lanes without tasks are left out.
        first_only: Positions of the instances that only the first lane may call.
    """
    cost = [sum(costs[i] for i in task.instances) if task.steps else 0.0 for task in tasks]
    paths, noise = list(cost), random.Random(1)
    for task_number in range(len(tasks) - 1, -1, -1):
        for before in tasks[task_number].after:
            paths[before] = max(paths[before], cost[before] + paths[task_number])
    best = _simulate_step(tasks, cost, paths, count, first_only)
    for _ in range(min(_TRIALS, _MAX_TRIED_TASKS // max(len(tasks), 1))):
        blurred = [path * noise.uniform(0.7, 1.3) for path in paths]
        best = min(best, _simulate_step(tasks, cost, blurred, count, first_only), key=lambda s: s.length)
    return best


def _simulate_step(
    tasks: Sequence[StepTask],
    cost: Sequence[float],
    priorities: Sequence[float],
    count: int,
    first_only: Collection[int],
) -> ThreadSchedule:
    """Simulate one step: a free lane takes the most urgent of the possible tasks."""
    waits, followers = count_waits(tasks)

    def finish(task_number: int) -> list[int]:
        """Return the tasks that waited only for this one."""
        for follower in followers[task_number]:
            waits[follower] -= 1
        return [follower for follower in followers[task_number] if not waits[follower]]

    lane_of, start_times, now = dict[int, int](), [0.0] * len(tasks), 0.0
    free, running = list(range(count)), list[tuple[float, int, int]]()
    urgent_tasks = [list[tuple[float, int]]() for _ in (0, 1)]  # for all lanes, and for the first lane only
    ready = [task_number for task_number, n in enumerate(waits) if not n]
    while ready or running or any(urgent_tasks):
        while ready:
            task_number = ready.pop()
            start_times[task_number] = now
            if tasks[task_number].steps:
                queue = urgent_tasks[not set(first_only).isdisjoint(tasks[task_number].instances)]
                heappush(queue, (-priorities[task_number], task_number))
            else:  # it takes no time
                ready += finish(task_number)
        # the first lane first: only it may take the tasks of `first_only`
        for lane in sorted(free):
            if queues := [q for q in (urgent_tasks if lane == 0 else urgent_tasks[:1]) if q]:
                _, task_number = heappop(min(queues, key=lambda q: q[0]))
                free.remove(lane)
                start_times[task_number] = now
                lane_of |= dict.fromkeys(tasks[task_number].instances, lane)
                heappush(running, (now + cost[task_number], task_number, lane))
        now = running[0][0] if running else now
        while running and running[0][0] == now:
            _, task_number, lane = heappop(running)
            free.append(lane)
            ready += finish(task_number)
    lanes = [list[int]() for _ in range(count)]
    # tasks without cost come first, so that others do not wait for more than these
    for task_number in sorted(range(len(tasks)), key=lambda p: (start_times[p], cost[p] > 0.0, p)):
        lanes[lane_of.get(tasks[task_number].instances[0], 0)].append(task_number)
    return ThreadSchedule([lane for lane in lanes if lane], now)
