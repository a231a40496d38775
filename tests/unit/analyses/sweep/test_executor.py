"""Every variant is there once, in whatever order chunks return or end their worker."""

import heapq
import itertools
import pickle
import random
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from emla_cosim.analyses.execution.chunk_queue import ChunkAnswer, ChunkQueue, WorkPackage
from emla_cosim.analyses.variants.measures import DIED, DONE, TIMED_OUT, VariantOutcome

OVERHEAD = 0.005
"""Seconds that a chunk costs beside its variants."""


def answer_of(numbers: Sequence[int], seconds: float, **more: Any) -> ChunkAnswer:
    outcomes = [pickle.dumps(VariantOutcome(number, DONE)) for number in numbers]
    return ChunkAnswer(outcomes, seconds, **more)


@dataclass
class Process:
    """A worker's process: what it answers, and whether it ends when another variant begins."""

    seconds: float  # of a variant
    killers: set[int]  # which end it
    late: set[int]  # which end it when the next one begins
    hangs: set[int]  # which never end
    has_signals: bool  # outcomes are lost with it
    before: int = -1
    ends: int = 0

    def run(self, chunk: WorkPackage, limit: float) -> ChunkAnswer:
        """Stop at what ends it, at what hangs, and at the limit."""
        finished = list[int]()
        if chunk.is_exclusive or chunk.is_suspect:
            self.before = -1
        for number in chunk.variants:
            spent = self.seconds * len(finished)
            if self.before in self.late or number in self.killers:
                self.before, self.ends = -1, self.ends + 1
                return answer_of([] if self.has_signals else finished, spent, ended=(number, "SIGSEGV"))
            if number in self.hangs:
                self.before = -1
                return answer_of([] if self.has_signals else finished, spent, timed_out=number)
            if spent > limit:
                break
            finished.append(number)
            self.before = number
        if chunk.is_exclusive or chunk.is_suspect:
            self.before = -1
        return answer_of(finished, self.seconds * len(finished))


@given(
    groups=st.lists(st.integers(1, 60), min_size=1, max_size=3),
    killers=st.sets(st.integers(0, 100), max_size=4),
    late=st.sets(st.integers(0, 100), max_size=8),
    hangs=st.sets(st.integers(0, 100), max_size=2),
    worker_killers=st.sets(st.integers(0, 100), max_size=2),
    threads=st.integers(0, 4),
    seconds=st.floats(1e-4, 3.0),
    has_signals=st.booleans(),
    choices=st.randoms(use_true_random=False),
)
def test_every_variant_ends_once_and_only_killers_die(
    groups: list[int],
    killers: set[int],
    late: set[int],
    hangs: set[int],
    worker_killers: set[int],
    threads: int,
    seconds: float,
    has_signals: bool,
    choices: Any,
) -> None:
    """Some variants end their process, some that of the next variant, some never end, and some end their
    worker and what waits there.
    """
    numbers = iter(range(sum(groups)))
    chunks = ChunkQueue(
        [WorkPackage(g, [next(numbers) for _ in range(n)]) for g, n in enumerate(groups)], 50, [1.0] * 3
    )
    workers: list[list[tuple[WorkPackage, float]]] = [[] for _ in range(max(threads, 1))]
    processes = [Process(seconds, killers, late, hangs, has_signals) for _ in workers]
    ended: list[tuple[int, str]] = []
    while chunks or any(workers):
        while chunks.may_submit(sum(map(len, workers)), threads):
            chunk, limit = chunks.next(threads)
            assert 1 <= len(chunk.variants) <= 50
            assert not chunk.is_suspect or not any(workers), "something else would be blamed, too"
            min(workers, key=len).append((chunk, limit))
        worker, process = choices.choice([(w, p) for w, p in zip(workers, processes, strict=True) if w])
        is_lost = not worker_killers.isdisjoint(worker[0][0].variants)
        coming = worker[:] if is_lost else worker[:1]
        process.before = -1 if is_lost else process.before
        del worker[: len(coming)]
        for chunk, limit in coming:
            if is_lost:
                came = chunks.take_loss(chunk, choices.choice([1, 4]))
            else:
                came = chunks.take_answer(chunk, process.run(chunk, limit))
            ended += [(outcome.number, outcome.status) for part in came for outcome in part.outcomes]

    def expected(number: int) -> str:
        if number in worker_killers | killers:
            return DIED
        return TIMED_OUT if number in hangs else DONE

    assert sorted(ended) == [(n, expected(n)) for n in range(sum(groups))]
    assert sum(p.ends for p in processes) <= 2 * len(killers) + len(late)


def test_chunks_last_as_long_as_planned_and_are_short_near_the_end() -> None:
    chunks, sizes = ChunkQueue([WorkPackage(0, range(2000))], most=10**6), list[int]()
    while chunks:
        chunk, _ = chunks.next(2)
        sizes.append(len(chunk.variants))
        chunks.take_answer(chunk, answer_of(chunk.variants, 0.02 * len(chunk.variants)))
    assert sizes[0] == 1
    assert set(sizes[1:30]) == {50}
    assert sizes[-2:] and min(sizes[1:-1]) >= 5
    assert sum(sizes) == 2000
    assert len(sizes) < 70


def test_variants_are_submitted_before_there_are_workers() -> None:
    """Adaptive clusters start workers for what waits. Ever more waits, the more workers there are."""
    chunks = ChunkQueue([WorkPackage(0, range(10_000))], most=10)
    assert chunks.may_submit(0, threads=0)
    chunk, _ = chunks.next(0)
    chunks.take_answer(chunk, answer_of(chunk.variants, 0.5))
    for threads in (0, 1, 4, 16):
        assert chunks.may_submit(5 * max(threads, 1), threads)
        assert not chunks.may_submit(6 * max(threads, 1), threads)


def makespan(durations: Sequence[float], threads: int) -> float:
    """Return when the last variant is done, on a clock that is simulated.

    Chunks wait at the scheduler, as Dask keeps them, and a thread that is free takes the first one.
    """
    chunks = ChunkQueue([WorkPackage(0, range(len(durations)))], most=10**6)
    waiting, free, now, flying = deque[tuple[WorkPackage, float]](), threads, 0.0, 0
    order = itertools.count()
    ends: list[tuple[float, int, WorkPackage, ChunkAnswer]] = []
    while chunks or flying:
        while chunks.may_submit(flying, threads):
            waiting.append(chunks.next(threads))
            flying += 1
        while waiting and free:
            chunk, limit = waiting.popleft()
            finished, spent = 0, 0.0
            while finished < len(chunk.variants) and (not finished or spent <= limit):
                spent += durations[chunk.variants[finished]]
                finished += 1
            answer = answer_of(chunk.variants[:finished], spent)
            heapq.heappush(ends, (now + spent + OVERHEAD, next(order), chunk, answer))
            free -= 1
        now, _, chunk, answer = heapq.heappop(ends)
        free, flying = free + 1, flying - 1
        chunks.take_answer(chunk, answer)
    return now


@pytest.mark.parametrize(("order", "threads"), [("short first", 64), ("long first", 16), ("mixed", 64)])
def test_threads_end_together_in_any_order(order: str, threads: int) -> None:
    """A grid is sorted by nature: 1,500 variants of 2 ms, and 60 of 0.5 s."""
    durations = [0.002] * 1500 + [0.5] * 60
    if order == "long first":
        durations.reverse()
    elif order == "mixed":
        random.Random(3).shuffle(durations)
    ideal = sum(durations) / threads
    spent = makespan(durations, threads)
    print(f"{order}, {threads} threads: {spent:.2f} s, ideal {ideal:.2f} s")
    assert spent < ideal + 2.0
