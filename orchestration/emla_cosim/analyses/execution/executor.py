"""Run variants in chunks: on this machine, or on a cluster."""

import math
import pickle
import sys
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing, contextmanager
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, TypeAlias, Union

import cloudpickle

from ...base.errors import CommandError, CosimError, RunError, join_names
from ...base.extras import require_extra
from ...base.files import temporary_folder
from ...base.interruption import catch_interrupts
from ...base.process import count_cores
from ...base.values import convert_value
from ..variants.measures import Chunk, Measures, SimulationDescription, Variant
from .chunk_queue import ChunkQueue, ChunkRequest, WorkPackage
from .variant_processes import VariantHost
from .worker_payload import WorkerPayload

if TYPE_CHECKING:
    from distributed import Client

    from .dask_workers import DaskWorkers

Scheduler: TypeAlias = Union[str, "Client", VariantHost, None]
"""Address of a Dask scheduler, a client of one, or None for this machine, whose processes may run already."""

Task: TypeAlias = Any
"""A call that has been submitted: a future of Python's or of Dask's."""

_MAX_BYTES = 64 * 2**20
"""Largest size of the signals of a chunk in bytes."""

_SLOW = 5.0
"""A variant is slow if it takes this multiple of the average."""

_NOTE_INTERVAL_S = 10.0
"""Least time in s between two notes on slow variants."""

_MAX_NAMES = 3
"""Most slow variants that a note names."""

_POLL_S = 0.2
"""Seconds between two checks for an interruption."""


UNFIT = (ImportError, AttributeError, RuntimeError)
"""Exceptions if another process lacks a package, a version or a module of the user."""


class WorkersLostError(Exception):
    """A chunk is not sent again: the argument is the number of workers that were lost with it."""


class LocalWorkers:
    """Threads of this process that call a host."""

    def __init__(self, host: VariantHost) -> None:
        self._host, self._pool = host, ThreadPoolExecutor(host.count)
        self.slow = SimpleQueue[tuple[int, float]]()
        """Numbers of variants that still run after a while, and their times in s."""

    def load(self, payload: WorkerPayload) -> None:
        """Pass the payload to all hosts."""
        self._host.load(payload.files, payload.content)

    def threads(self) -> int:
        """Return how many chunks can run at once."""
        return self._host.count

    def submit(self, method: str, argument: Any) -> Task:
        """Call a method of a host: `describe` with a group, or `run` with a `ChunkRequest`."""
        more = [lambda *slow: self.slow.put(slow)] if method == "run" else []
        return self._pool.submit(getattr(self._host, method), argument, *more)

    def answer(self, task: Task) -> Any:
        """Return the answer of a task that is done. Raise WorkersLostError, or what the call raised."""
        return task.result()

    def cancel(self, tasks: Sequence[Task]) -> None:
        """Let these tasks not begin, if they have not begun."""
        for task in tasks:
            task.cancel()

    def explain(self, error: Exception) -> RunError | None:
        """Return the error that explains an exception that concerns all variants; None for any other."""
        if isinstance(error, UNFIT):
            return RunError(f"another process cannot run this: {first_line(error)}.")
        return None

    def close(self) -> None:
        """End all tasks and processes."""
        self._host.close()
        self._pool.shutdown(cancel_futures=True)


class Executor:
    """Runs the variants of an analysis."""

    def __init__(
        self, workers: "LocalWorkers | DaskWorkers", payload: WorkerPayload, report: Callable[[str], None]
    ) -> None:
        self._workers, self._timeouts, self._report = workers, payload.timeouts, report
        self._slow = _SlowVariants(workers.slow)
        with self._explain_errors():
            workers.load(payload)

    def describe(self, group: int) -> SimulationDescription:
        """Describe the simulation of a group. Raise CosimError if it cannot be prepared."""
        with catch_interrupts() as interrupted, self._explain_errors():
            try:
                task = self._workers.submit("describe", group)
                while not task.done():
                    self._workers.threads()
                    if interrupted():
                        raise RunError("interrupted before the first run.")
                    time.sleep(_POLL_S / 40)
                return pickle.loads(self._workers.answer(task))
            except WorkersLostError as error:
                raise RunError(
                    "the worker that prepares the scenario ended: out of memory, or its machine was lost."
                ) from error
            except Exception as error:
                if isinstance(error, CosimError) or self._workers.explain(error) is not None:
                    raise
                # from a user's metrics
                raise RunError(f"the scenario cannot be started on a worker: {error!r}.") from error

    def run(
        self,
        work: Sequence[WorkPackage],
        variant: Callable[[int], Variant],
        measures: Measures,
        bytes_each: int,
        keep: Callable[[Chunk], None],
        interrupted: Callable[[], bool],
    ) -> bool:
        """Run variants.

        Args:
            work: Variants by group.
            variant: Returns a variant by number.
            measures: What to record of each variant.
            bytes_each: Size of the signals of a variant in bytes.
            keep: Called with each finished chunk.
            interrupted: Returns whether to stop early.

        Returns:
            Whether all variants ran.

        Raises:
            RunError: The cluster is lost.
        """
        chunks = ChunkQueue(work, max(_MAX_BYTES // max(bytes_each, 1), 1), self._timeouts)
        ended, tasks = SimpleQueue[Task](), dict[Task, WorkPackage]()

        def submit() -> None:
            while chunks.may_submit(len(tasks), threads := self._workers.threads()):
                chunk, seconds = chunks.next(threads)
                request = ChunkRequest(
                    chunk.group,
                    list(chunk.variants),
                    # functions of a user's script go by value: workers cannot import it
                    cloudpickle.dumps(([variant(number) for number in chunk.variants], measures)),
                    bool(measures.signals),
                    seconds,
                    self._timeouts[chunk.group],
                    chunk.is_exclusive or chunk.is_suspect,
                )
                task = self._workers.submit("run", request)
                tasks[task] = chunk
                task.add_done_callback(ended.put)

        def collect() -> list[Chunk]:
            """Return the results of a call that has ended, and submit more; empty if none ended in time."""
            try:
                task = ended.get(timeout=_POLL_S)
            except Empty:  # a callback is lost where memory for its thread is missing
                task = next((t for t in tasks if t.done()), None)
            if task is None or task not in tasks:
                return []
            chunk = tasks.pop(task)
            try:
                results = chunks.take_answer(chunk, self._workers.answer(task))
            except WorkersLostError as error:
                results = chunks.take_loss(chunk, *error.args)
            submit()  # before reading and writing: a worker waits
            return results

        try:
            while (chunks or tasks) and not interrupted():
                with self._explain_errors():
                    submit()
                    results = collect()
                if (slow := self._slow.note(tasks.values(), chunks.average_s)) is not None:
                    self._report(slow if any(self._timeouts) else f"{slow} --timeout ends slow variants.")
                for result in results:
                    keep(result)
            return not (chunks or tasks)
        finally:
            self._workers.cancel(list(tasks))

    @contextmanager
    def _explain_errors(self) -> Iterator[None]:
        """Turn exceptions that concern all variants into RunError."""
        try:
            yield
        except CosimError:
            raise
        except Exception as error:
            if (explained := self._workers.explain(error)) is None:
                raise
            raise explained from error


class _SlowVariants:
    """The variants that workers report as slow: numbers, and their times in s."""

    def __init__(self, reports: SimpleQueue[tuple[int, float]]) -> None:
        self._reports, self._next_note = reports, -math.inf
        self._seconds: dict[int, float] = {}

    def note(self, chunks: Collection[WorkPackage], average_s: float) -> str | None:
        """Return a note on variants of these chunks that take much longer than the average.

        It is None if there are none, or the last note was a short time ago.
        """
        now = time.monotonic()
        if self._reports.empty() or now < self._next_note:
            return None
        while not self._reports.empty():
            number, self._seconds[number] = self._reports.get()
        running = {number for chunk in chunks for number in chunk.variants}
        slow = [n for n in sorted(running & self._seconds.keys()) if self._seconds[n] > _SLOW * average_s]
        if not slow:
            return None
        self._next_note = now + _NOTE_INTERVAL_S
        names = [f"variant {number} for {self._seconds[number]:.0f} s" for number in slow[:_MAX_NAMES]]
        if len(slow) > _MAX_NAMES:
            names.append(f"{len(slow) - _MAX_NAMES} more")
        return f"Still running: {join_names(names)}."


@contextmanager
def start_workers(scheduler: Scheduler, workers: int | None) -> "Iterator[str | Client | VariantHost]":
    """Start the processes of this machine, which load while their caller prepares what to run.

    Args:
        scheduler: Address or client of a scheduler; None for this machine.
        workers: Number of processes on this machine. Default: one for each core.

    Yields:
        The argument of `open_executor`.

    Raises:
        RunError: No process can start.
    """
    if scheduler is not None:
        yield scheduler
        return
    with (
        temporary_folder("variants") as folder,
        closing(VariantHost(folder, workers or count_cores())) as host,
    ):
        yield host


@contextmanager
def open_executor(
    payload: WorkerPayload, scheduler: Scheduler, workers: int | None, report: Callable[[str], None]
) -> Iterator[Executor]:
    """Open an executor for the variants of one analysis.

    Args:
        payload: What the variants need.
        scheduler: Address or client of a scheduler; None for this machine, or what `start_workers` yields.
        workers: Number of processes on this machine. Default: one for each core.
        report: Called with notes, such as the address of the dashboard.

    Raises:
        RunError: The scheduler does not answer.
    """
    with start_workers(scheduler, workers) as opened, ExitStack() as stack:
        if isinstance(opened, VariantHost):
            started = LocalWorkers(opened)
        else:
            from .dask_workers import connect  # which only some have

            started = stack.enter_context(connect(opened, payload, report))
        stack.enter_context(closing(started))
        yield Executor(started, payload, report)


def check_cluster(scheduler: Scheduler, workers: int | None) -> None:
    """Raise CommandError if scheduler or workers are invalid, or Dask is missing."""
    distributed = sys.modules.get("distributed")
    if distributed is None or not isinstance(scheduler, distributed.Client):
        convert_value(scheduler, str | None, "the scheduler")
    if workers is not None and convert_value(workers, int, "the number of workers") < 1:
        raise CommandError(f"the number of workers {workers} must be at least 1.")
    if workers is not None and scheduler is not None:
        raise CommandError("a scheduler has its own workers; set either a scheduler or a number of workers.")
    if scheduler is not None:
        require_extra("cluster", "a scheduler of Dask")


def first_line(error: BaseException) -> str:
    """Return the first line of an exception without full stop; of one without a text, its type."""
    text = str(error).strip() or type(error).__name__
    return text.splitlines()[0].rstrip(".")
