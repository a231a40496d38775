"""The variants that are still to run, in chunks: which ones next, and how many."""

import math
import pickle
from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

from ..variants.measures import DIED, TIMED_OUT, Chunk, VariantOutcome

_CHUNK_S = 1.0
"""Target duration of a chunk in s: more than 100 times that of submitting it."""

_CHUNK_S_PER_THREAD = 0.02
"""The same for each thread, so that this process can keep up with collecting chunks."""

_MIN_CHUNKS_PER_THREAD = 3
"""A chunk has at most 1 / _SHARE of a thread's part of the rest, so that all threads end together."""

_MIN_CHUNK_S = 0.1
"""Least duration of a chunk in s, also near the end."""

_OVERRUN = 2.0
"""Factor of its expected duration after which a chunk comes back with what it has."""

_CHUNKS_AHEAD = 6
"""Chunks to submit for each thread: threads never wait, and adaptive clusters see that more would help."""

_SPARE_VARIANTS = 4
"""Variants to submit beyond one for each thread while their duration is unknown, for the same reason."""

_MAX_TRIES = 2
"""Number of processes, or of workers, that a variant may end."""


@dataclass(frozen=True)
class WorkPackage:
    """Variants that one prepared simulation can run.

    Attributes:
        group: Position of their preparation.
        variants: Their numbers.
        is_suspect: Whether their worker was lost; there is one variant then.
        is_exclusive: Whether the variant needs a process that runs no other: one may have ended for it.
    """

    group: int
    variants: Sequence[int]
    is_suspect: bool = False
    is_exclusive: bool = False


@dataclass(frozen=True)
class ChunkRequest:
    """Variants to run.

    Attributes:
        group: Position of their preparation.
        numbers: Numbers of the variants.
        content: The variants and measures, pickled.
        has_signals: Whether signals are kept.
        seconds: Time in s after which no further variant begins.
        timeout: Longest time of a variant in s; None without a limit.
        is_exclusive: Whether a process runs these variants and no others.
    """

    group: int
    numbers: Sequence[int]
    content: bytes
    has_signals: bool
    seconds: float
    timeout: float | None
    is_exclusive: bool = False


@dataclass(frozen=True)
class ChunkAnswer:
    """The outcomes of a chunk. Variants without an outcome did not run.

    Attributes:
        outcomes: Outcomes, each pickled, in the order of the variants.
        wall_s: Duration in s.
        series: Signals of these variants as a Parquet file.
        ended: Number of the variant whose process ended, and how.
        timed_out: Number of the variant that took too long.
    """

    outcomes: Sequence[bytes]
    wall_s: float
    series: bytes | None = None
    ended: tuple[int, str] | None = None
    timed_out: int | None = None


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
        self._remaining = sum(len(w.variants) for w in work)
        self._max_length, self._timeouts = most, timeouts
        self._seconds: dict[int, float] = {}
        self._end_counts, self._loss_counts = Counter[int](), Counter[int]()

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
            return flying < threads + _SPARE_VARIANTS
        is_whole = self._find_length(group, threads) <= self._find_fair_length(threads)
        return flying < (_CHUNKS_AHEAD * threads if is_whole else threads)

    def next(self, threads: int) -> tuple[WorkPackage, float]:
        """Return the variants to run next, and the time in s after which they come back."""
        threads = max(threads, 1)
        if not self._waiting:
            return self._suspects.popleft(), _OVERRUN * _CHUNK_S
        first = self._waiting.popleft()
        # a single variant while the duration of the group is unknown
        count, expected = 1, _CHUNK_S
        if first.group in self._seconds:
            least = int(_MIN_CHUNK_S / self._seconds[first.group])
            fair = max(self._find_fair_length(threads), least)
            count = max(min(self._find_length(first.group, threads), fair, self._max_length), 1)
            expected = count * self._seconds[first.group]
        chunk = replace(first, variants=first.variants[:count])
        self._remaining -= len(chunk.variants)
        if rest := first.variants[count:]:
            self._waiting.appendleft(WorkPackage(first.group, rest))
        return chunk, _OVERRUN * max(expected, _MIN_CHUNK_S)

    def _find_length(self, group: int, threads: int) -> int:
        """Return the number of variants of a group in a chunk of the target duration."""
        return int(max(_CHUNK_S, _CHUNK_S_PER_THREAD * threads) / self._seconds[group])

    def _find_fair_length(self, threads: int) -> int:
        """Return the largest number of variants in a chunk with which all threads end together."""
        return math.ceil(self._remaining / (_MIN_CHUNKS_PER_THREAD * threads))

    def take_answer(self, chunk: WorkPackage, answer: ChunkAnswer) -> list[Chunk]:
        """Return the results of a chunk. What did not run, runs later.

        A variant that ended its process runs again, in a process of its own. Only if that ends, too, it is to
        blame: the variant before may have left an FMU that ends the process when it is reset.
        """
        outcomes = [cast(VariantOutcome, pickle.loads(outcome)) for outcome in answer.outcomes]
        if outcomes:
            duration = answer.wall_s / len(outcomes)
            # a running average: durations may change along a grid
            average = 0.5 * (self._seconds.get(chunk.group, duration) + duration)
            self._seconds[chunk.group] = max(average, 1e-6)  # it divides, and a clock may stand still
        done_numbers = {outcome.number for outcome in outcomes}
        if answer.timed_out is not None:
            limit = self._timeouts[chunk.group] or 0.0
            reason = f"it took more than {limit:g} s; see --timeout."
            outcomes.append(VariantOutcome(answer.timed_out, TIMED_OUT, reason))
            done_numbers.add(answer.timed_out)
        if answer.ended is not None:
            number, cause = answer.ended
            done_numbers.add(number)
            self._end_counts[number] += 1
            if (times := self._end_counts[number]) >= _MAX_TRIES:
                reason = (
                    f"its process ended {times} times ({cause}): an FMU crashed it, or it ran out of memory."
                )
                outcomes.append(VariantOutcome(number, DIED, reason))
            else:
                self._put_back(WorkPackage(chunk.group, [number], is_exclusive=True), first=False)
            before = chunk.variants[: chunk.variants.index(number)][-1:]
            if not done_numbers.issuperset(before):  # its signals are lost; it could end another process, too
                done_numbers.update(before)
                self._put_back(WorkPackage(chunk.group, before, is_exclusive=True), first=False)
        if rest := [number for number in chunk.variants if number not in done_numbers]:
            self._put_back(WorkPackage(chunk.group, rest), first=True)
        return [Chunk(outcomes, answer.series)] if outcomes else []

    def take_loss(self, chunk: WorkPackage, workers: int) -> list[Chunk]:
        """Return the results of a chunk that lost its workers: none, unless one variant is to blame."""
        # any variant of the chunk may be to blame: each runs alone then
        if not chunk.is_suspect:
            self._suspects.extend(WorkPackage(chunk.group, [n], is_suspect=True) for n in chunk.variants)
            return []
        number = chunk.variants[0]
        self._loss_counts[number] += workers
        if (times := self._loss_counts[number]) < _MAX_TRIES:
            self._suspects.append(chunk)
            return []
        reason = f"its worker ended {times} times: it ran out of memory, or its machine was lost."
        return [Chunk([VariantOutcome(number, DIED, reason)])]

    def _put_back(self, package: WorkPackage, first: bool) -> None:
        (self._waiting.appendleft if first else self._waiting.append)(package)
        self._remaining += len(package.variants)
