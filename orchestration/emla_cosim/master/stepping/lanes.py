"""Decide during the run whether threads share a step, and distribute its tasks among them.

Results have the same bits either way, so a run can switch at any step.
"""

from collections.abc import Generator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...base.crash_page import THREADS
from ...base.errors import RunError
from ...base.process import count_cores
from ..algorithms.algorithm import Algorithm

if TYPE_CHECKING:
    from .native_loop import NativeLoop
import random
from collections.abc import Collection
from dataclasses import dataclass
from heapq import heappop, heappush

from ..algorithms.program import StepTask, count_waits

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


WORTH = 1e-5
"""Smallest saving per step, in s, for which threads are considered."""

BETTER = 0.97
"""A further lane, and several threads instead of one, must shorten a step by this factor."""

_FIRST = 0.1
"""Time in s that a run takes before threads are considered: measuring takes as long as a short run."""

_PROBE = 0.005
"""Duration of a measurement in s."""

_SOON, _LATE = 1.0, 30.0
"""First and longest time in s until the next comparison. Other programs may start or end meanwhile."""

_ROUNDS, _MOST = 8, 64
"""How often costs are measured, and in how many steps at most: as many as the largest step multiple."""

_ThreadPolicy = Generator[tuple[float, int], tuple[int, float], None]
"""Yields how many seconds and at least how many steps to do; receives the steps and seconds done."""


class LaneChoice:
    """Share the steps of a loop among threads, as their measured times suggest.

    For each stretch, get the number of steps from `next`, do them, and pass their time to `record_steps`.

    Args:
        loop: The stepper in C.
        algorithm: Its algorithm.
        threads: Number of threads; None uses up to one per core if that is faster.
    """

    def __init__(self, loop: "NativeLoop", algorithm: Algorithm, threads: int | None) -> None:
        self._loop, self._algorithm = loop, algorithm
        self._most = min(threads or count_cores(), THREADS, len(algorithm.network.instances))
        reason = loop.why_one_thread
        self._report: dict[str, Any] = {"why_one_thread": reason} if reason else {}
        policy = self._use_threads_if_faster() if threads is None else self._use_requested_threads()
        self._policy = policy if self._most > 1 and not reason else None
        self._goal = next(policy) if self._policy is not None else (0.0, 0)
        self._steps, self._seconds, self._size = 0, 0.0, 1

    def report(self) -> dict[str, Any]:
        """Return the number of threads, why it is one, and the measurements for run.json; times in us."""
        return {"threads": self._loop.threads, **self._report}

    def next(self, count: int) -> int:
        """Return how many of `count` steps to do before the next call of `record_steps`."""
        return count if self._policy is None else min(count, self._size)

    def record_steps(self, steps: int, seconds: float) -> None:
        """Record the time in s that some steps took."""
        if self._policy is None or not steps:
            return
        self._steps, self._seconds = self._steps + steps, self._seconds + seconds
        seconds_left, steps_left = self._goal[0] - self._seconds, self._goal[1] - self._steps
        if seconds_left > 0.0 or steps_left > 0:
            remaining_steps = max(round(seconds_left / (self._seconds / self._steps)), steps_left)
            self._size = max(1, min(2 * self._size, remaining_steps))
            return
        measurement, self._steps, self._seconds, self._size = (self._steps, self._seconds), 0, 0.0, 1
        try:
            self._goal = self._policy.send(measurement)
        except StopIteration:
            self._policy = None

    def _use_requested_threads(self) -> _ThreadPolicy:
        """Measure the costs, then use the requested number of threads."""
        yield 0.0, 1  # the profiler, if there is one, has started then; and the first step takes longer
        self._use_schedule(self._make_schedule((yield from self._measure_costs()), self._most))

    def _use_threads_if_faster(self) -> _ThreadPolicy:
        """Use threads while they are faster; compare again from time to time."""
        pause = _SOON
        yield _FIRST, 1
        while True:
            schedule = self._find_schedule((yield from self._measure_costs()))
            try:
                if schedule is not None:
                    self._use_schedule(schedule)
                    yield from self._compare_with_one_thread()
            except RunError as error:  # one thread will do: the user did not request more
                self._report["why_one_thread"] = str(error)
                return
            yield pause, 1
            pause = min(2.0 * pause, _LATE)

    def _measure_costs(self) -> Generator[tuple[float, int], tuple[int, float], list[float]]:
        """Do some steps in one thread, and return the shortest time per step of each instance in s."""
        loop, measured, costs = self._loop, self._loop.measured, np.full(len(self._loop.efforts), np.inf)
        loop.is_shared, count = False, min(int(self._algorithm.multiples.max()), _MOST)
        loop.measure(range(len(loop.efforts)))
        for _ in range(_ROUNDS):  # the minimum: other programs interrupt some rounds
            start = loop.efforts["nanoseconds"].sum(axis=1)
            steps, _ = yield 0.0, count
            costs = np.minimum(costs, (loop.efforts["nanoseconds"].sum(axis=1) - start) * (1e-9 / steps))
        loop.measure(measured)
        return costs.tolist()

    def _find_schedule(self, costs: Sequence[float]) -> ThreadSchedule | None:
        """Return the schedule with the most lanes that still shorten a step; None if it saves too little."""
        total = sum(costs)
        # this is what perfectly shared costs save
        if total * (1.0 - 1.0 / self._most) < WORTH:
            return None
        best, length = None, total
        for count in range(2, self._most + 1):
            schedule = self._make_schedule(costs, count)
            if schedule.length > BETTER * length:
                break
            best, length = schedule, schedule.length
        return best if total - length >= WORTH else None

    def _make_schedule(self, costs: Sequence[float], count: int) -> ThreadSchedule:
        return schedule_tasks(self._loop.tasks, costs, count, self._loop.first_lane_only)

    def _use_schedule(self, schedule: ThreadSchedule) -> None:
        """Share the steps as in a schedule, and report the components of each lane."""
        tasks, instances = self._loop.tasks, self._algorithm.network.instances
        self._loop.share_out(schedule.lanes)
        members = [
            dict.fromkeys(i for number in lane for i in tasks[number].instances) for lane in schedule.lanes
        ]
        self._report["lanes"] = [[instances[i].name for i in lane] for lane in members]

    def _compare_with_one_thread(self) -> _ThreadPolicy:
        """Do steps in several threads and in one by turns, and choose the faster way."""
        measured: dict[bool, list[float]] = {True: [], False: []}
        for is_shared in (True, False) * 2:
            self._loop.is_shared = is_shared
            steps, seconds = yield _PROBE, 1
            measured[is_shared].append(seconds / steps)
        shared, single = min(measured[True]), min(measured[False])
        for name, seconds in {"step_in_threads_us": shared, "step_in_one_thread_us": single}.items():
            self._report[name] = round(1e6 * seconds, 3)
        self._loop.is_shared = shared < BETTER * single
