"""A signal that fails on its way, as that of an encoder that freezes or jumps."""

from enum import IntEnum
from typing import Any

from fmublock import Block, DefaultExperiment, DiscreteState, Input, Output, Parameter, logical_and, where

from .schedule import NEVER

_ROUNDING = 1e-9
"""By so much in s a communication point may miss the beginning or the end."""


class FaultKind(IntEnum):
    """What becomes of the signal."""

    NONE = 1
    FREEZE = 2
    OFFSET = 3
    GAIN = 4
    CONSTANT = 5


class SignalFault(Block):
    """Passes a signal on, but for a time during which it fails.

    Before and after, y is u to the last bit. A freeze keeps the value of the communication point before
    it begins; one that begins at the start of a run keeps that of the first point after.
    """

    default_experiment = DefaultExperiment(stop_time=1.0, step_size=1e-3)

    u = Input(0.0, description="Signal as it is")

    kind = Parameter(FaultKind.NONE, description="What becomes of the signal")
    start = Parameter(NEVER, unit="s", symbol="t_0", description="Time at which the fault begins")
    duration = Parameter(NEVER, unit="s", minimum=0.0, symbol="T", description="Time that it lasts")
    value = Parameter(0.0, symbol="w", description="Offset, gain or constant")

    frozen = DiscreteState(0.0, symbol="u_-", description="Value that a freeze keeps")
    known = DiscreteState(0.0, description="1 once there is such a value")

    y = Output(description="Signal as its receivers get it")
    active = Output(description="1 while the fault lasts")

    def update(self, v: Any) -> dict[str, Any]:
        """Remember the signal as long as it is good."""
        keeps = logical_and(self.lasts(v), v.known > 0.0)
        return {"frozen": where(keeps, v.frozen, v.u), "known": 1.0}

    def outputs(self, v: Any) -> dict[str, Any]:
        """The signal as factor u - less, of which neither changes a bit of u while there is no fault."""
        lasts = self.lasts(v)
        freezes = logical_and(v.kind == FaultKind.FREEZE, v.known > 0.0)
        constant = v.kind == FaultKind.CONSTANT
        factor = where(freezes, 0.0, where(constant, 0.0, where(v.kind == FaultKind.GAIN, v.value, 1.0)))
        adds = where(constant, v.value, where(v.kind == FaultKind.OFFSET, v.value, 0.0))
        less = -where(freezes, v.frozen, adds)
        return {
            "y": where(lasts, factor, 1.0) * v.u - where(lasts, less, 0.0),
            "active": where(logical_and(lasts, v.kind != FaultKind.NONE), 1.0, 0.0),
        }

    def lasts(self, v: Any) -> Any:
        """Whether the present time is within the fault's."""
        since = v.time - v.start + _ROUNDING
        return logical_and(since >= 0.0, since < v.duration)
