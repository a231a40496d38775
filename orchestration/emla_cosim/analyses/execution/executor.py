"""Run variants on Dask's workers in chunks."""

import contextlib
import gc
import itertools
import math
import pickle
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from dataclasses import dataclass, replace
from queue import Empty, SimpleQueue
from typing import Any, cast

import cloudpickle
from distributed import Client, Future, KilledWorker
from distributed.comm.core import CommClosedError

from ...base.errors import CommandError, CosimError, RunError, join_names
from ...base.interruption import catch_interrupts
from ...base.values import convert_value
from ..variants.data import DIED, TIMED_OUT, Chunk, SimulationDescription, Variant, VariantOutcome
from ..variants.measures import Measures
from .local_cluster import local_cluster
from .worker import ChunkAnswer, ChunkRequest, make_call, make_plugin
from .worker_payload import WorkerPayload

Scheduler = str | Client | None
"""Address of a scheduler, a client of one, or None for a cluster on this machine."""

_CHUNK_S = 1.0
"""Target duration of a chunk in s: more than 100 times that of submitting it."""

_CHUNK_S_PER_THREAD = 0.02
"""The same for each thread of the cluster, so that this process can keep up with collecting chunks."""

_SHARE = 3
"""A chunk has at most 1 / _SHARE of a thread's part of the rest, so that all threads end together."""

_SHORTEST_S = 0.1
"""Least duration of a chunk in s, also near the end."""

_OVERRUN = 2.0
"""Factor of its expected duration after which a chunk comes back with what it has."""

_AHEAD = 6
"""Chunks to submit for each thread: threads never wait, and adaptive clusters see that more would help."""

_SPARE = 4
"""Variants to submit beyond one for each thread while their duration is unknown, for the same reason."""

_MOST_BYTES = 64 * 2**20
"""Largest size of the signals of a chunk in bytes."""

_TRIES = 2
"""Number of processes, or of workers, that a variant may end."""

_CONNECT_S = 15.0
"""Seconds to wait for an answer of a scheduler."""

_TOLD_S = 1.0
"""Seconds without workers after which a note says what is waited for."""

_SLOW = 5.0
"""A variant is slow if it takes this multiple of the average."""

_NOTE_S = 10.0
"""Least time in s between two notes on slow variants."""

_NAMED = 3
"""Most slow variants that a note names."""

_GONE = (CommClosedError, OSError, CancelledError, TimeoutError)
"""Exceptions if no scheduler answers."""

_UNFIT = (ImportError, AttributeError, RuntimeError)
"""Exceptions if workers lack a package or version."""

_POLL = 0.2
"""Seconds between two checks for an interruption."""


@dataclass(frozen=True)
class WorkPackage:
    """Variants that one prepared simulation can run.

    Attributes:
        group: Position of their preparation.
        variants: Their numbers.
        suspect: Whether their worker was lost; there is one variant then.
        alone: Whether the variant needs a process that runs no other: one may have ended for it.
    """

    group: int
    variants: Sequence[int]
    suspect: bool = False
    alone: bool = False


class ClusterExecutor:
    """A Dask cluster with the payload of a sweep."""

    def __init__(
        self, client: Client, payload: WorkerPayload, address: str, report: Callable[[str], None]
    ) -> None:
        self._client, self._key, self._address, self._report = client, payload.key, address, report
        self._timeouts = [packed.options.timeout for packed in payload.packed]
        self._patience = max(packed.options.patience for packed in payload.packed)
        self._calls = itertools.count()
        self._known, self._looked, self._seen, self._told = 0, -math.inf, time.monotonic(), False
        self._slow = _SlowVariants()
        with self._report_lost_cluster():
            client.subscribe_topic(self._key, self._slow.take_event)
            content = cloudpickle.dumps((payload.packed, payload.registered))
            try:
                client.register_plugin(make_plugin(self._key, payload.version, payload.files, content))
            except BaseException:
                self.close()  # else Dask would send the plugin to every new worker
                raise

    def _threads(self) -> int:
        """Return how many variants can run at once. Raise RunError if there were no workers for too long."""
        now = time.monotonic()
        if now - self._looked < _POLL:
            return self._known
        self._known, self._looked = _threads_of(self._client), now
        if self._known:
            self._seen, self._told = now, False
        elif now - self._seen > self._patience:
            raise RunError(
                f"the scheduler at {self._address} had no workers for {self._patience:g} s; start workers, "
                "or wait longer with --patience."
            )
        elif not self._told and now - self._seen > _TOLD_S:
            self._told = True
            self._report(
                f"Waiting for workers: the scheduler at {self._address} has none. --patience limits the time "
                f"to {self._patience:g} s."
            )
        return self._known

    def describe(self, group: int) -> SimulationDescription:
        """Describe the simulation of a group. Raise CosimError if it cannot be prepared."""
        with catch_interrupts() as interrupted, self._report_lost_cluster():
            try:
                future = self._submit("describe", group)
                while not future.done():
                    self._threads()
                    if interrupted():
                        future.cancel()
                        raise RunError("interrupted before the first run.")
                    time.sleep(_POLL / 20)
                return pickle.loads(future.result())
            except KilledWorker as error:
                raise RunError(
                    "the worker that prepares the scenario ended: memory ran out, or its machine is lost."
                ) from error
            except (CosimError, *_GONE, *_UNFIT):
                raise
            except Exception as error:  # from a user's metrics
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
        """Run variants on the cluster.

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
        chunks = ChunkQueue(work, max(_MOST_BYTES // max(bytes_each, 1), 1), self._timeouts)
        flying: dict[Future, WorkPackage] = {}
        done = SimpleQueue[Future]()

        def give_out() -> None:
            while chunks.may_submit(len(flying), threads := self._threads()):
                chunk, seconds = chunks.next(threads)
                content = cloudpickle.dumps(([variant(number) for number in chunk.variants], measures))
                timeout = self._timeouts[chunk.group]
                request = ChunkRequest(
                    chunk.group,
                    list(chunk.variants),
                    content,
                    bool(measures.signals),
                    seconds,
                    timeout,
                    chunk.alone or chunk.suspect,
                )
                future = self._submit("run", pickle.dumps(request))
                flying[future] = chunk
                future.add_done_callback(done.put)

        def come_back() -> list[Chunk]:
            try:
                future = done.get(timeout=_POLL)
            except Empty:  # a callback is lost where memory for its thread is missing
                future = next((one for one in flying if one.done()), None)
            if future is None or future not in flying:
                return []
            chunk = flying.pop(future)
            try:
                found = chunks.take_answer(chunk, pickle.loads(future.result()))
            except KilledWorker as error:
                found = chunks.take_loss(chunk, 1 + error.allowed_failures)
            self._slow.forget(chunk.variants)
            give_out()  # before reading and writing: a worker waits
            return found

        try:
            while (chunks or flying) and not interrupted():
                with self._report_lost_cluster():
                    give_out()
                    answers = come_back()
                    if (slow := self._slow.note(chunks.average_s)) is not None:
                        self._report(slow if any(self._timeouts) else f"{slow} --timeout ends slow variants.")
                for answer in answers:
                    keep(answer)
            return not (chunks or flying)
        finally:
            with contextlib.suppress(Exception):
                self._client.cancel(list(flying), force=True)

    def close(self) -> None:
        """End what runs on the workers, and remove the payload from them."""
        with contextlib.suppress(Exception):
            self._client.unsubscribe_topic(self._key)
        with contextlib.suppress(Exception):
            self._client.unregister_worker_plugin(self._key)

    def _submit(self, method: str, argument: Any) -> Future:
        key = f"{self._key}-{next(self._calls)}"
        return self._client.submit(make_call(self._key), method, argument, key=key, pure=False)

    @contextlib.contextmanager
    def _report_lost_cluster(self) -> Iterator[None]:
        """Turn the exceptions of a lost or unsuitable cluster into RunError."""
        try:
            yield
        except CosimError:
            raise
        except _GONE as error:
            raise RunError(
                f"the scheduler at {self._address} does not answer: {_first_line(error)}."
            ) from error
        except _UNFIT as error:
            reason = _first_line(error.__cause__ or error)
            raise RunError(
                f"the workers of {self._address} cannot run this: {reason}; install the same versions of all "
                "packages there."
            ) from error


class ChunkQueue:
    """Variants to submit, and what is known about those submitted.

    Args:
        work: Variants by group.
        most: Largest number of variants in a chunk.
        timeouts: Longest time of a variant in s by group; None without a limit.
    """

    def __init__(self, work: Sequence[WorkPackage], most: int, timeouts: Sequence[float | None] = ()) -> None:
        self._waiting = deque(work)
        self._suspects = deque[WorkPackage]()
        self._left = sum(len(w.variants) for w in work)
        self._most, self._timeouts = most, timeouts
        self._seconds: dict[int, float] = {}
        self._ended, self._lost = Counter[int](), Counter[int]()

    def __bool__(self) -> bool:
        return bool(self._waiting or self._suspects)

    @property
    def average_s(self) -> float:
        """The longest average duration of a variant in s, over the groups; 0 while it is unknown."""
        return max(self._seconds.values(), default=0.0)

    def may_submit(self, flying: int, threads: int) -> bool:
        """Return whether to submit a chunk now, with this many submitted and unfinished.

        Chunks are also submitted while there are no workers: adaptive clusters start workers for them. Near
        the end there is one chunk for each thread. Variants whose worker was lost come last, one at a time
        on the whole cluster: if a worker is lost again, there is one variant to blame.
        """
        threads = max(threads, 1)
        if not self._waiting:
            return bool(self._suspects) and not flying
        group = self._waiting[0].group
        if group not in self._seconds:
            return flying < threads + _SPARE
        is_whole = self._chunk_length(group, threads) <= self._fair(threads)
        return flying < (_AHEAD * threads if is_whole else threads)

    def next(self, threads: int) -> tuple[WorkPackage, float]:
        """Return the variants to run next, and the time in s after which they come back."""
        threads = max(threads, 1)
        if not self._waiting:
            return self._suspects.popleft(), _OVERRUN * _CHUNK_S
        first = self._waiting.popleft()
        count = self._count(first.group, threads)
        chunk = replace(first, variants=first.variants[:count])
        self._left -= len(chunk.variants)
        if rest := first.variants[count:]:
            self._waiting.appendleft(WorkPackage(first.group, rest))
        expected = count * self._seconds[first.group] if first.group in self._seconds else _CHUNK_S
        return chunk, _OVERRUN * max(expected, _SHORTEST_S)

    def _count(self, group: int, threads: int) -> int:
        """Return the number of variants of a chunk; 1 while their duration is unknown."""
        if group not in self._seconds:
            return 1
        fair = max(self._fair(threads), int(_SHORTEST_S / self._each(group)))
        return max(min(self._chunk_length(group, threads), fair, self._most), 1)

    def _chunk_length(self, group: int, threads: int) -> int:
        return int(max(_CHUNK_S, _CHUNK_S_PER_THREAD * threads) / self._each(group))

    def _fair(self, threads: int) -> int:
        return math.ceil(self._left / (_SHARE * threads))

    def _each(self, group: int) -> float:
        return max(self._seconds[group], 1e-6)

    def take_answer(self, chunk: WorkPackage, answer: ChunkAnswer) -> list[Chunk]:
        """Return the results of a chunk. What did not run, runs later.

        A variant that ended its process runs again, in a process of its own. Only if that ends, too, it is to
        blame: the variant before may have left an FMU that ends the process when it is reset.
        """
        outcomes = [cast(VariantOutcome, pickle.loads(outcome)) for outcome in answer.outcomes]
        if outcomes:
            each = answer.wall_s / len(outcomes)
            self._seconds[chunk.group] = 0.5 * (self._seconds.get(chunk.group, each) + each)
        ran = {outcome.number for outcome in outcomes}
        if answer.timed_out is not None:
            limit = self._timeouts[chunk.group] or 0.0
            reason = f"it took more than {limit:g} s; see --timeout."
            outcomes.append(VariantOutcome(answer.timed_out, TIMED_OUT, reason))
            ran.add(answer.timed_out)
        if answer.ended is not None:
            number, how = answer.ended
            ran.add(number)
            self._ended[number] += 1
            if (times := self._ended[number]) >= _TRIES:
                reason = (
                    f"its process ended {times} times ({how}): an FMU crashed it, or it ran out of memory."
                )
                outcomes.append(VariantOutcome(number, DIED, reason))
            else:
                self._wait(WorkPackage(chunk.group, [number], alone=True), first=False)
            before = chunk.variants[: chunk.variants.index(number)][-1:]
            if not ran.issuperset(before):  # its signals are lost; else it could end the process of another
                ran.update(before)
                self._wait(WorkPackage(chunk.group, before, alone=True), first=False)
        if rest := [number for number in chunk.variants if number not in ran]:
            self._wait(WorkPackage(chunk.group, rest), first=True)
        return [Chunk(outcomes, answer.wall_s, answer.series)] if outcomes else []

    def take_loss(self, chunk: WorkPackage, workers: int) -> list[Chunk]:
        """Return the results of a chunk that lost its workers: none, unless one variant is to blame."""
        if not chunk.suspect:
            self._suspects.extend(WorkPackage(chunk.group, [n], suspect=True) for n in chunk.variants)
            return []
        number = chunk.variants[0]
        self._lost[number] += workers
        if (times := self._lost[number]) < _TRIES:
            self._suspects.append(chunk)
            return []
        reason = f"its worker ended {times} times: it ran out of memory, or its machine was lost."
        return [Chunk([VariantOutcome(number, DIED, reason)], 0.0)]

    def _wait(self, package: WorkPackage, first: bool) -> None:
        (self._waiting.appendleft if first else self._waiting.append)(package)
        self._left += len(package.variants)


class _SlowVariants:
    """The variants that workers report as slow."""

    def __init__(self) -> None:
        self._running: dict[int, float] = {}
        self._turn = threading.Lock()
        self._is_new, self._next_note = False, -math.inf

    def take_event(self, event: tuple[float, Any]) -> None:
        """Take the message of a worker: number of a variant, and for how long it has run."""
        number, seconds = event[1]
        with self._turn:
            self._running[number] = seconds
            self._is_new = True

    def forget(self, numbers: Sequence[int]) -> None:
        """Forget variants that do not run any more."""
        with self._turn:
            for number in self._running.keys() & set(numbers):
                del self._running[number]

    def note(self, average_s: float) -> str | None:
        """Return a note on variants that take much longer than the average, if it is time for one."""
        now = time.monotonic()
        with self._turn:
            slow = {n: s for n, s in sorted(self._running.items()) if s > _SLOW * average_s}
            if not slow or not self._is_new or now < self._next_note:
                return None
            self._is_new, self._next_note = False, now + _NOTE_S
        names = [f"variant {number} for {seconds:.0f} s" for number, seconds in slow.items()]
        if len(names) > _NAMED:
            names = [*names[:_NAMED], f"{len(names) - _NAMED} more"]
        return f"Still running: {join_names(names)}."


@contextlib.contextmanager
def open_executor(
    payload: WorkerPayload, scheduler: Scheduler, workers: int | None, report: Callable[[str], None]
) -> Iterator[ClusterExecutor]:
    """Open a cluster: that of a scheduler, or one on this machine.

    Args:
        payload: What the workers need.
        scheduler: Address or client of a scheduler; None for a cluster on this machine.
        workers: Number of workers on this machine. Default: one for each core.
        report: Called with notes, such as the address of the dashboard.

    Raises:
        RunError: The scheduler does not answer.
    """
    with contextlib.ExitStack() as held:
        if isinstance(scheduler, Client):
            if scheduler.status != "running" or scheduler.scheduler is None:
                raise RunError(f"the client in `scheduler` is {scheduler.status}; it must be running.")
            client, address = scheduler, str(cast(Any, scheduler.scheduler).addr)
        else:
            if scheduler is None:
                address, security = held.enter_context(local_cluster(workers))
            else:
                address, security = scheduler, None
            client = held.enter_context(_client(address, security))
        if scheduler is not None:
            report(f"Dask's dashboard: {client.dashboard_link}")
        found = ClusterExecutor(client, payload, address, report)
        try:
            yield found
        finally:
            found.close()


def check_cluster(scheduler: Scheduler, workers: int | None) -> None:
    """Raise CommandError if scheduler or workers are invalid."""
    if not isinstance(scheduler, Client):
        convert_value(scheduler, str | None, "the scheduler")
    if workers is None:
        return
    if convert_value(workers, int, "the number of workers") < 1:
        raise CommandError(f"the number of workers {workers} must be at least 1.")
    if scheduler is not None:
        raise CommandError("a scheduler has its own workers; set either a scheduler or a number of workers.")


def _threads_of(client: Client) -> int:
    return sum(dict(cast(Any, client.nthreads())).values())


def _client(address: str, security: Any) -> Client:
    try:
        return Client(address, security=security, timeout=_CONNECT_S, set_as_default=False)
    except Exception as error:  # an invalid address may raise anything
        reason = _first_line(error)
    gc.collect()  # now: a half-made client hangs if it is collected while another one is created
    raise RunError(f"no scheduler answers at '{address}': {reason}.")


def _first_line(error: BaseException) -> str:
    text = str(error).strip() or type(error).__name__
    return text.splitlines()[0].rstrip(".")
