"""Chunks that come back, or take their worker with them, in any order: every variant is there once."""

from typing import Any

from distributed import KilledWorker
from hypothesis import given
from hypothesis import strategies as st

from emla_cosim.sweeps.data import DIED, DONE
from emla_cosim.sweeps.executor import WorkPackage, _ChunkQueue
from emla_cosim.sweeps.variants import Chunk, VariantOutcome


class Came:
    """A future that is done."""

    def __init__(self, chunk: WorkPackage, seconds: float, killed: bool) -> None:
        self._chunk, self._seconds, self._killed = chunk, seconds, killed

    def result(self) -> Chunk:
        if self._killed:
            raise KilledWorker("key", Any, 0)  # type: ignore[arg-type]
        outcomes = [VariantOutcome(number, DONE) for number in self._chunk.variants]
        return Chunk(outcomes, self._seconds * len(outcomes))


@given(
    groups=st.lists(st.integers(1, 60), min_size=1, max_size=3),
    killers=st.sets(st.integers(0, 100), max_size=4),
    threads=st.integers(1, 4),
    seconds=st.floats(1e-4, 3.0),
    choices=st.randoms(use_true_random=False),
)
def test_every_variant_ends_once_and_only_what_kills_dies(
    groups: list[int], killers: set[int], threads: int, seconds: float, choices: Any
) -> None:
    numbers = iter(range(sum(groups)))
    chunks = _ChunkQueue(
        [WorkPackage(g, [next(numbers) for _ in range(n)]) for g, n in enumerate(groups)], most=50
    )
    workers: list[list[WorkPackage]] = [[] for _ in range(threads)]
    ended: list[tuple[int, str]] = []
    while chunks or any(workers):
        while chunks and sum(map(len, workers)) < chunks.ahead(threads):
            chunk = chunks.next(threads)
            assert 1 <= len(chunk.variants) <= 50
            min(workers, key=len).append(chunk)
        worker = choices.choice([w for w in workers if w])
        killed = not killers.isdisjoint(worker[0].variants)
        coming = worker[:] if killed else worker[:1]
        del worker[: len(coming)]
        for chunk in coming:
            for answer in chunks.take_answer(chunk, Came(chunk, seconds, killed)):  # type: ignore[arg-type]
                ended += [(outcome.number, outcome.status) for outcome in answer.outcomes]
    assert sorted(ended) == [(n, DIED if n in killers else DONE) for n in range(sum(groups))]


def test_chunks_become_as_long_as_they_should_and_short_near_the_end() -> None:
    chunks, sizes = _ChunkQueue([WorkPackage(0, range(2000))], most=10**6), list[int]()
    while chunks:
        chunk = chunks.next(2)
        sizes.append(len(chunk.variants))
        list(chunks.take_answer(chunk, Came(chunk, 0.02, False)))  # type: ignore[arg-type]
    assert sizes[0] == 1
    assert set(sizes[1:30]) == {50}
    assert sizes[-2:] and min(sizes[1:-1]) >= 5
    assert sum(sizes) == 2000
    assert len(sizes) < 70


def test_nothing_is_given_out_while_all_workers_are_on_their_way_back() -> None:
    chunks = _ChunkQueue([WorkPackage(0, range(100))], most=10)
    assert chunks.ahead(0) == 0
    chunks._seconds[0] = 0.01  # as it is known after the first answer
    assert chunks.ahead(0) == 0 < chunks.ahead(2)
