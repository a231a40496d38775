"""Control the step size by the error, which is estimated from one whole step and two halves."""

import math
import time
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...base.arrays import Vector
from ...base.errors import CommandError, RunError
from ...stepper.layout import Failure
from ..algorithms.algorithm import Algorithm, require
from .control_tables import EVENT_STEP_FRACTION, SHORT_STEP_FRACTION, ControlTables
from .stepping_base import LONGEST, ROUNDING, RowSink, Stepping
from .timing import CommunicationPoints, make_clock

LARGEST_SHARE, SHORTEST_LIMIT = 50, 10
"""Default limit of a step: a `LARGEST_SHARE`-th of the run, at least `SHORTEST_LIMIT` first steps."""

REMARK_THRESHOLD = 10.0
"""Sum of all errors above which a remark is added, as a multiple of the tolerance."""


class ErrorControl(Stepping):
    """Step doubling with rollback.

    The error is estimated from one step and two steps of half the length: their difference, divided by
    2^p - 1 for an algorithm of order p. The result of the halves is kept. Errors are relative to the
    sizes of all continuous signals; see `Scale`. The error of a signal is ignored at its jumps, once the
    step is short.

    The error *per unit step* is controlled: a step of length h from t may have the error

        tolerance h / (t - t_start + h + h_longest)

    All steps together then add up to at most tolerance ln(1 + T / h_longest) in the time T, wherever the run
    stops: four times the tolerance with the default for h_longest. `remarks` reports the sum if it is larger.
    It may be in runs of a million steps: with order 1 (held inputs) steps are in proportion to the tolerance.
    Steps shorter than a millionth of the run are only done where a single one is inaccurate.

    If a component is `sampled`, every communication point may be a jump. There every step may have an error
    of the tolerance. Then only connected outputs are controlled, and all outputs of instances without
    connected outputs.

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

        Raises:
            CommandError: An instance cannot restore its state, cannot vary its step, or has a step multiple.
            RunError: The C code cannot be built on this machine.
        """
        if any(algorithm.exchange.rare):
            raise CommandError(
                "step multiples need fixed steps. Remove the error tolerance or the multiples."
            )
        instances = algorithm.network.instances
        require(instances, "rolls_back", "canGetAndSetFMUstate", "error control")
        require(instances, "varies_step", "canHandleVariableCommunicationStepSize", "error control")
        super().__init__(algorithm, times)
        self.tolerance, self._sampled = tolerance, sampled
        longest = largest or default_largest_step(times)
        self.loop.allow_way_back()  # each step may be repeated
        self._states = self.loop.make_states()
        self._tables = ControlTables(algorithm, times, tolerance, longest, self._states)
        self.control = self._tables.control
        if sampled:
            self._tables.control_error(algorithm.accuracy, per_unit=False)
        else:
            self.loop.tighten_coupling_tolerance(
                SHORT_STEP_FRACTION * tolerance
            )  # which steps of this length are allowed
        self._events = _list_event_points(events, times)
        self._output = None if interval is None else make_clock(times.start, interval)
        self._end = _find_last_point(times, interval)
        self._output_points = 0

    @property
    def time(self) -> float:
        """Present simulation time in s."""
        return float(self.control.time)

    @property
    def steps(self) -> int:
        """Accepted steps since the start time, each of two halves."""
        return int(self.control.accepted)

    @property
    def finished(self) -> bool:
        """Whether the stop time is reached."""
        return self.time >= self._end

    def advance(self, rows: RowSink, most: int, until: float = math.inf) -> None:
        """Do at most `most` steps, none beyond `until` in s, and record them."""
        deadline = time.monotonic() + LONGEST
        while most > 0 and not (self.reached(until) or time.monotonic() > deadline):
            most -= self._try_steps(rows, most, until)

    def _try_steps(self, rows: RowSink, most: int, until: float) -> int:
        """Try steps to the next point, at most `most`, and return how many were tried."""
        control, observer = self.control, self.algorithm.network.observer
        control.point, output, is_event = self._find_next_point(until)
        control.is_event = is_event
        control.enough = min(self._end, until - ROUNDING * self.times.step)
        records_all = self._output is None
        is_single = records_all and bool(observer.strings)  # C cannot read texts
        block = rows.room(most) if records_all and not is_single else None
        accepted = control.accepted
        end_reason, failure = self.loop.control(control, 1 if is_single else most, block)
        if block is not None and (recorded := self.loop.recorded):
            rows.commit(recorded)
        if end_reason == Failure.TOO_SHORT:
            raise self._make_too_short_error()
        if failure is not None:
            raise failure
        if control.is_met:
            self._output_points += output
            if is_event:
                self.algorithm.exchange.begin(self.time)  # do not extrapolate across a jump
                control.coarse_time = math.nan
        if (control.is_met and output and not records_all) or (is_single and control.accepted > accepted):
            self.record(rows)
        return int(control.tried)

    def report(self) -> dict[str, Any]:
        """Return the report with rejected steps, the longest step, and the largest sum of errors."""
        control = self.control
        return super().report() | {
            "rejected_steps": int(control.rejected),
            "largest_step_s": float(control.longest),
            "estimated_error": float(self._get_relative_errors().max(initial=0.0)),
            "error_per_unit_step": bool(control.is_per_unit),
        }

    def _get_relative_errors(self) -> Vector:
        """Return the errors of all steps, relative to the sizes of the controlled signals."""
        return self.algorithm.scale.relative(self._tables.total, self._tables.signals["signal"])

    def notes(self) -> list[str]:
        """Return a note if the tolerance may not bound the error of the run."""
        if self._sampled:
            return ["a component samples: the error tolerance bounds the error of a step, not of the run"]
        if self.algorithm.accuracy == 1:
            return [
                "inputs are held during a step, or extrapolated by the master: the error of a run is in "
                "proportion to its steps. If a million steps are not enough for the error tolerance, a "
                "remark gives the error"
            ]
        return []

    def remarks(self) -> list[str]:
        """Add a remark if the errors of all steps add up to far more than the tolerance."""
        errors, base_remarks = self._get_relative_errors(), super().remarks()
        total = errors.max(initial=0.0)
        if not total > REMARK_THRESHOLD * self.tolerance:
            return base_remarks
        if self._sampled:
            reason = (
                "a component samples, and the tolerance bounds the error of one step only. If the motion is "
                "damped, the error of the run is smaller than the sum."
            )
        elif self.algorithm.accuracy == 1:
            reason = (
                "held inputs would need more than a million steps. Set --extrapolation fmu if the FMUs "
                "interpolate inputs, or a larger tolerance."
            )
        else:
            reason = (
                "signals bend or jump too often, or more than a million steps are needed. Set "
                "--largest-step, or another tolerance."
            )
        return [
            *base_remarks,
            f"the errors of all steps add up to {total:.2g} of the size of "
            f"{self._get_name(int(self._tables.signals['signal'][errors.argmax()]))}, which is "
            f"{total / self.tolerance:.2g} times the error tolerance {self.tolerance:.3g}: {reason}",
        ]

    def state_dict(self) -> dict[str, Vector]:
        """Add the state of error control to the memory."""
        points = np.array([float(self._output_points)])
        return super().state_dict() | self._tables.state_dict() | {"control/points": points}

    def load_state_dict(self, state: Mapping[str, Vector]) -> None:
        """Restore what `state_dict` of an error control with the same algorithm returned."""
        super().load_state_dict(state)
        self._output_points = int(state["control/points"][0])
        self._tables.load_state_dict(state)

    def close(self) -> None:
        """Free the saved states, and what the stepping holds."""
        self._states.free(self.algorithm.network.instances)
        super().close()

    def _find_next_point(self, until: float) -> tuple[float, bool, bool]:
        """Return the next time in s to reach exactly, whether to record it, and whether it is an event."""
        next_output = math.inf if self._output is None else self._output.point(self._output_points + 1)
        next_row = min(next_output, self._end)
        k = bisect_right(self._events, self.time)
        event = self._events[k] if k < len(self._events) else math.inf
        rounding = ROUNDING * self.times.step
        if until < min(next_row, event) - rounding:
            return until, False, False
        if event < next_row:
            return event, False, True
        return next_row, True, event == next_row

    def _make_too_short_error(self) -> RunError:
        """Return the error of a step that is too short: a signal is not finite, or the error too large."""
        control = self.control
        failure = self.algorithm.network.find_nonfinite_signal(control.end)
        text = (
            f"the error exceeds its tolerance even with a step of {control.step:.2g} s. "
            f"{self._get_name(control.worst)} differs most."
        )
        warning = None if self.steps else self.algorithm.warning()  # later, that of any failure is reported
        return failure or RunError(text if warning is None else f"{text} {warning}")

    def _get_name(self, signal: int) -> str:
        return self.algorithm.network.names[signal]


def default_largest_step(times: CommunicationPoints) -> float:
    """Return the default limit of a step in s: a fiftieth of the run's time, at least ten first steps."""
    return max((times.stop - times.start) / LARGEST_SHARE, SHORTEST_LIMIT * times.step)


def _list_event_points(events: Sequence[float], times: CommunicationPoints) -> list[float]:
    """Return the times of events within the run, each with a point just before it, in order.

    The step over a jump is so short that interpolation between its ends makes no difference.
    """
    within_run = [t for t in events if times.start < t <= times.stop]
    return sorted({t - lead for t in within_run for lead in (0.0, EVENT_STEP_FRACTION * times.step)})


def _find_last_point(times: CommunicationPoints, interval: float | None) -> float:
    """Return the stop time in s, rounded to a multiple of the interval if it is one up to rounding errors."""
    if interval is None:
        return times.stop
    point = make_clock(times.start, interval).point(round((times.stop - times.start) / interval))
    return point if abs(point - times.stop) <= 1e-9 * interval else times.stop
