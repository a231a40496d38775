"""Variants given out to Dask's workers in chunks, until every one of them has come back."""

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
"""Who gives out work: the address of a scheduler, somebody's client of one, or None for our own."""

_CHUNK_S = 1.0
"""How long a chunk takes, in s: more than a hundred times what giving it out does."""

_CHUNK_S_PER_THREAD = 0.02
"""The same for each thread of the cluster: whoever collects the chunks has to keep up."""

_SHARE = 3
"""Of what is left a thread gets at most this part at a time, so that all end at about the same time."""

_SHORTEST_S = 0.1
"""How long a chunk takes at least, in s, also near the end."""

_MOST_BYTES = 64 * 2**20
"""Size of the signals of a chunk, at most."""

_TRIES = 2
"""So many workers may a variant take with it."""

_TIMEOUT = 60.0
"""Seconds to wait for a cluster, or for its workers to come back."""

_GONE = (CommClosedError, OSError, CancelledError, TimeoutError)
"""What is raised where no scheduler answers."""

_UNFIT = (ImportError, AttributeError, RuntimeError)
"""What is raised where workers have not what this needs."""

_LOOK = 0.2
"""Seconds between two looks at whether somebody wants it to end."""


@dataclass(frozen=True)
class WorkPackage:
    """Variants that one prepared simulation can run, by number; suspect if they took a worker with them."""

    group: int
    variants: Sequence[int]
    suspect: bool = False


class ClusterExecutor:
    """A Dask cluster that has what a sweep needs."""

    def __init__(self, client: Client, shipment: WorkerPayload, address: str) -> None:
        self._client, self._key, self._address = client, shipment.key, address
        self._calls = itertools.count()
        self._known, self._looked, self._seen = 0, -math.inf, time.monotonic()
        with self._report_lost_cluster():
            client.wait_for_workers(1, timeout=_TIMEOUT)
            try:
                client.register_plugin(SweepPlugin(shipment))
            except BaseException as error:
                self.close()  # or it would go to every worker that is yet to come
                if type(error) is Exception:  # what Dask makes of a worker that cannot even read it
                    raise RuntimeError(_first_line(error)) from error
                raise

    def _threads(self) -> int:
        """How many variants can run at once now. Raises RunError where there are no workers any more."""
        now = time.monotonic()
        if now - self._looked >= _LOOK:
            self._known, self._looked = _threads_of(self._client), now
            if self._known:
                self._seen = now
            elif now - self._seen > _TIMEOUT:
                raise RunError(f"the scheduler at {self._address} has no workers any more.")
        return self._known

    def describe(self, group: int) -> SimulationDescription:
        """What the simulation of a preparation gives. Raises CosimError where it cannot be prepared."""
        with self._report_lost_cluster():
            try:
                return self._submit(describe, group).result()
            except KilledWorker as error:
                raise RunError(
                    "the process ended that was to prepare the scenario: an FMU ends it, or memory does not "
                    "suffice."
                ) from error
            except (CosimError, *_GONE, *_UNFIT):
                raise
            except Exception as error:  # of somebody's metrics
                raise RunError(f"the scenario cannot be begun on a worker: {error!r}.") from error

    def run(
        self,
        work: Sequence[WorkPackage],
        variant: Callable[[int], Variant],
        measures: Measures,
        bytes_each: int,
        keep: Callable[[Chunk], None],
        interrupted: Callable[[], bool],
    ) -> bool:
        """Run all of it, hand each chunk to `keep`, and say whether it was all; `variant` has them by number.

        It is less where `interrupted` says so. `bytes_each` is the size of the signals of a variant.
        Raises RunError where the cluster is gone.
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
                future = done.get(timeout=_LOOK)
            except Empty:
                return []
            chunk = flying.pop(future)
            give_out()  # before anything is read and written: a worker waits
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
        """Let the workers forget what they were sent."""
        with contextlib.suppress(Exception):
            self._client.unregister_worker_plugin(self._key)

    def _submit(self, function: Callable[..., Any], *arguments: Any) -> Future:
        key = f"{self._key}-{next(self._calls)}"
        return self._client.submit(function, self._key, *arguments, key=key, pure=False)

    @contextlib.contextmanager
    def _report_lost_cluster(self) -> Iterator[None]:
        """Turn whatever a cluster raises that does not answer into one sentence."""
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
                f"the workers of {self._address} cannot run this: {reason}; the same versions have to be "
                "installed there."
            ) from error


class _ChunkQueue:
    """What is still to be given out, and what became of that which was."""

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
        """How many chunks may be given out at once: two for each thread, so that none waits for the next one.

        It is one near the end, and while it is being found out which variant took a worker with it: another
        one that waits there would be blamed too. It is none while all workers are on their way back.
        """
        if self._again or self._suspects or not threads:
            return threads
        whole = self._waiting and self._is_whole(self._waiting[0].group, threads)
        return 2 * threads if whole else threads

    def next(self, threads: int) -> WorkPackage:
        """Variants to run next: those first whose chunk was lost."""
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
        """How many variants make a chunk; one while nobody knows how long it takes."""
        if group not in self._seconds:
            return 1
        fair = max(self._fair(threads), int(_SHORTEST_S / self._each(group)))
        return max(min(self._chunk_length(group, threads), fair, self._most), 1)

    def _is_whole(self, group: int, threads: int) -> bool:
        """Whether a chunk is as long as it should be, and not shorter because little is left."""
        return group in self._seconds and self._chunk_length(group, threads) <= self._fair(threads)

    def _chunk_length(self, group: int, threads: int) -> int:
        return int(max(_CHUNK_S, _CHUNK_S_PER_THREAD * threads) / self._each(group))

    def _fair(self, threads: int) -> int:
        return math.ceil(self._left / (_SHARE * threads))

    def _each(self, group: int) -> float:
        return max(self._seconds[group], 1e-6)

    def take_answer(self, chunk: WorkPackage, future: Future) -> Iterator[Chunk]:
        """What a chunk gave; one that took its worker with it is tried again in two halves.

        A variant that did so alone is tried once more, and then that is what came out of it.
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
        """`deaths` are more than one where the scheduler tries again by itself, as it does by default."""
        if (count := len(chunk.variants)) > 1:
            for half in (chunk.variants[: count // 2], chunk.variants[count // 2 :]):
                self._again.append(WorkPackage(chunk.group, half, suspect=True))
            return
        number = chunk.variants[0]
        self._deaths[number] += deaths if chunk.suspect else 1  # which may have been its neighbour's fault
        if self._deaths[number] < _TRIES:
            self._again.append(replace(chunk, suspect=True))
            return
        times = self._deaths[number]
        sentence = f"its process ended {times} times: an FMU ends it, or memory does not suffice."
        yield Chunk([VariantOutcome(number, DIED, sentence)], 0.0)


@contextlib.contextmanager
def open_executor(
    shipment: WorkerPayload, scheduler: Scheduler, workers: int | None, told: Callable[[str], None]
) -> Iterator[ClusterExecutor]:
    """A cluster with these contents: of this scheduler, or one of this machine with so many workers.

    `told` hears where its dashboard is. Raises RunError for one that does not answer.
    """
    with contextlib.ExitStack() as held:
        if isinstance(scheduler, Client):
            if scheduler.status != "running" or scheduler.scheduler is None:
                raise RunError(f"the client given as scheduler is {scheduler.status}; it must be running.")
            client, address, dashboard = scheduler, str(cast(Any, scheduler.scheduler).addr), ""
        else:
            if scheduler is None:
                address, security, dashboard = held.enter_context(local_cluster(workers))
            else:
                address, security, dashboard = scheduler, None, ""
            client = held.enter_context(_client(address, security))
        told(f"Dask's dashboard: {dashboard or client.dashboard_link}")
        found = ClusterExecutor(client, shipment, address)
        try:
            yield found
        finally:
            found.close()


def _threads_of(client: Client) -> int:
    return sum(dict(cast(Any, client.nthreads())).values())


def _client(address: str, security: Any) -> Client:
    try:
        return Client(address, security=security, timeout=_TIMEOUT / 4, set_as_default=False)
    except Exception as error:  # of any kind, for an address that is none
        reason = _first_line(error)
    gc.collect()  # a client half made waits forever where it is collected while another one is made
    raise RunError(f"no scheduler answers at '{address}': {reason}.")


def _first_line(error: BaseException) -> str:
    text = str(error).strip() or type(error).__name__
    return text.splitlines()[0].rstrip(".")
