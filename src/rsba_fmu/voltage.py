"""What the inverter's limited voltage leaves: field that has to be weakened, and speed that it allows.

Functions on numbers and on symbols alike. d-q quantities are amplitude-invariant (peak), lengths of
vectors in V and A.
"""

from typing import Any

from fmublock import clamp, logical_and, maximum, minimum, sign, sqrt, where


def weakened_field(v: Any, i_q: Any, omega_e: Any, u_max: Any) -> tuple[Any, Any]:
    """i_d* in A that lets i_q flow at the speed omega_e (rad/s) within u_max, and how much i_q can be.

    In steady state, without R_s i_d: v_d = -omega_e L_q i_q takes its part of u_max, and of the rest
    v_q = R_s i_q + omega_e (L_d i_d + Phi_PM) decides on i_d. It is never positive and never beyond
    the point where the magnet's flux is gone, -Phi_PM / L_d, where all of u_max drives i_q.
    """
    speed = maximum(abs(omega_e), 1e-6)
    gone = v.Phi_PM / v.L_d
    reachable = u_max / (speed * v.L_q)
    limited = clamp(i_q, -reachable, reachable)
    cross = speed * v.L_q * limited
    left = sqrt(maximum(u_max * u_max - cross * cross, 0.0))
    # seen along the direction of motion, a current that drives adds to what back-EMF takes
    resistive = v.R_s * limited * sign(omega_e)
    return clamp(((left - resistive) / speed - v.Phi_PM) / v.L_d, -gone, 0.0), reachable


def known_limit(v: Any) -> Any:
    """Longest voltage vector in V: as measured where the drive does that, else u_max as known."""
    return where(logical_and(v.measure_supply, v.u_available > 0.0), minimum(v.u_available, v.u_max), v.u_max)


def base_speed(v: Any, u_max: Any) -> Any:
    """Screw speed in m/s up to which u_max drives i_max without a weakened field; R_s left out."""
    flux, cross = v.Phi_PM, v.L_q * v.i_max
    return u_max / (v.N_p * v.alpha_RL * sqrt(flux * flux + cross * cross))
