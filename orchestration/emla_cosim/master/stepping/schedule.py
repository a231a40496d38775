"""Distribute the tasks of a step among threads: list scheduling by the cost of the tasks.

T. L. Adam, K. M. Chandy, J. R. Dickson: A comparison of list schedules for parallel processing systems,
Commun. ACM 17 (1974), doi:10.1145/361604.361619.
"""

import random
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush

from ..algorithms.tasks import StepTask

_TRIES = 40
"""Number of orders to try; with many tasks (see `_MANY`) fewer, because they differ little."""

_MANY = 4000


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
    ways, noise = _find_longest_paths(tasks, cost), random.Random(1)
    best = _simulate_step(tasks, cost, ways, count, first_only)
    for _ in range(min(_TRIES, _MANY // max(len(tasks), 1))):
        blurred = [way * noise.uniform(0.7, 1.3) for way in ways]
        best = min(best, _simulate_step(tasks, cost, blurred, count, first_only), key=lambda p: p.length)
    return best


def _find_longest_paths(tasks: Sequence[StepTask], cost: Sequence[float]) -> list[float]:
    """Return the length of the longest path from the begin of each task to the end of the step."""
    ways = list(cost)
    for place in range(len(tasks) - 1, -1, -1):
        for before in tasks[place].after:
            ways[before] = max(ways[before], cost[before] + ways[place])
    return ways


def _simulate_step(
    tasks: Sequence[StepTask],
    cost: Sequence[float],
    priorities: Sequence[float],
    count: int,
    first_only: Collection[int],
) -> ThreadSchedule:
    """Simulate one step: a free lane takes the most urgent of the possible tasks."""
    waits, followers = [len(task.after) for task in tasks], [list[int]() for _ in tasks]
    for place, task in enumerate(tasks):
        for before in task.after:
            followers[before].append(place)
    lane_of, begun = dict[int, int](), [0.0] * len(tasks)
    now, free = 0.0, list(range(count))
    running = list[tuple[float, int, int]]()
    possible = [list[tuple[float, int]]() for _ in (0, 1)]  # for all lanes, and for the first lane only

    def end(place: int) -> None:
        """Finish a task; tasks that waited only for it become possible."""
        ended = [place]
        while ended:
            for follower in followers[ended.pop()]:
                waits[follower] -= 1
                if not waits[follower]:
                    ended += begin(follower)

    def begin(place: int) -> list[int]:
        """Make a task possible. Return it if it costs nothing and so is finished at once."""
        begun[place] = now
        if not tasks[place].steps:
            return [place]
        any_lane = not first_only or set(tasks[place].instances).isdisjoint(first_only)
        heappush(possible[0 if any_lane else 1], (-priorities[place], place))
        return []

    for place in [p for p, n in enumerate(waits) if not n]:
        for through in begin(place):
            end(through)
    while True:
        for lane in sorted(free):
            queues = [q for q in (possible if lane == 0 else possible[:1]) if q]
            if not queues:
                continue
            _, place = heappop(min(queues, key=lambda q: q[0]))
            free.remove(lane)
            begun[place] = now
            lane_of |= dict.fromkeys(tasks[place].instances, lane)
            heappush(running, (now + cost[place], place, lane))
        if not running:
            break
        now, place, lane = heappop(running)
        free.append(lane)
        end(place)
        while running and running[0][0] == now:
            _, place, lane = heappop(running)
            free.append(lane)
            end(place)
    lanes = [list[int]() for _ in range(count)]
    # tasks without cost come first, so that others do not wait for more than these
    for place in sorted(range(len(tasks)), key=lambda p: (begun[p], cost[p] > 0.0, p)):
        lanes[lane_of.get(tasks[place].instances[0], 0)].append(place)
    return ThreadSchedule([lane for lane in lanes if lane], now)
