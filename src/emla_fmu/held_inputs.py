"""Inputs that a host holds over a step, though they move during it."""

from typing import Any

from fmublock import clamp, maximum


def interpolate(v: Any, before: Any, held: Any) -> Any:
    """Return the value of a held input during a step, on a line from its value in the last step.

    A host that steps the source first holds the value of the step's end, half a step too early. The line
    takes as long as the last step.

    Args:
        v: Values of the block: `time`, the last step's end `t_before` and its length `h_before` in s.
        before: The input in the last step.
        held: The input in this step, of the same unit.
    """
    part = clamp((v.time - v.t_before) / maximum(v.h_before, 1e-12), 0.0, 1.0)
    return before + part * (held - before)
