"""The stops at the ends of the stroke: functions of the plant's values `v`."""

from typing import Any

from fmublock import maximum, where


def stop_force(v: Any) -> Any:
    """Force of both end stops on the screw in N, positive where it pushes the actuator out."""
    inward = maximum(v.q_LB - v.x_L, 0.0)
    outward = maximum(v.x_L - v.q_UB, 0.0)
    return where(inward > 0.0, _contact(v, inward, -v.v_L), 0.0) - where(
        outward > 0.0, _contact(v, outward, v.v_L), 0.0
    )


def _contact(v: Any, depth: Any, approach: Any) -> Any:
    """Force in N of a stop that is pressed in by `depth` m at the speed `approach` (Hunt and Crossley, 1975).

    k depth^2 (1 + c approach) would pull where it is released faster than 1 / c; there
    1 / (1 - c approach) takes the factor's place, which continues it smoothly and stays above zero.
    """
    damping = v.stop_damping * approach
    size = abs(damping)
    return v.stop_stiffness * depth * depth * where(damping >= 0.0, 1.0 + size, 1.0 / (1.0 + size))
