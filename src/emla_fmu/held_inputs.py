"""Inputs that a host holds over a step, though they move during it.

A host that steps the source first holds the value of the step's end, half a step too early. With the
parameter `interpolate` of a block, they move on a line from the value in the last step, which takes as long
as that step.

Functions of the block's values `v`: `interpolate`, the last step's end `t_before` and its length `h_before`
in s.
"""

from typing import Any

from fmublock import clamp, logical_and, maximum, where


def has_begun(v: Any) -> Any:
    """Return whether there was a step before this one."""
    return v.h_before > 0.0


def is_moving(v: Any) -> Any:
    """Return whether held inputs are interpolated."""
    return logical_and(v.interpolate, has_begun(v))


def interpolated(v: Any, held: Any, before: Any) -> Any:
    """Return the present value of an input.

    Args:
        v: Values of the block.
        held: The input in this step.
        before: The input in the last step, of the same unit.
    """
    part = clamp((v.time - v.t_before) / maximum(v.h_before, 1e-12), 0.0, 1.0)
    return where(is_moving(v), before + part * (held - before), held)
