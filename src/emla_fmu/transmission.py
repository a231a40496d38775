"""Compliance and backlash between screw and load: functions of the plant's values `v`."""

from typing import Any

from fmublock import maximum, minimum, where


def force(v: Any) -> Any:
    """Return the force in N with which the screw pushes the load; negative if it pulls.

    Without backlash it is that of a spring and a damper in parallel.
    """
    speed = v.v_L - v.v_load
    return where(v.backlash > 0.0, contact_force(v, speed), v.stiffness * v.deflection + v.damping * speed)


def contact_force(v: Any, speed: Any) -> Any:
    """Return the force in N with backlash, for the speed of the deflection in m/s.

    Within the play there is none. Beyond it, a contact pushes and never pulls. Its damping grows from 0 to
    the full one over a depth of half the play, so that the force does not jump on contact. For a small play
    this is the spring and damper of a transmission without it.
    """
    half = 0.5 * v.backlash
    side = where(v.deflection >= 0.0, 1.0, -1.0)
    depth = maximum(abs(v.deflection) - half, 0.0)
    touching = minimum(depth / where(half > 0.0, half, 1.0), 1.0)
    return side * maximum(v.stiffness * depth + v.damping * touching * side * speed, 0.0)
