"""The interface of step-size controls, and steps of one length."""

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from ...base.arrays import Vector
from ...base.crash_page import THREADS
from ...base.errors import CommandError
from ...base.option import option, options_of
from ..algorithms.algorithm import Algorithm
from ..instances.fmu_instance import DiscardedStepError
from .error_control import ErrorControl, default_largest_step
from .lanes import LaneChoice
from .step_division import StepDivision
from .stepping_base import ROUNDING, RowSink, Stepping
from .timing import CommunicationPoints

if TYPE_CHECKING:  # commands that only list options do not load fmpy
    from ..coupling.estimate import CouplingEstimate


class FixedSteps(Stepping):
    """Steps from one communication point to the next, in C."""

    def __init__(self, algorithm: Algorithm, times: CommunicationPoints, threads: int | None = 1) -> None:
        """Prepare for a run.

        Args:
            algorithm: An algorithm after `setup`.
            times: The communication points.
            threads: Number of threads; None uses up to one per core if measurements show that this is faster.

        Raises:
            CommandError: The number of threads is not supported.
            RunError: The C code cannot be built on this machine.
        """
        if threads is not None and not 1 <= threads <= THREADS:
            raise CommandError(f"the number of threads must be from 1 to {THREADS}, not {threads}.")
        super().__init__(algorithm, times)
        self.estimate: CouplingEstimate | None = None
        """Saves states and rows for an estimate of the coupling error, if the run has one."""
        self._division = StepDivision(algorithm, self.loop, times)
        self._lane_choice = None if threads == 1 else LaneChoice(self.loop, algorithm, threads)

    @property
    def time(self) -> float:
        """Present simulation time in s."""
        return self.times.point(self.algorithm.steps)

    @property
    def steps(self) -> int:
        """Steps done since the start time."""
        return self.algorithm.steps

    @property
    def finished(self) -> bool:
        """Whether the stop time is reached."""
        return self.algorithm.steps >= self.times.steps

    def advance(self, rows: RowSink, most: int, until: float = math.inf) -> None:
        """Do at most `most` steps, none beyond `until` in s, and record them."""
        last = min(self.algorithm.steps + most, self._find_last_step(until))
        if self._lane_choice is None:
            self._advance(rows, last)
        else:
            while self._advance_measured(self._lane_choice, rows, last):
                pass

    def allow_way_back(self) -> None:
        """Tell FMUs in each step that a state from before it may be restored."""
        self.loop.allow_way_back()

    def repeat_step(self, i: int, j: int, offset: float) -> None:
        """Do one step without recording it, with an offset to input j of instance i in its unit.

        Restore the state yourself to repeat it.

        Raises:
            RunError: The step failed.
        """
        network, first = self.algorithm.network, self.algorithm.steps
        no_rows = np.empty((0, 1 + len(network.signals) + len(network.observer.values)))
        self._division.require_new_state()
        self.loop.offset_input(i, j, offset)
        try:
            _, failure = self.loop.run(first, 1, self.times.clock, first + 2, no_rows)
        finally:
            self.loop.offset_input(i, j, 0.0)
        if failure is not None:
            raise failure

    def reached(self, until: float) -> bool:
        """Whether no step is left before a time in s."""
        return self.algorithm.steps >= self._find_last_step(until)

    def report(self) -> dict[str, Any]:
        """Add the use of threads to the report."""
        threads = self._lane_choice.report() if self._lane_choice is not None else {"threads": 1}
        return super().report() | self._division.report() | threads

    def remarks(self) -> list[str]:
        """Add what FMUs discarded."""
        return [*super().remarks(), *self._division.remarks()]

    def state_dict(self) -> dict[str, Vector]:
        """Add the discarded steps to the memory."""
        return super().state_dict() | self._division.state_dict()

    def load_state_dict(self, state: Mapping[str, Vector]) -> None:
        """Restore what `state_dict` of fixed steps with the same algorithm returned."""
        super().load_state_dict(state)
        self._division.load_state_dict(state)

    def note_change(self) -> None:
        """Record that something other than a step changes the system: earlier steps cannot be repeated."""
        self._division.require_new_state()
        if self.estimate is not None:
            self.estimate.note_change()

    def close(self) -> None:
        """Free the saved states, and what the stepping holds."""
        if self.estimate is not None:
            self.estimate.close()
        self._division.close()
        super().close()

    def _find_last_step(self, until: float) -> int:
        """Return the number of the last communication point up to a time in s, except for rounding."""
        ahead = (min(until, self.times.stop) - self.times.start) / self.times.step
        return min(self.times.steps, math.floor(ahead + ROUNDING))

    def _advance(self, rows: RowSink, last: int) -> None:
        """Do steps up to `last`, or fewer: if there is no room for rows, a text is due, or a step fails."""
        first, stride, observer = self.algorithm.steps, rows.steps_per_row, self.algorithm.network.observer
        self._division.save_if_due()
        if observer.strings:  # C cannot read texts
            last = min(last, observer.find_next_due(first))
        if self.estimate is not None:
            last = self.estimate.save_if_due(first, last)
        block = rows.room(max(last // stride - first // stride, 1))
        # up to the step before the first row without room
        last_fitting_step = (first // stride + len(block) + 1) * stride - 1
        count = min(last, last_fitting_step) - first
        recorded, failure = self.loop.run(first, count, self.times.clock, stride, block)
        if recorded and failure is None and observer.is_due(self.algorithm.steps):
            observer.read()
            block[recorded - 1, -len(observer.values) :] = observer.values
        if self.estimate is not None:
            self.estimate.record_rows(first + 1, block[:recorded])
        if recorded:
            rows.commit(recorded)
        if isinstance(failure, DiscardedStepError):
            row = (self.algorithm.steps // stride * stride, block[recorded - 1]) if recorded else None
            self._division.divide(failure, row)  # the row shows whether repeated steps have the same results
        elif failure is not None:
            raise failure

    def _advance_measured(self, choice: LaneChoice, rows: RowSink, last: int) -> bool:
        """Do one measurement's steps. Return whether more steps remain, and room for their rows."""
        first = self.algorithm.steps
        start_time, count = time.perf_counter(), choice.next(last - first)
        self._advance(rows, first + count)
        choice.record_steps(self.algorithm.steps - first, time.perf_counter() - start_time)
        return first + count == self.algorithm.steps < last


@dataclass(frozen=True)
class StepRequest:
    """What a run requires of its steps.

    Attributes:
        times: start time, stop time and step size, in s.
        interval: time between rows in s, if the user set it.
        sampled: whether a component computes at communication points only, as a digital controller does.
        threads: value of the option `threads`.
        events: returns the times in s at which inputs jump or bend.
        row_distance: returns the distance of rows in the data of inputs, in s.
    """

    times: CommunicationPoints
    interval: float | None
    sampled: bool
    threads: int | None
    events: Callable[[], Sequence[float]]
    row_distance: Callable[[], float]


class StepSizeControl(ABC):
    """Base class of step-size controls: decides how long the steps of a run are.

    A subclass is a dataclass; its fields made with `option` are its options.
    """

    is_regular: ClassVar[bool] = False
    """Whether all steps have the step size, so that every n-th step has a row."""

    is_halved: ClassVar[bool] = False
    """Whether each step is done in two halves, if steps are not regular."""

    def check(self) -> None:
        """Raise CommandError if values of options do not fit."""
        for declared_option in options_of(type(self)):
            declared_option.check(getattr(self, declared_option.name))

    @abstractmethod
    def make_stepping(self, algorithm: Algorithm, request: StepRequest) -> Stepping:
        """Return the stepping of a run.

        Args:
            algorithm: algorithm after its `setup`.
            request: what the run requires.

        Raises:
            CommandError: the run cannot be stepped in this way.
        """


@dataclass(eq=False)
class FixedStepSize(StepSizeControl):
    """Steps of one length."""

    is_regular = True

    def make_stepping(self, algorithm: Algorithm, request: StepRequest) -> Stepping:
        """Return steps of one length."""
        return FixedSteps(algorithm, request.times, request.threads)


@dataclass(eq=False)
class ErrorControlledStepSize(StepSizeControl):
    """Steps with a length that keeps the error within a tolerance."""

    is_halved = True

    error_tolerance: float | None = option(
        help="Adapt the step size to keep the error of the run below this fraction of each signal's size. "
        "Default: fixed steps.",
        above=0.0,
        below=1.0,
        identity="error tolerance",
    )
    largest_step: float | None = option(
        help="Longest step with --error-tolerance. Default: a fiftieth of the run's time, or the distance of "
        "rows in the data of --input.",
        unit="s",
        above=0.0,
        identity="largest step",
    )

    def check(self) -> None:
        """Raise CommandError for values of options that do not fit."""
        super().check()
        if self.error_tolerance is None and self.largest_step is not None:
            raise CommandError("--largest-step needs --error-tolerance. Set both, or neither.")
        if self.error_tolerance is None:
            raise CommandError("the step-size control 'error' needs --error-tolerance.")

    def make_stepping(self, algorithm: Algorithm, request: StepRequest) -> Stepping:
        """Return steps that the error controls."""
        assert self.error_tolerance is not None
        events, largest = request.events(), self.largest_step
        if largest is None:
            largest = min(default_largest_step(request.times), request.row_distance())
        return ErrorControl(
            algorithm,
            request.times,
            self.error_tolerance,
            request.interval,
            largest,
            events,
            request.sampled,
        )


STEP_SIZE_CONTROLS: dict[str, type[StepSizeControl]] = {
    "fixed": FixedStepSize,
    "error": ErrorControlledStepSize,
}
"""Step-size controls by name. Add a class to select it by its name.

Without a name, the control that has the user's options is selected; the default is the first.
"""
