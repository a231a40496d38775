"""The interface of step-size controls, and the controls of this project."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

from ...base.errors import CommandError
from ...base.option import option, options_of
from ..algorithms.algorithm import Algorithm
from .error_control import ErrorControl, default_largest_step
from .fixed_steps import FixedSteps
from .stepping_base import Stepping
from .timing import CommunicationPoints


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
        """Return what does the steps of a run.

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
