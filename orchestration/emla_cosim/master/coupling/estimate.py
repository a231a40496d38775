"""Estimate the coupling error of a run with fixed steps, by Richardson's extrapolation.

After the last step, saved states are restored, and steps are done once more: with half the step (where
nothing samples, also with steps of 4, 16, 64, ... lengths). If x(h) is a signal with steps of the length h,
and p the order of the exchange, its error is

    (x(h) - x(h/2)) / (1 - 2^-p)        and        (x(m h) - x(h)) / (m^p - 1)

A run whose repetition in halves is cheap enough is repeated as a whole, which gives the error over the run.
Otherwise windows that begin at several points are repeated. In each, coarser steps look further ahead as long
as they agree with the finer ones. Where the error still grows at the end of a window, it is assumed to grow
on with the path of its signal: that is once its range in a motion that ends, and often in an oscillation.

If an FMU cannot restore its state, or cannot do a half step, differences of successive rows show what inputs
miss during a step. They do not show whether such errors add up.

L. F. Richardson: The approximate arithmetical solution by finite differences of physical problems involving
differential equations, Phil. Trans. R. Soc. A 210 (1911), doi:10.1098/rsta.1911.0009.
"""

import time
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np

from ...base.arrays import Vector
from ...base.errors import RunError
from ..algorithms.algorithm import Algorithm
from ..instances.fmu_instance import InstanceError
from ..stepping.checkpoint import Snapshot
from ..stepping.native_loop import NativeLoop
from ..stepping.timing import CommunicationPoints, make_clock
from .halved_program import HalvedProgram
from .row_store import GROWTH, RowStore, measure_path

SHARE, ALLOWANCE = 0.015, 0.02
"""Largest wall time of an estimate: a share of the run's, plus an allowance in s for a first run, which takes
a second with its imports and preparation."""

WINDOWS = 4
"""Number of windows in a long run."""

CHECKED, MEASURED = 4, 32
"""Number of steps that are repeated first, to see whether the restored states give the same bits, and of
those that are done in halves to see what they cost."""

SLOWEST_SAVE = 2e-3
"""Wall time in s of saving all states above which only the first state is saved."""

MOST_COST = 2.2
"""Largest cost of a step in halves, in steps; a measurement above it was disturbed."""

WORTHWHILE = 0.5
"""Coarse steps are used if they cost less than this fraction of the steps that they replace."""

ASYMPTOTIC, AGREES, NEGLIGIBLE = 0.3, 2.0, 1e-5
"""Coarse steps count while they change no signal by more than `ASYMPTOTIC` of its range, and their error
agrees with that of finer ones up to the factor `AGREES`, or is `NEGLIGIBLE`."""

LEAST_GROWTH = 0.02
"""Growth in a quarter of a window, relative to the error, below which the error does not grow."""

UNSEEN = 0.7
"""Exponent of the path along which errors are assumed to add up where windows do not show whether they do. It
lies between those of errors that all add up, 1, and of errors that are forgotten, 0."""

SHORTEST_WINDOW = 4
"""Least number of steps of a window."""

FEW_ROWS = 16
"""Number of rows up to which an error in one row alone counts."""

MOST_VALUES = 4_000_000
"""Largest number of values of repeated steps that are kept at a time."""

DIFFERENCES = "differences of rows"
"""What an estimate without repeated steps is made from."""

DIVERGED = 1e100
"""Range of a signal of a run that diverged, as metrics report it."""

HUGE = 1e6
"""Error relative to the range that represents all larger ones."""


@dataclass(frozen=True)
class CouplingError:
    """The estimated coupling error of a run.

    Attributes:
        errors: Error of each signal by its position, relative to its range.
        repeated: The repeated part: "the whole run" or "windows"; "differences of rows" if FMUs cannot
            repeat steps.
        repeated_steps: Number of steps that were repeated.
        not_estimated: Why there is no estimate; empty if there is one.
        is_fault: Whether this is a fault of an FMU, which users should know.
    """

    errors: dict[int, float] = field(default_factory=dict)
    repeated: str = ""
    repeated_steps: int = 0
    not_estimated: str = ""
    is_fault: bool = False


@dataclass(frozen=True)
class _Window:
    """The errors in a window, per signal.

    Attributes:
        reached: Error after the window, relative to the range.
        growth: Growth of the error within half of the window; 0 if it does not grow on.
        path: Path of the signal in the second half, relative to its range.
    """

    reached: Vector
    growth: Vector
    path: Vector

    @classmethod
    def of(cls, errors: Vector, rows: Vector, ranges: Vector) -> "_Window":
        """Return the window of errors and signals at the same points, shape (points, signals).

        An error grows on if it grew in both of the last quarters: one that oscillates reaches its largest
        value sometimes, without growing. One that shrinks counts, too: an error that follows its signal and
        does not add up grows in some windows and shrinks in others.
        """
        by_third, by_second = (_find_largest(errors[: max(len(errors) * n // 4, 1)]) for n in (3, 2))
        reached = _find_largest(errors)
        with np.errstate(invalid="ignore"):
            is_growing = np.minimum(reached - by_third, by_third - by_second) > LEAST_GROWTH * reached
            in_second, in_fourth = (
                _find_largest(errors[len(errors) * n // 4 : len(errors) * (n + 1) // 4]) for n in (1, 3)
            )
            growth = np.where(is_growing | (in_fourth < in_second), in_fourth - in_second, 0.0)
        return cls(reached, growth, measure_path(rows[max(len(errors) // 2 - 1, 0) : len(errors)], ranges))


class CouplingEstimate:
    """Save states and rows during a run, and estimate its coupling error afterwards.

    Args:
        algorithm: The algorithm, after `initialize`; see `begin`.
        loop: What does its steps.
        times: The communication points.
        signals: Positions of the signals that continuous instances exchange.
        sampling: Positions of the instances that sample.
    """

    def __init__(
        self,
        algorithm: Algorithm,
        loop: NativeLoop,
        times: CommunicationPoints,
        signals: Sequence[int],
        sampling: Collection[int],
    ) -> None:
        self._algorithm, self._loop, self._times = algorithm, loop, times
        self._signals, self._sampling = np.array(signals, dtype=np.intp), sampling
        self._snapshots = dict[int, Snapshot]()
        self._window_starts = list[int]()
        self._rows: RowStore | None = None
        self._repeated, self._pace, self._is_coarse = 0, 0.0, False
        self._program: HalvedProgram | None = None
        self._has_changed = False
        instances = algorithm.network.instances
        # other processes on this machine should not change what is repeated
        self._clock = time.perf_counter if any(s.steps_apart for s in instances) else time.thread_time
        self._can_restore = all(
            # an integrator that restarts where a state is saved changes the last digits of the run
            s.rolls_back and not s.restarts_when_saved and (s.varies_step or i in sampling)
            for i, s in enumerate(instances)
        )
        if self._can_restore:
            loop.allow_way_back()

    def save_if_due(self, first: int, last: int) -> int:
        """Save the state at step `first` if it is due, and return the last step before the next state.

        Args:
            first: The present step.
            last: The last requested step.
        """
        if self._rows is None:
            end = self._times.steps
            self._window_starts = sorted({first + (end - first) * n // WINDOWS for n in range(WINDOWS)})
            columns, is_coarse = self._signals, not self._sampling
            self._rows = RowStore(first, end, self._window_starts, columns, is_coarse)
            self._rows.add_rows(first, self._algorithm.network.signals[None])
        if self._can_restore and first in self._window_starts and first not in self._snapshots:
            save_start = self._clock()
            self._snapshots[first] = Snapshot(self._algorithm, learned=True)
            self._snapshots[first].save()
            if self._clock() - save_start > SLOWEST_SAVE:
                self._window_starts = self._window_starts[:1]
        return next((b for b in self._window_starts if first < b < last), last)

    def record_rows(self, first: int, rows: Vector) -> None:
        """Record the rows of successive steps, of which `first` is the first: time in s, then all signals."""
        if self._rows is not None:
            self._rows.add_rows(first, rows[:, 1:])

    def estimate(self, allowed: float, pace: float) -> CouplingError:
        """Return the estimate; the instances cannot continue afterwards.

        Args:
            allowed: Wall time in s that it may take.
            pace: Wall time in s of a step of the run.
        """
        last, rows, algorithm = self._algorithm.steps, self._rows, self._algorithm
        if rows is None or last <= rows.first:
            return CouplingError(not_estimated="there were no steps")
        if not self._can_restore:
            return self._make_result(self._measure_differences(rows), DIFFERENCES)
        if self._has_changed:
            return CouplingError(not_estimated="inputs were set during the run")
        self._program = self._loop.halve(self._sampling)
        if self._program is None:
            return CouplingError(not_estimated="the algorithm combines signals, and some components sample")
        block, sweeps = algorithm.block.copy(), algorithm.sweeps
        try:
            self._pace = MOST_COST * pace
            return self._estimate(rows.first, last, allowed)
        except RunError as error:
            has_diverged = bool((rows.ranges > DIVERGED).any())  # which the run reports itself
            return CouplingError(
                not_estimated=f"steps could not be repeated: {error}", is_fault=not has_diverged
            )
        finally:
            algorithm.block[:], algorithm.steps, algorithm.sweeps = block, last, sweeps

    def note_change(self) -> None:
        """Record that something other than a step changes the system: steps cannot be repeated."""
        self._has_changed = self._rows is not None

    def close(self) -> None:
        """Free the saved states; never raises."""
        for snapshot in self._snapshots.values():
            snapshot.close()

    def _estimate(self, first: int, last: int, allowed: float) -> CouplingError:
        """Return the estimate for the steps from `first` to `last`."""
        assert self._rows is not None
        expected = self._rows.get(first, 1, min(CHECKED, last - first))
        if not np.array_equal(self._repeat(first, len(expected)), expected):
            why = "a restored state does not lead to the same results"
            return CouplingError(not_estimated=why, repeated_steps=self._repeated, is_fault=True)
        self._measure_cost(first, last, allowed)
        values = (last - first) * len(self._algorithm.network.signals)
        if self._pace * (last - first) <= allowed and values <= MOST_VALUES:
            return self._make_result(
                _find_largest(self._compute_errors_by_halves(first, last - first, self._rows.stride)),
                "the whole run",
            )
        return self._make_result(self._combine_windows(first, last, allowed), "windows")

    def _make_result(self, errors: Vector, repeated: str) -> CouplingError:
        """Return the result with these errors, limited to `HUGE`; `repeated` is as in `CouplingError`."""
        errors = np.where(np.isfinite(errors), np.minimum(errors, HUGE), HUGE)
        errors_by_signal = dict(zip(self._signals.tolist(), errors.tolist(), strict=True))
        return CouplingError(errors_by_signal, repeated, self._repeated)

    def _measure_differences(self, store: RowStore) -> Vector:
        """Return the rms of what inputs miss during a step, from differences of successive rows.

        A held input misses half of the change in a step, an extrapolated one half of the second difference.
        """
        order = self._algorithm.accuracy
        begins = self._window_starts if store.stride > 1 else self._window_starts[:1]
        rows = [store.get(begin - 1, 1, MOST_VALUES) for begin in begins]
        changes = np.concatenate([np.diff(r, n=order, axis=0) for r in rows])
        with np.errstate(all="ignore"):
            missed = 0.5 * np.sqrt(np.mean(changes**2, axis=0)) / store.ranges
        return np.where(store.ranges > 0.0, missed, 0.0) if len(changes) else np.zeros(len(store.ranges))

    def _measure_cost(self, first: int, last: int, allowed_s: float) -> None:
        """Time some steps in halves, in about a tenth of `allowed_s`, and steps that are longer.

        Set what a step in halves costs, and whether longer steps cost less than those they replace.
        """
        count, ratio = min(max(int(0.1 * allowed_s / self._pace), 2), MEASURED, last - first), GROWTH**2
        start_time = self._clock()
        self._repeat(first, count, program=self._program)
        halves_end = self._clock()
        self._pace = min((halves_end - start_time) / count, self._pace)
        if not self._sampling and count >= ratio:
            self._repeat(first, max(count // ratio, 1), ratio)
            coarse = (self._clock() - halves_end) / (max(count // ratio, 1) * ratio)
            self._is_coarse = coarse < WORTHWHILE * self._pace

    def _combine_windows(self, first: int, last: int, allowed: float) -> Vector:
        """Return the largest errors of all windows, each continued to the end of the run."""
        assert self._rows is not None
        begins = [b for b in self._snapshots if b < last]
        windows = [self._repeat_window(b, last, allowed / len(begins)) for b in begins]
        reached = np.max([w.reached for w in windows], axis=0)
        growth, path = (np.sum(x, axis=0) for x in ([w.growth for w in windows], [w.path for w in windows]))
        run_path, seen_fraction = self._rows.path, np.minimum(2.0 * path / len(windows), 1.0)
        with np.errstate(all="ignore"):
            rate = np.where(growth > 0.0, growth / path, 0.0)
            # windows shorter than a swing do not show whether errors add up
            onward = np.where(run_path > 1.0, run_path ** (UNSEEN + (1.0 - UNSEEN) * seen_fraction), run_path)
        return reached + np.nan_to_num(rate * onward, nan=0.0, posinf=HUGE)

    def _repeat_window(self, begin: int, last: int, allowed: float) -> _Window:
        """Repeat steps from `begin` for about `allowed` seconds, and return the errors in this window."""
        assert self._rows is not None
        available, deadline = len(self._rows.get(begin, 1, last - begin)), self._clock() + allowed
        # the rest of the time is for coarser steps, which look further ahead
        share = 0.4 if self._is_coarse else 1.0
        count = min(_round_down(max(share * allowed / self._pace, SHORTEST_WINDOW)), available)
        start_time, stride = self._clock(), 1
        errors = self._compute_errors_by_halves(begin, count, 1)
        per_step = (self._clock() - start_time) / count
        order, ranges = self._algorithm.accuracy, self._rows.ranges
        while self._is_coarse and stride * len(errors) < last - begin:
            multiple = stride * GROWTH
            affordable = (deadline - self._clock()) / (GROWTH * per_step)
            expected = self._rows.get(begin, multiple, _round_down(max(min(affordable, last - begin), 1.0)))
            # they would not even reach twice as far
            if multiple * len(expected) < 2 * stride * len(errors):
                break
            start_time = self._clock()
            change = _compare_signals(
                self._repeat(begin, len(expected), multiple)[: len(expected)], expected, ranges
            )
            per_step = (self._clock() - start_time) / len(expected)
            coarse = change / (multiple**order - 1.0)
            if len(coarse) < len(expected) or not _do_errors_agree(
                coarse, errors, multiple // stride, change
            ):
                break
            errors, stride = coarse, multiple
        rows = self._rows.get(begin, stride, len(errors))
        return _Window.of(errors, rows, ranges)

    def _compute_errors_by_halves(self, begin: int, count: int, stride: int) -> Vector:
        """Do `count` steps in halves, and return the errors of the run at every `stride`-th of them.

        They are relative to the ranges; one row of infinities if the halves failed.
        """
        assert self._rows is not None
        halved = self._repeat(begin, count, None, self._program, stride)
        expected = self._rows.get(begin, stride, len(halved))
        share = 1.0 - 0.5**self._algorithm.accuracy
        errors = _compare_signals(halved, expected, self._rows.ranges) / share
        if len(halved) < count // stride:  # the halves failed: they end far from the run
            errors = np.full((1, len(self._signals)), np.inf)
        return errors

    def _repeat(
        self,
        begin: int,
        count: int,
        multiple: int | None = None,
        program: HalvedProgram | None = None,
        stride: int = 1,
    ) -> Vector:
        """Repeat steps from a saved state, and return the signals at every `stride`-th one.

        Args:
            begin: Step of the state.
            count: Number of steps.
            multiple: Their length, as a multiple of a step; None for a step in the place of each.
            program: What a step does; None for the program of the algorithm.
            stride: Distance of the signals, in steps.
        """
        self._snapshots[begin].restore()
        times = self._times
        if multiple is None:
            first, clock = begin, times.clock
        else:
            first, clock = 0, make_clock(times.point(begin), multiple * times.step)
        rows, error = self._loop.repeat(first, count, clock, program)
        self._repeated += len(rows)
        if isinstance(error, InstanceError) and program is not None:
            raise error  # it does not show an error of the coupling; longer steps may be refused
        return rows[stride - 1 :: stride, self._signals]


def _do_errors_agree(coarse: Vector, fine: Vector, ratio: int, change: Vector) -> bool:
    """Return whether the error of coarse steps can be trusted; `ratio` is that of the distances of rows."""
    coarse_max = _find_largest(coarse[: max(len(fine) // ratio, 1)]).max()
    fine_max = _find_largest(fine).max()
    is_small = max(coarse_max, fine_max) < NEGLIGIBLE
    return bool(
        change.max() <= ASYMPTOTIC and (is_small or fine_max / AGREES <= coarse_max <= AGREES * fine_max)
    )


def _compare_signals(signals: Vector, expected: Vector, ranges: Vector) -> Vector:
    """Return the absolute differences of signals relative to their ranges, shape (rows, signals)."""
    with np.errstate(all="ignore"):
        difference = np.abs(signals - expected[: len(signals)]) / ranges
    return np.where(ranges > 0.0, np.nan_to_num(difference, nan=np.inf), 0.0)


def _find_largest(errors: Vector) -> Vector:
    """Return the largest error of each signal.

    An error in one row alone does not count in longer series: a jump that comes a step late ends with it.
    """
    lasting = np.minimum(errors[:-1], errors[1:]) if len(errors) > FEW_ROWS else errors
    return lasting.max(axis=0, initial=0.0)


def _round_down(count: float) -> int:
    """Return the largest power of two up to a number, so that small differences of time change nothing."""
    return 1 << max(int(count).bit_length() - 1, 0)
