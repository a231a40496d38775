"""What error control and its compiled trials share: the controlled signals, and what a trial changes."""

from dataclasses import dataclass
from typing import Any

from ...base.arrays import Indices, Vector
from .step_control import StepControl


@dataclass
class TrialState:
    """What changes from trial to trial.

    Attributes:
        time: present time in s.
        control: the step control.
        rejected: the first rejected step from the present point, and its errors; None without one.
        last_rejected: the last one.
        jumped: per controlled signal, whether it jumped in the last step.
        short_steps: number of successive short steps.
    """

    time: float
    control: StepControl
    rejected: tuple[float, Vector] | None
    last_rejected: tuple[float, Vector] | None
    jumped: Any
    short_steps: int


@dataclass(frozen=True)
class ControlledSignals:
    """The signals whose errors are controlled; see `ErrorControl`."""

    judged: Indices
    unread: Any
    looked_at: Any
    beside: Any
    instant: Any
    total: Vector
