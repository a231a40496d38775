"""Error control in plain Python, as an oracle for the one in C; see `plain_stepper.py`."""

import math
from typing import Any

import numpy as np

from emla_cosim.master.algorithms.operation_table import OperationTableAlgorithm
from emla_cosim.master.algorithms.snapshot import Snapshot
from emla_cosim.master.instances.fmu_instance import DiscardedStepError
from emla_cosim.master.stepping.control_tables import JUST_BEFORE, SHORT, UNREAD
from emla_cosim.master.stepping.error_control import CRAWLING_STEPS, ErrorControl
from emla_cosim.master.stepping.step_size_control import ErrorControlledStepSize, StepRequest
from emla_cosim.master.stepping.stepping_base import RowSink, Stepping
from tests.support.plain_stepper import PlainStepper

SAFETY, LARGEST_GROWTH, LARGEST_CUT = 0.9, 2.0, 0.2
EARLY, BENT, ROUNDING_ERROR, CRAWLING = 10.0, 0.1, 1e-12, 1e-2


class PlainErrorControl(ErrorControl):
    """The same points, rows and reports, with trials in Python."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        assert isinstance(self.algorithm, OperationTableAlgorithm)
        self.stepper, self.start = PlainStepper(self.algorithm), Snapshot(self.algorithm)
        self.first: tuple[float, np.ndarray] | None = None
        self.last: tuple[float, np.ndarray] | None = None
        self.jumped = np.zeros(len(self._tables.signals), dtype=bool)

    def _try_steps(self, rows: RowSink, most: int, until: float) -> int:
        control, step_size = self._control, self.times.step
        point, output, is_event = self._next_point(until)
        remaining, step = point - self.time, min(control.step, control.longest)
        if step >= remaining * (1.0 - 1e-9):
            step = remaining
        elif 2.0 * step > remaining:
            step = 0.5 * remaining
        is_met = step == remaining
        end = point if is_met else self.time + step
        is_leap = is_event and is_met and step <= 2.0 * JUST_BEFORE * step_size
        if not self.try_step(step, end, is_leap):
            return 1
        self.algorithm.network.check_finite(end)
        control.time = end
        if self.watch is not None:
            self.watch(end, self.algorithm.network.signals)
        if is_met:
            self._points += output
            if is_event:
                self.algorithm.exchange.begin(end)
        if self._output is None or (is_met and output):
            self.record(rows)
        return 1

    def try_step(self, step: float, end: float, is_leap: bool) -> bool:
        """Try a step. Return whether it was accepted; otherwise all is as before."""
        control, tables = self._control, self._tables
        self.stepper.see()
        self.start.take()
        try:
            errors = self.try_doubled_step(end)
        except DiscardedStepError:
            self.start.restore()
            control.rejected += 1
            self.shrink(step, 0.5)
            if control.step < control.shortest:
                raise
            return False
        if is_leap and np.isfinite(errors).all():
            self.first = self.last = None
            control.accepted += 1
            return True
        signals, allowed = tables.signals, self.tolerance
        if control.is_per_unit:
            passed = self.time - self.times.start + step + EARLY * self.times.step
            allowed = max(self.tolerance * step / passed, ROUNDING_ERROR)
        jumps = np.zeros(len(errors), dtype=bool)
        if self.first is not None and step <= 0.5 * self.first[0]:
            jumps = (errors > allowed) & (errors > 0.9 * self.first[1]) & ~self.jumped
        is_beside, is_instant = signals["is_beside"] != 0, signals["is_instant"] != 0
        if step < UNREAD * self.times.step:
            jumps |= is_beside
        judged = np.where(jumps | (signals["is_judged"] == 0), 0.0, errors)
        once = is_instant | (step < SHORT * self.times.step)
        if self.last is not None:
            once |= errors > 0.6 * step / self.last[0] * self.last[1]
        shares = judged / np.where(once, max(BENT * self.tolerance, allowed), allowed)
        if not self.judge(step, float(shares.max(initial=0.0))):
            if control.step < control.shortest:
                control.worst, control.end = int(signals["signal"][shares.argmax()]), end
                raise self._too_short_error()
            self.first, self.last = self.first or (step, errors), (step, errors)
            self.start.restore()
            return False
        self.first, self.last, self.jumped = None, None, jumps & ~is_beside
        tables.total += np.where(is_instant & bool(control.is_per_unit), 0.0, judged)
        control.short_steps = control.short_steps + 1 if step < CRAWLING * self.times.step else 0
        if control.is_per_unit and control.short_steps == CRAWLING_STEPS:
            self._judge_each_step()
        return True

    def try_doubled_step(self, end: float) -> np.ndarray:
        """Do a step as a whole, restore, and do it in halves. Return the errors relative to the sizes."""
        signals, time = self.algorithm.network.signals, self.time
        controlled, middle = self._tables.signals, time + 0.5 * (end - time)
        which = controlled["signal"]
        self.stepper.step(time, end - time)
        whole = signals[which]
        self.start.restore()
        self.stepper.step(time, middle - time)
        self.stepper.step(middle, end - middle)
        with np.errstate(invalid="ignore"):  # infinity minus infinity
            difference = (signals[which] - whole) / self._control.divisor
        errors = self.stepper.algorithm.scale.relative(difference, which)
        errors[(controlled["is_unread"] != 0) & ~np.isfinite(errors)] = 0.0
        return errors

    def judge(self, step: float, error: float) -> bool:
        """Return whether a step is accepted, and set the next one; errors are relative to what is allowed."""
        control, exponent = self._control, self._control.exponent
        error = 1e-10 if error < 1e-10 else error
        if not error <= 1.0:
            control.rejected += 1
            self.shrink(step, SAFETY * error**-exponent if error < math.inf else LARGEST_CUT)
            return False
        growth = SAFETY * error**-exponent
        if not step < control.step:
            growth = SAFETY * error ** (-0.7 * exponent) * control.last_error ** (0.4 * exponent)
            control.last_error = error
        proposed = max(step * min(LARGEST_GROWTH, max(LARGEST_CUT, growth)), control.shortest)
        proposed = min(proposed, max(control.longest, step))
        control.step = proposed if step >= 0.5 * control.step else max(proposed, control.step)
        control.accepted += 1
        return True

    def shrink(self, step: float, factor: float) -> None:
        self._control.step = step * max(LARGEST_CUT, min(factor, SAFETY))

    def close(self) -> None:
        self.start.close()
        self.stepper.close()
        super().close()


class PlainErrorControlledStepSize(ErrorControlledStepSize):
    """The step-size control of `PlainErrorControl`, for the option of this name of a run."""

    def stepping(self, algorithm: Any, request: StepRequest) -> Stepping:
        assert self.error_tolerance is not None
        return PlainErrorControl(
            algorithm,
            request.times,
            self.error_tolerance,
            request.interval,
            events=request.events(),
            sampled=request.sampled,
        )
