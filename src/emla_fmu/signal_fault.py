"""Faults of a signal, such as an encoder's that freezes or jumps."""

import math
from typing import Any

from fmublock import (
    Block,
    DefaultExperiment,
    DiscreteState,
    Input,
    Output,
    Parameter,
    clamp,
    logical_and,
    where,
)

from .schedule import NEVER

_ROUNDING = 1e-9
"""Rounding in s of a communication point at the fault's beginning or end."""

_LARGE = 1e300
"""A signal that is larger or infinite counts as this, where its factor is 0."""


class SignalFault(Block):
    """Passes a signal on, except during a fault.

    During the fault, y is gain * u + offset, or frozen. Before and after it, y has the same bits as u, and
    is -inf if u is no number. A freeze keeps the value of the communication point before the fault. If the
    fault begins at the start of a run, it keeps that of the first point.
    """

    default_experiment = DefaultExperiment(stop_time=1.0, step_size=1e-3)

    u = Input(0.0, description="Signal before the fault")

    start = Parameter(NEVER, unit="s", symbol="t_0", description="Time at which the fault begins")
    duration = Parameter(NEVER, unit="s", minimum=0.0, symbol="T", description="Duration of the fault")
    freeze = Parameter(False, description="Whether the signal keeps its value, without gain and offset")
    gain = Parameter(1.0, symbol="g", description="Factor of the signal during the fault; 0 for a constant")
    offset = Parameter(0.0, symbol="w", description="Value added to the signal, or the constant")

    frozen = DiscreteState(0.0, symbol="u_-", description="Frozen value")
    known = DiscreteState(0.0, description="1 when the frozen value is known")

    y = Output(description="Signal after the fault")
    active = Output(description="1 while the fault lasts")

    def update(self, v: Any) -> dict[str, Any]:
        """Store the signal while there is no fault."""
        keeps = logical_and(self.lasts(v), v.known > 0.0)
        return {"frozen": where(keeps, v.frozen, v.u), "known": 1.0}

    def outputs(self, v: Any) -> dict[str, Any]:
        """Return the signal as factor * u - less, which keeps all bits of u while there is no fault."""
        lasts = self.lasts(v)
        known = logical_and(v.freeze, v.known > 0.0)
        factor = where(lasts, where(known, 0.0, where(v.freeze, 1.0, v.gain)), 1.0)
        less = -where(known, v.frozen, where(v.freeze, 0.0, v.offset))
        limit = where(factor == 0.0, _LARGE, math.inf)  # 0 times infinity is not 0
        return {
            "y": factor * clamp(v.u, -limit, limit) - where(lasts, less, 0.0),
            "active": where(lasts, 1.0, 0.0),
        }

    def lasts(self, v: Any) -> Any:
        """Return whether the fault is active at the present time."""
        since = v.time - v.start + _ROUNDING
        return logical_and(since >= 0.0, since < v.duration)
