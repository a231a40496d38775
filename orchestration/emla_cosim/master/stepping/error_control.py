"""Steps as long as the error allows, found by doing every step twice: whole, and in halves."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arrays import Indices, Vector
from ...errors import CommandError, RunError
from ..algorithms.algorithm import Algorithm, require
from ..algorithms.scale import Scale
from ..algorithms.snapshot import Snapshot
from ..slaves.slave import StepDiscardedError
from .step_control import StepControl
from .stepping import ROUNDING, Rows, Stepping
from .timing import Timing, clock

SMALLEST = 1e-6
"""The smallest step, as a fraction of the first one."""


class ErrorControl(Stepping):
    """Step doubling with rollback.

    The difference between one step and two of half the length, divided by 2^p - 1 for an
    algorithm of order p, estimates the error of the halves, which are kept. A step is accepted
    when this error is at most `tolerance` of the size of every continuous signal that a slave
    reads, or that belongs to a slave which nobody reads; see `Scale`. A signal that jumps is not
    judged there, once the step has become short.

    The first step tried is that of `times`. With an `interval` in s, its multiples are met
    exactly and only they are recorded; without, every accepted step is.
    """

    def __init__(
        self, algorithm: Algorithm, times: Timing, tolerance: float, interval: float | None = None
    ) -> None:
        """Take an algorithm that is set up; CommandError where its slaves cannot go back."""
        super().__init__(algorithm, times)
        if any(algorithm.exchange.rare):
            raise CommandError("step multiples need fixed steps; leave out the error tolerance or them.")
        slaves = algorithm.network.slaves
        require(slaves, "rolls_back", "canGetAndSetFMUstate", "error control")
        require(slaves, "varies_step", "canHandleVariableCommunicationStepSize", "error control")
        self.tolerance = tolerance
        self.control = StepControl(times.step, algorithm.accuracy, SMALLEST * times.step)
        self._output = None if interval is None else clock(times.start, interval)
        self._end = _last_point(times, interval)
        self._time = times.start
        self._points = 0
        self._start = Snapshot(algorithm)
        self._scale = Scale(algorithm.network)
        self._rejected: tuple[float, Vector] | None = None
        """The first step tried from here, and its errors, if it was rejected."""
        self._judged = _judged(algorithm)
        self._jumped = np.zeros(len(self._judged), dtype=bool)
        """Which signals were found to jump in the last step."""
        self._unread = ~np.isin(self._judged, algorithm.network.read)

    @property
    def time(self) -> float:
        """Where the simulation is, in s."""
        return self._time

    @property
    def steps(self) -> int:
        """Steps accepted since the start time, each of two halves."""
        return self.control.accepted

    @property
    def finished(self) -> bool:
        """Whether the stop time is reached."""
        return self._time >= self._end

    def advance(self, rows: Rows, most: int, until: float = math.inf) -> None:
        """Do at most so many steps, none beyond `until` in s, and record them."""
        if self.watch is not None and self._time == self.times.start:
            self.watch(self._time, self.algorithm.network.signals)
        for _ in range(most):
            if self.reached(until):
                return
            point, output = self._next_point(until)
            step = self.control.propose(point - self._time)
            met = step == point - self._time
            end = point if met else self._time + step
            if not self._tried(step, end):
                continue
            self.algorithm.network.check_finite(end)
            self._time = end
            if self.watch is not None:
                self.watch(end, self.algorithm.network.signals)
            self._points += met and output
            if (met and output) or self._output is None:
                self.record(rows)

    def report(self) -> dict[str, Any]:
        """Also how many steps were rejected."""
        return {**super().report(), "rejected_steps": self.control.rejected}

    def memory(self) -> dict[str, Vector]:
        """Also where the simulation is, and what the step control knows."""
        control = self.control
        progress = [self._time, self._points, control.step, control.last_error]
        counts = [control.accepted, control.rejected]
        step, errors = self._rejected or (np.nan, np.full(len(self._judged), np.nan))
        return super().memory() | {
            "control": np.array([*progress, *counts], dtype=float),
            "control/tried": np.array([step, *errors]),
            "control/jumped": self._jumped.astype(float),
            "control/largest": self._scale.largest,
        }

    def remember(self, memory: Mapping[str, Vector]) -> None:
        """Take over what an error control of the same algorithm remembered."""
        super().remember(memory)
        time, points, step, last_error, accepted, rejected = (float(x) for x in memory["control"])
        self._time, self._points = time, int(points)
        control = self.control
        control.step, control.last_error = step, last_error
        control.accepted, control.rejected = int(accepted), int(rejected)
        self._scale.largest[:] = memory["control/largest"]
        step, *errors = memory["control/tried"]
        self._rejected = None if np.isnan(step) else (float(step), np.array(errors))
        self._jumped = memory["control/jumped"] > 0.0

    def close(self) -> None:
        """Free the saved states."""
        self._start.close()

    def _next_point(self, until: float) -> tuple[float, bool]:
        """The next time in s to be met exactly, and whether it is one to be recorded."""
        following = math.inf if self._output is None else self._output.point(self._points + 1)
        recorded = min(following, self._end)
        if until < recorded - ROUNDING * self.times.step:
            return until, False
        return recorded, True

    def _tried(self, step: float, end: float) -> bool:
        """Whether the step to `end` was done and is good enough; if not, everything is as before."""
        self._start.take()
        self._scale.see()
        try:
            errors = self._doubled(end)
        except StepDiscardedError as discarded:
            self._start.restore()
            try:
                self.control.discard(step)
            except RunError:
                raise discarded from None
            return False
        jumps = self._jumps(step, errors)
        judged = np.where(jumps, 0.0, errors)
        try:
            accepted = self.control.judge(step, float(judged.max(initial=0.0)) / self.tolerance)
        except RunError as too_small:
            name = self.algorithm.network.names[self._judged[judged.argmax()]]
            failure = self.algorithm.network.not_finite(self._time + step)
            raise failure or RunError(f"{too_small} {name} differs most.") from None
        if accepted:
            self._rejected, self._jumped = None, jumps
        else:
            self._rejected = self._rejected or (step, errors)
            self._start.restore()
        return accepted

    def _doubled(self, end: float) -> Vector:
        """Do a step whole, go back, and do it in halves; returns the error relative to the sizes."""
        algorithm, time = self.algorithm, self._time
        signals, middle = algorithm.network.signals, time + 0.5 * (end - time)
        algorithm.step(time, end - time)
        whole = signals[self._judged]
        self._start.restore()
        algorithm.step(time, middle - time)
        algorithm.step(middle, end - middle)
        with np.errstate(invalid="ignore"):  # infinity less infinity
            difference = (signals[self._judged] - whole) / (2.0**algorithm.accuracy - 1.0)
        errors = self._scale.relative(difference, self._judged)
        errors[self._unread & ~np.isfinite(errors)] = 0.0  # what nobody reads may be infinite
        return errors

    def _jumps(self, step: float, errors: Vector) -> NDArray[np.bool_]:
        """Which signals jump: their error is too large, and as large as in a much longer step.

        Not those that did so in the step before, because an unstable coupling looks the same.
        """
        if self._rejected is None or step > 0.5 * self._rejected[0]:
            return np.zeros(len(errors), dtype=bool)
        return (errors > self.tolerance) & (errors > 0.9 * self._rejected[1]) & ~self._jumped


def _judged(algorithm: Algorithm) -> Indices:
    """Continuous signals that are read, and all continuous signals of slaves of which none is read."""
    network = algorithm.network
    judged = np.zeros(len(network.signals), dtype=bool)
    judged[network.read] = True
    for part in network.parts:
        judged[part] |= not judged[part].any()
    return np.flatnonzero(judged & algorithm.exchange.smooth)


def _last_point(times: Timing, interval: float | None) -> float:
    """The stop time in s, without the rounding by which it may differ from a multiple of the interval."""
    if interval is None:
        return times.stop
    point = clock(times.start, interval).point(round((times.stop - times.start) / interval))
    return point if abs(point - times.stop) <= 1e-9 * interval else times.stop
