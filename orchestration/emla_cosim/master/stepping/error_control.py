"""Control the step size by the error, which is estimated from one whole step and two halves."""

import math
import time
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ...base.arrays import Indices, Vector
from ...base.errors import CommandError, RunError
from ..algorithms.algorithm import Algorithm, require
from ..algorithms.scale import Scale
from ..algorithms.snapshot import Snapshot
from ..instances.fmu_instance import DiscardedStepError
from .compilation import COMPILED, compile_trials
from .controlled_signals import ControlledSignals, TrialState
from .step_control import StepControl
from .stepping_base import LONGEST, ROUNDING, RowSink, Stepping
from .timing import CommunicationPoints, make_clock

if TYPE_CHECKING:
    from .trial_kernel import TrialKernel

SMALLEST = 1e-6
"""Smallest step, as a fraction of the first step."""

ROUNDING_ERROR = 1e-12
"""Errors below this fraction of a signal are rounding errors. Shorter steps do not reduce them."""

LARGEST_SHARE, SHORTEST_LIMIT = 50, 10
"""Default limit of a step: a `LARGEST_SHARE`-th of the run, at least `SHORTEST_LIMIT` first steps."""

EARLY = 10
"""Number of first steps that is added to the elapsed time when the tolerance is shared among steps."""

JUST_BEFORE = 1e-5
"""Length of the step that ends at an event, as a fraction of the first step."""

SHORT = 1e-5
"""Steps shorter than this fraction of the first one may have an error of `BENT` times the tolerance."""

UNREAD = 1e-2
"""Unread outputs shorten no step below this fraction of the first one, if others of the FMU are read."""

BENT = 0.1
"""Fraction of the tolerance for the error of a step over a bend, and for errors that do not add up."""

CRAWLING, CRAWLING_STEPS = 1e-2, 200
"""Step length (as a fraction of the first step) and number of such steps that show a jump at every point."""

REMARK_THRESHOLD = 10.0
"""Sum of all errors above which a remark is added, as a multiple of the tolerance."""


class ErrorControl(Stepping):
    """Step doubling with rollback.

    The error is estimated from one step and two steps of half the length: their difference, divided by
    2^p - 1 for an algorithm of order p. The result of the halves is kept. Errors are relative to the
    sizes of all continuous signals; see `Scale`. The error of a signal is ignored at its jumps, once the
    step is short.

    With order 2, the error *per unit step* is controlled: a step of length h from t may have the error

        tolerance h / (t - t_start + h + 10 h_first)

    All steps together then add up to at most tolerance ln(1 + T / 10 h_first) in the time T. That is seven
    times the tolerance after 10,000 first steps, wherever the run stops.

    With order 1 (held inputs) this would need steps in proportion to the tolerance. There every step may
    have an error of the tolerance, and `remarks` reports the sum of all errors. The same applies if a
    component is `sampled`, or if the step sizes show a jump at every point. Then only connected outputs
    are controlled, and all outputs of instances without connected outputs.

    The first trial step is the step of `times`. With an `interval` in s, its multiples are reached
    exactly, and only they are recorded. Without it, every accepted step is recorded.

    L. F. Shampine: Local error control in codes for ordinary differential equations, Appl. Math. Comput. 3
    (1977), doi:10.1016/0096-3003(77)90003-2, on errors per step and per unit step.
    """

    def __init__(
        self,
        algorithm: Algorithm,
        times: CommunicationPoints,
        tolerance: float,
        interval: float | None = None,
        largest: float | None = None,
        events: Sequence[float] = (),
        sampled: bool = False,
        compiled: bool = True,
    ) -> None:
        """Prepare for a run.

        Args:
            algorithm: An algorithm after `setup`.
            times: Start time, stop time and first trial step.
            tolerance: Allowed error, as a fraction of each signal's size.
            interval: Time between recorded rows in s; None records every accepted step.
            largest: Longest step in s; None is a fiftieth of the run's time.
            events: Times in s at which inputs jump or bend; steps end there.
            sampled: Whether a component computes at communication points, as a digital controller does.
            compiled: Whether to compile the steps if possible.

        Raises:
            CommandError: An instance cannot restore its state, cannot vary its step, or has a step multiple.
        """
        super().__init__(algorithm, times)
        if any(algorithm.exchange.rare):
            raise CommandError(
                "step multiples need fixed steps. Remove the error tolerance or the multiples."
            )
        instances = algorithm.network.instances
        require(instances, "rolls_back", "canGetAndSetFMUstate", "error control")
        require(instances, "varies_step", "canHandleVariableCommunicationStepSize", "error control")
        self.tolerance = tolerance
        self._sampled = sampled
        self._per_unit = algorithm.accuracy > 1 and not sampled
        longest = largest or default_largest_step(times)
        power = algorithm.accuracy + (0 if self._per_unit else 1)
        self.control = StepControl(min(times.step, longest), power, SMALLEST * times.step, longest)
        self._events = _event_points(events, times)
        self._output = None if interval is None else make_clock(times.start, interval)
        self._end = _last_point(times, interval)
        self._time = times.start
        self._points = 0
        self._start = Snapshot(algorithm)
        self._scale = Scale(algorithm.network)
        self._rejected: tuple[float, Vector] | None = None
        """The first rejected step from the present point, and its errors; None without one."""
        self._last_rejected: tuple[float, Vector] | None = None
        """The last rejected step from the present point, and its errors; None without one."""
        self._judged = _find_controlled_signals(algorithm)
        self._jumped = np.zeros(len(self._judged), dtype=bool)
        """Per controlled signal, whether it jumped in the last step."""
        self._sum: Vector = np.zeros(len(self._judged))
        """Sum of the errors of all steps so far, relative to the sizes."""
        self._unread = ~np.isin(self._judged, algorithm.network.read)
        self._looked_at = ~self._unread | _find_unread_signals(algorithm)[self._judged] | (not sampled)
        """Per controlled signal, whether its error can reject a step."""
        self._beside = self._unread & ~_find_unread_signals(algorithm)[self._judged]
        """Unread signals of instances with other signals that are read."""
        self._short_steps = 0
        """Number of successive steps far shorter than the first one."""
        late = {link.target for link in algorithm.late() if link.direct}
        self._instant = np.isin(algorithm.exchange.owners[self._judged], list(late))
        """Signals that depend directly on an extrapolated input: their errors do not add up."""
        can_compile = compiled and not algorithm.network.observer.strings
        self._kernel = compile_trials(algorithm) if can_compile else None
        if self._kernel is not None:
            limits = (2.0 * JUST_BEFORE, UNREAD, SHORT, CRAWLING)
            self._kernel.prepare(
                self._controlled(),
                self._scale,
                tolerance,
                times.start,
                times.step,
                tuple(limit * times.step for limit in limits),
            )

    @property
    def is_compiled(self) -> bool:
        """Whether compiled code does the steps."""
        return self._kernel is not None

    @property
    def time(self) -> float:
        """Present simulation time in s."""
        return self._time

    @property
    def steps(self) -> int:
        """Accepted steps since the start time, each of two halves."""
        return self.control.accepted

    @property
    def finished(self) -> bool:
        """Whether the stop time is reached."""
        return self._time >= self._end

    def advance(self, rows: RowSink, most: int, until: float = math.inf) -> None:
        """Do at most `most` steps, none beyond `until` in s, and record them."""
        if self.watch is not None and self._time == self.times.start:
            self.watch(self._time, self.algorithm.network.signals)
        ends = time.monotonic() + LONGEST
        while most > 0 and not (self.reached(until) or time.monotonic() > ends):
            if self._kernel is None:
                self._advance_here(rows, until)
                most -= 1
            else:
                most -= self._advance_compiled(self._kernel, rows, most, until)

    def _advance_here(self, rows: RowSink, until: float) -> None:
        """Try one step in Python."""
        point, output, event = self._next_point(until)
        step = self.control.propose(point - self._time)
        met = step == point - self._time
        end = point if met else self._time + step
        leap = event and met and step <= 2.0 * JUST_BEFORE * self.times.step
        if not self._try_step(step, end, leap):
            return
        self.algorithm.network.check_finite(end)
        self._time = end
        if self.watch is not None:
            self.watch(end, self.algorithm.network.signals)
        if met:
            self._meet(output, event)
        if (met and output) or self._output is None:
            self.record(rows)

    def _meet(self, output: bool, event: bool) -> None:
        """Note that the next point is reached: whether to record it, and whether it is an event."""
        self._points += output
        if event:
            self.algorithm.exchange.begin(self._time)  # do not extrapolate across a jump

    def _advance_compiled(self, kernel: "TrialKernel", rows: RowSink, most: int, until: float) -> int:
        """Try steps to the next point, at most `most`, and return how many were tried."""
        point, output, event = self._next_point(until)
        block = rows.room(most) if self._output is None else None
        state = TrialState(
            self._time, self.control, self._rejected, self._last_rejected, self._jumped, self._short_steps
        )
        enough = min(self._end, until - ROUNDING * self.times.step)
        watches = self.watch is not None
        done = kernel.try_steps(state, self._per_unit, (point, event, enough), most, block, watches)
        self._time, self._short_steps, self._jumped = state.time, state.short_steps, state.jumped
        self._rejected, self._last_rejected = state.rejected, state.last_rejected
        if self.watch is not None:
            for row in done.watched:
                self.watch(float(row[0]), row[1:])
        if done.crawls:
            self._judge_each_step()
        if done.recorded:
            rows.commit(done.recorded)
        if isinstance(done.failure, DiscardedStepError):
            kernel.restore()
            self._discard(done.length, done.failure)
        elif done.failure is not None:
            raise done.failure
        if done.met:
            self._meet(output, event)
            if output and self._output is not None:
                self.record(rows)
        if done.needs_python:
            self._advance_here(rows, until)
            return done.tried + 1
        return done.tried

    def report(self) -> dict[str, Any]:
        """Add how the steps were made, and the sum of the errors, to the report."""
        return {
            **super().report(),
            **({"compiled": self.is_compiled} if isinstance(self.algorithm, COMPILED) else {}),
            "rejected_steps": self.control.rejected,
            "largest_step_s": self.control.largest,
            "estimated_error": float(self._sum.max(initial=0.0)),
            "error_per_unit_step": self._per_unit,
        }

    def remarks(self) -> list[str]:
        """Return a remark if the errors of all steps add up to far more than the tolerance."""
        if self._sampled or not self._sum.max(initial=0.0) > REMARK_THRESHOLD * self.tolerance:
            return []
        worst, total = self.algorithm.network.names[self._judged[self._sum.argmax()]], self._sum.max()
        reason = (
            "inputs bend or jump too often. Set a smaller tolerance, or shorter steps with --largest-step."
            if self._per_unit
            else "with held inputs the tolerance bounds the error of one step only. Set --extrapolation fmu "
            "if the FMUs interpolate inputs, or a smaller tolerance."
        )
        return [
            f"the errors of all steps add up to {total:.2g} of the size of {worst}, which is "
            f"{total / self.tolerance:.2g} times the error tolerance {self.tolerance:.3g}: {reason}"
        ]

    def memory(self) -> dict[str, Vector]:
        """Add the present time and the state of the step control to the memory."""
        control = self.control
        progress = [self._time, self._points, control.step, control.last_error]
        counts = [control.accepted, control.rejected]
        nothing = (np.nan, np.full(len(self._judged), np.nan))
        (step, errors), (last_step, last_errors) = self._rejected or nothing, self._last_rejected or nothing
        return super().memory() | {
            "control": np.array([*progress, *counts], dtype=float),
            "control/tried": np.array([step, *errors]),
            "control/tried_last": np.array([last_step, *last_errors]),
            "control/jumped": self._jumped.astype(float),
            "control/largest": self._scale.largest,
            "control/sum": self._sum,
            "control/sampled": np.array([float(self._sampled), float(self._short_steps)]),
        }

    def remember(self, memory: Mapping[str, Vector]) -> None:
        """Restore the state from `memory` of an error control with the same algorithm."""
        super().remember(memory)
        time, points, step, last_error, accepted, rejected = (float(x) for x in memory["control"])
        self._time, self._points = time, int(points)
        control = self.control
        control.step, control.last_error = step, last_error
        control.accepted, control.rejected = int(accepted), int(rejected)
        self._scale.largest[:] = memory["control/largest"]
        self._sum[:] = memory["control/sum"]
        was_sampled, short = memory["control/sampled"]
        if was_sampled and not self._sampled:
            self._judge_each_step()
        self._short_steps = int(short)
        self._rejected = _read_rejected_step(memory["control/tried"])
        self._last_rejected = _read_rejected_step(memory["control/tried_last"])
        self._jumped = memory["control/jumped"] > 0.0

    def close(self) -> None:
        """Free the saved states."""
        self._start.close()
        if self._kernel is not None:
            self._kernel.close()

    def _next_point(self, until: float) -> tuple[float, bool, bool]:
        """Return the next time in s to reach exactly, whether to record it, and whether it is an event."""
        following = math.inf if self._output is None else self._output.point(self._points + 1)
        recorded = min(following, self._end)
        k = bisect_right(self._events, self._time)
        event = self._events[k] if k < len(self._events) else math.inf
        rounding = ROUNDING * self.times.step
        if until < min(recorded, event) - rounding:
            return until, False, False
        if event < recorded:
            return event, False, True
        return recorded, True, event == recorded

    def _try_step(self, step: float, end: float, leap: bool) -> bool:
        """Try the step to `end`. Return whether it was accepted; otherwise the previous state is restored.

        The error of a `leap` over an event is not checked.
        """
        self._start.take()
        self._scale.see()
        try:
            errors = self._try_doubled_step(end)
        except DiscardedStepError as discarded:
            self._start.restore()
            self._discard(step, discarded)
            return False
        if leap and np.isfinite(errors).all():
            self._rejected = self._last_rejected = None
            self.control.accepted += 1
            return True
        allowed = self._allowed(step)
        jumps = self._jumps(step, errors, allowed)
        if step < UNREAD * self.times.step:
            jumps |= self._beside
        judged = np.where(jumps | ~self._looked_at, 0.0, errors)
        once = self._instant | self._bends(step, errors) | (step < SHORT * self.times.step)
        shares = judged / np.where(once, max(BENT * self.tolerance, allowed), allowed)
        try:
            accepted = self.control.judge(step, float(shares.max(initial=0.0)))
        except RunError as too_small:
            name = self.algorithm.network.names[self._judged[shares.argmax()]]
            failure = self.algorithm.network.find_nonfinite_signal(self._time + step)
            raise failure or RunError(f"{too_small} {name} differs most.") from None
        if accepted:
            self._rejected, self._last_rejected, self._jumped = None, None, jumps & ~self._beside
            self._sum += np.where(self._instant & self._per_unit, 0.0, judged)
            self._short_steps = self._short_steps + 1 if step < CRAWLING * self.times.step else 0
            if self._per_unit and self._short_steps == CRAWLING_STEPS:
                self._judge_each_step()
        else:
            self._rejected, self._last_rejected = self._rejected or (step, errors), (step, errors)
            self._start.restore()
        return accepted

    def _discard(self, step: float, discarded: DiscardedStepError) -> None:
        """Shorten the next step after a discarded one; raise `discarded` if it would be too short."""
        try:
            self.control.discard(step)
        except RunError:
            raise discarded from None

    def _try_doubled_step(self, end: float) -> Vector:
        """Do a step as a whole, restore, and do it in halves. Return the errors relative to the sizes."""
        algorithm, time = self.algorithm, self._time
        signals, middle = algorithm.network.signals, time + 0.5 * (end - time)
        algorithm.step(time, end - time)
        whole = signals[self._judged]
        self._start.restore()
        algorithm.step(time, middle - time)
        algorithm.step(middle, end - middle)
        with np.errstate(invalid="ignore"):  # infinity minus infinity
            difference = (signals[self._judged] - whole) / (2.0**algorithm.accuracy - 1.0)
        errors = self._scale.relative(difference, self._judged)
        errors[self._unread & ~np.isfinite(errors)] = 0.0  # unread signals may be infinite
        return errors

    def _judge_each_step(self) -> None:
        """Control the error of each step instead of the error per unit step; see the class."""
        self._per_unit, self._sampled = False, True
        self.control.power = self.algorithm.accuracy + 1
        self._looked_at = ~self._unread | _find_unread_signals(self.algorithm)[self._judged]
        if self._kernel is not None:
            self._kernel.use(self._controlled())

    def _controlled(self) -> ControlledSignals:
        return ControlledSignals(
            self._judged, self._unread, self._looked_at, self._beside, self._instant, self._sum
        )

    def _allowed(self, step: float) -> float:
        """Return the allowed error of a step from the present point, relative to the sizes."""
        if not self._per_unit:
            return self.tolerance
        passed = self._time - self.times.start + step + EARLY * self.times.step
        return max(self.tolerance * step / passed, ROUNDING_ERROR)

    def _jumps(self, step: float, errors: Vector, allowed: float) -> NDArray[np.bool_]:
        """Return which signals jump: their error is too large, and as large as in a much longer step.

        A signal does not jump twice in a row: an unstable coupling would look the same. Unread signals,
        such as noise, may jump in every step.
        """
        if self._rejected is None or step > 0.5 * self._rejected[0]:
            return np.zeros(len(errors), dtype=bool)
        return (errors > allowed) & (errors > 0.9 * self._rejected[1]) & ~self._jumped

    def _bends(self, step: float, errors: Vector) -> NDArray[np.bool_]:
        """Return which errors are proportional to the step: inputs were extrapolated over a bend.

        No step is short enough for the tolerance per unit step there.
        """
        if self._last_rejected is None:
            return np.zeros(len(errors), dtype=bool)
        longer, found = self._last_rejected
        return errors > 0.6 * step / longer * found


def _read_rejected_step(memory: Vector) -> tuple[float, Vector] | None:
    """Return a rejected step and its errors; None if there was none."""
    return None if np.isnan(memory[0]) else (float(memory[0]), memory[1:].copy())


def default_largest_step(times: CommunicationPoints) -> float:
    """Return the default limit of a step in s: a fiftieth of the run's time, at least ten first steps."""
    return max((times.stop - times.start) / LARGEST_SHARE, SHORTEST_LIMIT * times.step)


def _event_points(events: Sequence[float], times: CommunicationPoints) -> list[float]:
    """Return the times of events within the run, each with a point just before it, in order.

    The step over a jump is so short that interpolation between its ends makes no difference.
    """
    inside = [t for t in events if times.start < t <= times.stop]
    return sorted({t - before for t in inside for before in (0.0, JUST_BEFORE * times.step)})


def _find_unread_signals(algorithm: Algorithm) -> NDArray[np.bool_]:
    """Return which signals belong to an instance without any signal that is read."""
    network = algorithm.network
    read = np.zeros(len(network.signals), dtype=bool)
    read[network.read] = True
    found = np.zeros(len(read), dtype=bool)
    for part in network.parts:
        found[part] = not read[part].any()
    return found


def _find_controlled_signals(algorithm: Algorithm) -> Indices:
    """Return all continuous signals. Unread ones also depend on states, such as the speed behind a force."""
    return np.flatnonzero(algorithm.exchange.smooth)


def _last_point(times: CommunicationPoints, interval: float | None) -> float:
    """Return the stop time in s, rounded to a multiple of the interval if it is one up to rounding errors."""
    if interval is None:
        return times.stop
    point = make_clock(times.start, interval).point(round((times.stop - times.start) / interval))
    return point if abs(point - times.stop) <= 1e-9 * interval else times.stop
