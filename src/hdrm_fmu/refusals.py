"""Conditions on the manipulator's parameters, beside the ranges of single values, with their messages.

`p` is any object with the attributes of HdrmParameters. `name` returns the name for messages of an
attribute, or of an element of it, which it gets counted from 0.
"""

from collections.abc import Callable
from typing import Any

Name = Callable[..., str]


def geometry(p: Any, name: Name) -> dict[str, Any]:
    """Return the conditions on triangles and strokes by message."""
    demands: dict[str, Any] = {}
    for i in range(3):
        demands |= _above(name("q_UB", i), p.q_UB[i], name("q_LB", i), p.q_LB[i])
    for i, joint in enumerate(("lift", "tilt")):
        for end in ("q_LB", "q_UB"):
            demands |= closes(p, joint, getattr(p, end)[i], name(end, i), name)
    return demands


def closes(p: Any, joint: str, q: Any, q_name: str, name: Name) -> dict[str, Any]:
    """Return two conditions that the triangle of `joint` closes at the stroke q, by message."""
    a, b, L_0 = (f"{joint}_{side}" for side in ("a", "b", "L_0"))
    side_a, side_b, L = getattr(p, a), getattr(p, b), getattr(p, L_0) + q
    opened = f"the {joint} triangle cannot close: {name(L_0)} + {q_name} must be"
    return {
        f"{opened} above |{name(a)} - {name(b)}|": L > abs(side_a - side_b),
        f"{opened} below {name(a)} + {name(b)}": L < side_a + side_b,
    }


def _above(high: str, high_value: Any, low: str, low_value: Any) -> dict[str, Any]:
    return {f"the stroke is empty: {high} must be above {low}": high_value > low_value}
