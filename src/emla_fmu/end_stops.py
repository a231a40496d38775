"""The stops at the ends of the stroke: functions of the plant's values `v`."""

from typing import Any

from fmublock import maximum, where


def stop_force(v: Any) -> Any:
    """Return the force of both end stops on the screw in N, positive if it pushes the actuator out."""
    inward = maximum(v.q_LB - v.x_L, 0.0)
    outward = maximum(v.x_L - v.q_UB, 0.0)
    return where(inward > 0.0, _contact(v, inward, -v.v_L), 0.0) - where(
        outward > 0.0, _contact(v, outward, v.v_L), 0.0
    )


def _contact(v: Any, depth: Any, approach: Any) -> Any:
    """Return the force in N of a stop pressed in by `depth` m at the speed `approach` in m/s.

    k depth^2 (1 + c approach) (Hunt and Crossley, 1975) would pull if the stop is released faster than 1 / c.
    On release the factor is therefore 1 / (1 - c approach), which continues smoothly and stays
    above zero.
    """
    damping = v.stop_damping * approach
    size = abs(damping)
    return v.stop_stiffness * depth * depth * where(damping >= 0.0, 1.0 + size, 1.0 / (1.0 + size))
