"""Run variants on Dask's workers in chunks."""

import contextlib
import gc
import itertools
import math
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError
from dataclasses import dataclass, replace
from queue import Empty, SimpleQueue
from typing import Any, cast

from distributed import Client, Future, KilledWorker
from distributed.comm.core import CommClosedError

from ..base.errors import CosimError, RunError
from .data import DIED
from .local_cluster import local_cluster
from .measures import Measures
from .worker import Chunk, SimulationDescription, SweepPlugin, Variant, VariantOutcome, describe, run_chunk
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

_MOST_BYTES = 64 * 2**20
"""Largest size of the signals of a chunk in bytes."""

_TRIES = 2
"""Number of workers that a variant may crash."""

_TIMEOUT = 60.0
"""Seconds to wait for a cluster, or for its workers to come back."""

_GONE = (CommClosedError, OSError, CancelledError, TimeoutError)
"""Exceptions if no scheduler answers."""

_UNFIT = (ImportError, AttributeError, RuntimeError)
"""Exceptions if workers lack a package or version."""

_POLL = 0.2
"""Seconds between two checks for an interruption."""


@dataclass(frozen=True)
class WorkPackage:
    """Variants that one prepared simulation can run, by number; suspect if their chunk crashed a worker."""

    group: int
    variants: Sequence[int]
    suspect: bool = False


class ClusterExecutor:
    """A Dask cluster with the payload of a sweep."""

    def __init__(self, client: Client, payload: WorkerPayload, address: str) -> None:
        self._client, self._key, self._address = client, payload.key, address
        self._calls = itertools.count()
        self._known, self._looked, self._seen = 0, -math.inf, time.monotonic()
        with self._report_lost_cluster():
            client.wait_for_workers(1, timeout=_TIMEOUT)
            try:
                client.register_plugin(SweepPlugin(payload))
            except BaseException as error:
                self.close()  # else Dask would send the plugin to every new worker
                if type(error) is Exception:  # Dask raises this if a worker cannot unpickle the plugin
                    raise RuntimeError(_first_line(error)) from error
                raise

    def _threads(self) -> int:
        """Return how many variants can run at once. Raise RunError if all workers are lost."""
        now = time.monotonic()
        if now - self._looked >= _POLL:
            self._known, self._looked = _threads_of(self._client), now
            if self._known:
                self._seen = now
            elif now - self._seen > _TIMEOUT:
                raise RunError(f"the scheduler at {self._address} has no workers any more.")
        return self._known

    def describe(self, group: int) -> SimulationDescription:
        """Describe the simulation of a group. Raise CosimError if it cannot be prepared."""
        with self._report_lost_cluster():
            try:
                return self._submit(describe, group).result()
            except KilledWorker as error:
                raise RunError(
                    "the process that prepares the scenario ended: an FMU crashed it or memory ran out."
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
        chunks = _ChunkQueue(work, max(_MOST_BYTES // max(bytes_each, 1), 1))
        flying: dict[Future, WorkPackage] = {}
        done = SimpleQueue[Future]()

        def give_out() -> None:
            while chunks and len(flying) < chunks.ahead(self._threads()):
                chunk = chunks.next(self._threads())
                variants = [variant(number) for number in chunk.variants]
                future = self._submit(run_chunk, chunk.group, variants, measures)
                flying[future] = chunk
                future.add_done_callback(done.put)

        def come_back() -> list[Chunk]:
            try:
                future = done.get(timeout=_POLL)
            except Empty:
                return []
            chunk = flying.pop(future)
            give_out()  # before reading and writing: a worker waits
            return list(chunks.take_answer(chunk, future))

        try:
            while (chunks or flying) and not interrupted():
                with self._report_lost_cluster():
                    give_out()
                    answers = come_back()
                for answer in answers:
                    keep(answer)
            return not (chunks or flying)
        finally:
            with contextlib.suppress(Exception):
                self._client.cancel(list(flying), force=True)

    def close(self) -> None:
        """Remove the payload from the workers."""
        with contextlib.suppress(Exception):
            self._client.unregister_worker_plugin(self._key)

    def _submit(self, function: Callable[..., Any], *arguments: Any) -> Future:
        key = f"{self._key}-{next(self._calls)}"
        return self._client.submit(function, self._key, *arguments, key=key, pure=False)

    @contextlib.contextmanager
    def _report_lost_cluster(self) -> Iterator[None]:
        """Turn the exceptions of a lost or unsuitable cluster into RunError."""
        try:
            yield
        except CosimError:
            raise
        except _GONE as error:
            raise RunError(
                f"the scheduler at {self._address} does not answer, or has no workers: {_first_line(error)}."
            ) from error
        except _UNFIT as error:
            reason = _first_line(error.__cause__ or error)
            raise RunError(
                f"the workers of {self._address} cannot run this: {reason}; install the same versions of all "
                "packages there."
            ) from error


class _ChunkQueue:
    """Variants to submit, and what is known about those submitted."""

    def __init__(self, work: Sequence[WorkPackage], most: int) -> None:
        self._waiting = deque(work)
        self._again = deque[WorkPackage]()
        self._left = sum(len(w.variants) for w in work)
        self._most = most
        self._seconds: dict[int, float] = {}
        self._deaths = Counter[int]()
        self._suspects = 0

    def __bool__(self) -> bool:
        return bool(self._waiting or self._again)

    def ahead(self, threads: int) -> int:
        """Return how many chunks may be submitted: two for each thread, so that no thread waits.

        It is one for each thread near the end, and while the variant that crashes a worker is searched:
        another chunk that waits there would be blamed too. It is 0 while there are no workers.
        """
        if self._again or self._suspects or not threads:
            return threads
        whole = self._waiting and self._is_whole(self._waiting[0].group, threads)
        return 2 * threads if whole else threads

    def next(self, threads: int) -> WorkPackage:
        """Return the variants to run next, those of lost chunks first."""
        if self._again:
            self._suspects += 1
            return self._again.popleft()
        first = self._waiting.popleft()
        count = self._count(first.group, threads)
        self._left -= len(first.variants[:count])
        if rest := first.variants[count:]:
            self._waiting.appendleft(WorkPackage(first.group, rest))
        return WorkPackage(first.group, first.variants[:count])

    def _count(self, group: int, threads: int) -> int:
        """Return the number of variants of a chunk; 1 while their duration is unknown."""
        if group not in self._seconds:
            return 1
        fair = max(self._fair(threads), int(_SHORTEST_S / self._each(group)))
        return max(min(self._chunk_length(group, threads), fair, self._most), 1)

    def _is_whole(self, group: int, threads: int) -> bool:
        """Return whether a chunk has its full length, and is not shorter because few variants are left."""
        return group in self._seconds and self._chunk_length(group, threads) <= self._fair(threads)

    def _chunk_length(self, group: int, threads: int) -> int:
        return int(max(_CHUNK_S, _CHUNK_S_PER_THREAD * threads) / self._each(group))

    def _fair(self, threads: int) -> int:
        return math.ceil(self._left / (_SHARE * threads))

    def _each(self, group: int) -> float:
        return max(self._seconds[group], 1e-6)

    def take_answer(self, chunk: WorkPackage, future: Future) -> Iterator[Chunk]:
        """Yield the results of a chunk. Retry one that crashed its worker in two halves.

        Retry a single variant once. If it crashes again, that is its outcome.
        """
        self._suspects -= chunk.suspect
        try:
            done: Chunk = future.result()
        except KilledWorker as error:
            yield from self._requeue(chunk, 1 + error.allowed_failures)
            return
        each = done.wall_s / len(chunk.variants)
        known = self._seconds.get(chunk.group, each)
        self._seconds[chunk.group] = 0.5 * (known + each)
        yield done

    def _requeue(self, chunk: WorkPackage, deaths: int) -> Iterator[Chunk]:
        """Retry a chunk after `deaths` crashes. By default, Dask's scheduler itself retries several times."""
        if (count := len(chunk.variants)) > 1:
            for half in (chunk.variants[: count // 2], chunk.variants[count // 2 :]):
                self._again.append(WorkPackage(chunk.group, half, suspect=True))
            return
        number = chunk.variants[0]
        self._deaths[number] += deaths if chunk.suspect else 1  # another chunk may have caused the crash
        if self._deaths[number] < _TRIES:
            self._again.append(replace(chunk, suspect=True))
            return
        times = self._deaths[number]
        sentence = f"its process ended {times} times: an FMU crashed it, or it ran out of memory."
        yield Chunk([VariantOutcome(number, DIED, sentence)], 0.0)


@contextlib.contextmanager
def open_executor(
    payload: WorkerPayload, scheduler: Scheduler, workers: int | None, report: Callable[[str], None]
) -> Iterator[ClusterExecutor]:
    """Open a cluster: that of a scheduler, or one on this machine.

    Args:
        payload: What the workers need.
        scheduler: Address or client of a scheduler; None for a cluster on this machine.
        workers: Number of workers on this machine. Default: one for each core.
        report: Called with the address of the dashboard.

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
        found = ClusterExecutor(client, payload, address)
        try:
            yield found
        finally:
            found.close()


def _threads_of(client: Client) -> int:
    return sum(dict(cast(Any, client.nthreads())).values())


def _client(address: str, security: Any) -> Client:
    try:
        return Client(address, security=security, timeout=_TIMEOUT / 4, set_as_default=False)
    except Exception as error:  # an invalid address may raise anything
        reason = _first_line(error)
    gc.collect()  # now: a half-made client hangs if it is collected while another one is created
    raise RunError(f"no scheduler answers at '{address}': {reason}.")


def _first_line(error: BaseException) -> str:
    text = str(error).strip() or type(error).__name__
    return text.splitlines()[0].rstrip(".")
