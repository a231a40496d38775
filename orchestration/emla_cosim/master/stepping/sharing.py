"""Decide by measurements during the run whether several threads share a step, and how.

Results have the same bits either way, so a run can switch at any step.
"""

import contextlib
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from ...base.errors import RunError
from ...sandbox.crash_page import THREADS
from ...sandbox.processes import count_cores
from ..algorithms.operation_table import OperationTableAlgorithm
from ..algorithms.tasks import StepTask
from ..instances.fmu_instance import FmuInstance
from .thread_schedule import ThreadSchedule, schedule_tasks

if TYPE_CHECKING:
    from .kernel import Kernel
    from .switching_loop import SwitchingLoop

WORTH = 1e-5
"""Smallest saving per step, in s, for which threads are considered."""

BETTER = 0.97
"""An additional lane, or a switch between one thread and several, must shorten a step by this factor."""

_FIRST = 0.1
"""Time in s that a run takes before threads are considered: to find out costs as much as a short run."""

_PROBE = 0.005
"""Duration of a measurement in s."""

_CHANGED = 2.0
"""Factor between two times per step from which on the costs of the instances are measured again."""

_SOON, _LATE = 1.0, 30.0
"""First and longest time in s until the next comparison. Other programs may start or end meanwhile."""

_OBSERVED, _OBSERVED_AT_MOST = 4, 64
"""Number of steps in which the cost of every instance is measured, and its limit with step multiples."""

_OBSERVE = 0.0
"""Yielded by a `_Course` to have the costs measured."""

_Course = Generator[float, float, None]
"""Yields the duration in s for which to do steps, and receives the measured seconds per step."""


class Sharing:
    """Measure the steps of a kernel, and share them among threads.

    For each stretch, ask `next` for the number of steps, do them, and pass the time that they took to `did`.

    Args:
        kernel: The compiled loop.
        algorithm: Its algorithm.
        threads: Number of threads; None uses up to one per core if that is faster.
    """

    def __init__(
        self, kernel: "Kernel | SwitchingLoop", algorithm: OperationTableAlgorithm, threads: int | None
    ) -> None:
        self._kernel, self._algorithm = kernel, algorithm
        self._most = min(threads or count_cores(), THREADS, len(algorithm.network.instances))
        self._report: dict[str, Any] = {}
        self._observed: list[list[float]] = []
        self._costs: list[float] = []
        self._course = self._use_threads_if_faster() if threads is None else self._use_requested_threads()
        self._asks = next(self._course, None) if self._most > 1 else None
        self._steps, self._seconds, self._size = 0, 0.0, 1
        self._pause = _SOON

    @property
    def observing(self) -> bool:
        """Whether the next step must be done in Python, within `observed`."""
        return self._asks == _OBSERVE

    def report(self) -> dict[str, Any]:
        """Return the number of threads and the measurements as plain data for run.json; times in us."""
        return {"threads": self._kernel.threads, **self._report}

    def next(self, count: int) -> int:
        """Return how many of `count` steps to do before the next call of `did`."""
        return count if self._asks is None else min(count, self._size)

    def did(self, steps: int, seconds: float) -> None:
        """Take note of the time that some steps took, in s."""
        if self._asks is None or not steps:
            return
        self._steps, self._seconds = self._steps + steps, self._seconds + seconds
        if self._seconds < self._asks:
            left = (self._asks - self._seconds) / (self._seconds / self._steps)
            self._size = max(1, min(2 * self._size, round(left)))
            return
        self._answer(self._seconds / self._steps)

    @contextlib.contextmanager
    def observed(self) -> Iterator[None]:
        """Measure the cost of each instance in the step done within this context."""
        with _measure_calls(self._algorithm.network.instances) as spent:
            yield
        self._observed.append(spent)
        multiple = int(self._algorithm.multiples.max())
        if len(self._observed) > min(max(_OBSERVED, multiple), _OBSERVED_AT_MOST):
            later = self._observed[1:]  # the first step takes longer
            self._costs = [sum(each) / len(later) for each in zip(*later, strict=True)]
            self._answer(0.0)

    def _answer(self, per_step: float) -> None:
        self._steps, self._seconds = 0, 0.0
        try:
            self._asks = self._course.send(per_step)
        except StopIteration:
            self._asks = None

    def _use_requested_threads(self) -> _Course:
        """Measure the costs, then use the requested number of threads."""
        yield _OBSERVE
        work = self._algorithm.tasks()
        self._share(work, self._schedule_work(work, self._most))

    def _use_threads_if_faster(self) -> _Course:
        """Use threads while they are faster. Measure the costs again if steps take another time."""
        yield _FIRST
        while True:
            self._kernel.together, self._size = False, 1
            alone = yield _PROBE
            yield from self._share_if_worth(alone)
            if self._kernel.together:
                yield from self._alternate_threads(alone)
            else:
                yield from self._wait_for_change(alone)

    def _share_if_worth(self, alone: float) -> _Course:
        """Share the steps if that saves time by the costs of the instances; a step takes `alone` s now."""
        if alone * (1.0 - 1.0 / self._most) < WORTH:
            return
        self._observed.clear()
        yield _OBSERVE
        work, costs = self._algorithm.tasks(), sum(self._costs)
        best = self._fewest(work)
        if best is None or alone * (1.0 - best.length / costs) < WORTH:
            return
        try:
            self._share(work, best)
            handover = self._kernel.handover()
        except RunError as error:  # continue with one thread: the user did not request more
            self._kernel.together, self._report["refused"] = False, str(error)
            return
        self._report["handover_us"] = _us(handover)
        self._kernel.together = alone * (1.0 - best.length / costs) >= handover

    def _wait_for_change(self, before: float) -> _Course:
        """Do steps in one thread until they take another time than before, in s."""
        while not _has_changed((yield self._pause), before):
            self._pause = min(2.0 * self._pause, _LATE)

    def _alternate_threads(self, before: float) -> _Course:
        """Measure one thread and several in turn, use the faster way for a while, and repeat.

        This ends if a step in one thread takes another time than before, in s.
        """
        kernel = self._kernel
        while True:
            measured: dict[bool, list[float]] = {True: [], False: []}
            for way in (kernel.together, not kernel.together) * 2:
                kernel.together = way
                self._size = 1
                measured[way].append((yield _PROBE))
            together, alone = min(measured[True]), min(measured[False])
            self._report |= {"step_in_threads_us": _us(together), "step_in_one_thread_us": _us(alone)}
            if _has_changed(alone, before):
                return
            kernel.together = together < alone * (1.0 if kernel.together else BETTER)
            yield self._pause
            self._pause = min(2.0 * self._pause, _LATE)

    def _fewest(self, work: Sequence[StepTask]) -> ThreadSchedule | None:
        """Return the schedule with the most lanes that still shorten a step; None if two lanes do not."""
        best, before = None, sum(self._costs)
        for count in range(2, self._most + 1):
            found = self._schedule_work(work, count)
            if found.length > BETTER * before:
                break
            best, before = found, found.length
        return best

    def _schedule_work(self, work: Sequence[StepTask], count: int) -> ThreadSchedule:
        instances = self._algorithm.network.instances
        alone = {i for i, instance in enumerate(instances) if not instance.runs_beside_others}
        return schedule_tasks(work, self._costs, count, alone)

    def _share(self, work: Sequence[StepTask], placement: ThreadSchedule) -> None:
        self._kernel.share_out(work, placement.lanes)
        instances = self._algorithm.network.instances
        members = [
            dict.fromkeys(i for place in lane for i in work[place].instances) for lane in placement.lanes
        ]
        self._report["lanes"] = [[instances[i].name for i in lane] for lane in members]


@contextlib.contextmanager
def _measure_calls(instances: Sequence[FmuInstance]) -> Iterator[list[float]]:
    """Measure the seconds that each instance spends in calls within this context."""
    spent, calls = [0.0] * len(instances), ("set_inputs", "do_step", "get_outputs")

    def watch(i: int, call: Callable[..., None]) -> Callable[..., None]:
        def called(*arguments: float) -> None:
            began = time.perf_counter()
            try:
                call(*arguments)
            finally:
                spent[i] += time.perf_counter() - began

        return called

    before = [{n: f for n, f in vars(instance).items() if n in calls} for instance in instances]
    for i, instance in enumerate(instances):
        vars(instance).update({name: watch(i, getattr(instance, name)) for name in calls})
    try:
        yield spent
    finally:
        for instance, own in zip(instances, before, strict=True):
            for name in calls:
                del vars(instance)[name]
            vars(instance).update(own)  # a profiler may measure the same calls


def _has_changed(now: float, before: float) -> bool:
    """Return whether steps take another time per step, in s, than before."""
    return not before / _CHANGED < now < before * _CHANGED


def _us(seconds: float) -> float:
    return round(1e6 * seconds, 3)
