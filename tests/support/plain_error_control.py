"""Error control in plain Python, as an oracle for the one in C; see `plain_stepper.py`."""

from collections import Counter
from typing import Any

import numpy as np

from emla_cosim.base.errors import RunError
from emla_cosim.master.instances.fmu_instance import DiscardedStepError
from emla_cosim.master.stepping.checkpoint import Snapshot
from emla_cosim.master.stepping.control_tables import EVENT_STEP_FRACTION, SHORT_STEP_FRACTION
from emla_cosim.master.stepping.error_control import ErrorControl
from emla_cosim.master.stepping.step_size_control import ErrorControlledStepSize, StepRequest
from emla_cosim.master.stepping.stepping_base import RowSink, Stepping
from tests.support.plain_stepper import PlainStepper
from tests.support.step_control import StepControl

INSTANT_FRACTION, DIVERGENCE, ROUNDING_ERROR, CHATTERING = 0.1, 0.1, 1e-12, 10


class PlainErrorControl(ErrorControl):
    """The same points, rows and reports, with trials in Python."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.stepper, self.start = PlainStepper(self.algorithm), Snapshot(self.algorithm)
        if self.control.is_per_unit:
            self.stepper.coupling_tolerance = min(
                self.stepper.coupling_tolerance, SHORT_STEP_FRACTION * self.tolerance
            )
        self.coarse, self.next_coarse = np.zeros((2, len(self.algorithm.restored)))
        self.first: tuple[float, np.ndarray] | None = None
        self.jumped = np.zeros(len(self._tables.signals), dtype=int)
        self.rules = Counter[str]()
        """How often each rule for errors has applied."""

    def _try_steps(self, rows: RowSink, most: int, until: float) -> int:
        control, step_size = self.control, self.times.step
        point, output, is_event = self._find_next_point(until)
        step = self.sizes().propose(point - self.time)
        is_met = step == point - self.time
        end = point if is_met else self.time + step
        is_leap = is_event and is_met and step <= 2.0 * EVENT_STEP_FRACTION * step_size
        if not self.try_step(step, end, is_leap):
            return 1
        self.algorithm.network.check_finite(end)
        control.time = end
        if is_met:
            self._output_points += output
            if is_event:
                self.algorithm.exchange.begin(end)
                control.coarse_time = np.nan
        if self._output is None or (is_met and output):
            self.record(rows)
        return 1

    def try_step(self, step: float, end: float, is_leap: bool) -> bool:
        """Try a step. Return whether it was accepted; otherwise all is as before."""
        control, tables, sizes = self.control, self._tables, self.sizes()
        self.stepper.see()
        self.start.save()
        try:
            errors = self.try_doubled_step(end)
        except DiscardedStepError as discarded:
            self.start.restore()
            try:
                self.use(sizes, sizes.discard, step)
            except RunError:
                raise discarded from None
            return False
        if is_leap and np.isfinite(errors).all():
            self.first = None
            control.accepted += 1
            return True
        count, allowed = len(errors), self.tolerance
        signals = tables.signals[:count]
        if control.is_per_unit:
            passed = self.time - self.times.start + step + control.longest
            allowed = max(self.tolerance * step / passed, ROUNDING_ERROR)
        is_unread, is_instant = signals["is_unread"] != 0, signals["is_instant"] != 0
        jumps = np.zeros(count, dtype=bool)
        if self.first is not None and step <= 0.5 * self.first[0]:
            may_jump = is_unread | (self.jumped[:count] == 0)
            jumps = (errors > allowed) & (errors > 0.9 * self.first[1]) & may_jump
            self.rules["jump"] += int(jumps.any())
        chatters = is_unread & (self.jumped[:count] >= CHATTERING)
        self.rules["chatter"] += int(chatters.any())
        compared = np.where(jumps | chatters, 0.0, errors)
        instant_limit = max(INSTANT_FRACTION * self.tolerance, allowed)
        relative = float((compared / np.where(is_instant, instant_limit, allowed)).max(initial=0.0))
        brief = compared / np.where(
            is_instant, DIVERGENCE if control.is_per_unit else instant_limit, instant_limit
        )
        if control.is_per_unit:
            brief[is_unread] = 0.0
        self.rules["brief"] += int(step <= control.short_limit and relative > 1.0)
        try:
            is_accepted = self.use(sizes, sizes.judge, step, relative, float(brief.max(initial=0.0)))
        except RunError:
            control.worst, control.end = int(signals["signal"][brief.argmax()]), end
            raise self._make_too_short_error() from None
        if not is_accepted:
            self.first = self.first or (step, errors)
            self.start.restore()
            return False
        self.first = None
        if control.is_per_unit:
            self.coarse[:], control.coarse_time = self.next_coarse, end
        self.jumped[:count] = jumps + np.where(is_unread, self.jumped[:count], 0)
        total, sizes_now = tables.total[:count], self.algorithm.scale.sizes(signals["signal"])
        total[:] = np.where(is_instant, np.maximum(total, compared * sizes_now), total + compared * sizes_now)
        return True

    def sizes(self) -> StepControl:
        """Return the controller of the step size in its present state."""
        control = self.control
        return StepControl(
            control.step,
            round(1.0 / control.exponent),
            control.shortest,
            control.longest,
            control.accepted,
            control.rejected,
            control.last_error,
            control.short_limit,
        )

    def use(self, sizes: StepControl, call: Any, *arguments: float) -> Any:
        """Call a method of the controller, and keep its new state."""
        control = self.control
        try:
            return call(*arguments)
        finally:
            control.step, control.last_error = sizes.step, sizes.last_error
            control.accepted, control.rejected = sizes.accepted, sizes.rejected

    def try_doubled_step(self, end: float) -> np.ndarray:
        """Do a step as a whole, restore, and do it in halves. Return the errors relative to the sizes."""
        signals, time = self.algorithm.network.signals, self.time
        controlled = self._tables.signals[: self.control.controlled_count]
        middle = time + 0.5 * (end - time)
        which = controlled["signal"]
        if self.control.coarse_time == time:
            self.algorithm.restored[:] = self.coarse
        self.stepper.step(time, end - time)
        self.next_coarse[:] = self.algorithm.restored
        full_step = signals[which]
        self.start.restore()
        self.stepper.step(time, middle - time)
        self.stepper.step(middle, end - middle)
        with np.errstate(invalid="ignore"):  # infinity minus infinity
            difference = (signals[which] - full_step) / self.control.divisor
        errors = self.stepper.algorithm.scale.relative(difference, which)
        errors[(controlled["is_unread"] != 0) & ~np.isfinite(errors)] = 0.0
        return errors

    def close(self) -> None:
        self.start.close()
        self.stepper.close()
        super().close()


class PlainErrorControlledStepSize(ErrorControlledStepSize):
    """The step-size control of `PlainErrorControl`, for the option of this name of a run."""

    def make_stepping(self, algorithm: Any, request: StepRequest) -> Stepping:
        assert self.error_tolerance is not None
        self.made = PlainErrorControl(
            algorithm,
            request.times,
            self.error_tolerance,
            request.interval,
            self.largest_step,
            events=request.events(),
            sampled=request.sampled,
        )
        return self.made
