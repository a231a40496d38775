"""Model and limits of a PMSM-driven EMLA for its controllers.

Each function takes the values of a block that declares the variables of `DriveController`.
"""

from typing import Any

from fmublock import clamp, maximum, minimum, sign, sqrt, where


def acceleration_per_current(v: Any) -> Any:
    """Return A_2 of (26): screw acceleration per q-axis current, in m/(s2 A)."""
    return 1.5 * v.N_p * v.Phi_PM / v.A_eq


def known_acceleration(v: Any, i_d: Any) -> Any:
    """Return g_2 of Table I in m/s2: acceleration by reluctance, friction and stiffness, without the load.

    `i_d` is the d-axis current in A: the measured one, or 0 if that is assumed.
    """
    reluctance = 1.5 * v.N_p * v.i_q * i_d * (v.L_d - v.L_q)
    return (reluctance - v.B_eq * v.v_hat - v.C_eq * v.x_hat) / v.A_eq


def holding_voltage(v: Any) -> tuple[Any, Any]:
    """Return the q- and d-axis voltage in V that keep the currents constant.

    They are -g_3 / A_3 and -g_4 / A_4 of Table I. They cover resistance, back-EMF and the coupling of the
    axes.
    """
    omega_e = v.N_p * v.alpha_RL * v.v_hat
    return v.R_s * v.i_q + omega_e * (v.i_d * v.L_d + v.Phi_PM), v.R_s * v.i_d - omega_e * v.i_q * v.L_q


def available_voltage(v: Any) -> Any:
    """Return the longest voltage vector in V: the inverter's, or less if the supply is low."""
    # a margin for rounding, so that no vector is longer than the limit
    return maximum(minimum(v.u_max, v.u_available), 0.0) * (1.0 - 1e-15)


def steady_voltage(v: Any) -> Any:
    """Return the available voltage in V without `u_reserve`, which is kept for changes of the currents."""
    return (1.0 - v.u_reserve) * available_voltage(v)


def left_by_emf(v: Any, u: Any) -> Any:
    """Return what the q-axis back-EMF leaves of a voltage u for the d-axis, in V; at least a tenth."""
    emf = v.N_p * v.alpha_RL * v.v_hat * (v.Phi_PM + v.L_d * v.i_d)
    return sqrt(maximum(u * u - emf * emf, 0.01 * u * u))


def within_voltage(v: Any, u_q: Any, u_d: Any) -> tuple[Any, Any, Any]:
    """Limit the voltage vector, with priority for the d-axis.

    The d-axis voltage decouples the axes. A vector shortened in proportion lacks it when the back-EMF is
    large, and the current loop fails. So u_d comes first, but only up to what the back-EMF leaves: without
    a voltage against the back-EMF, i_q would run away while braking.

    Returns:
        u_q and u_d in V, and 1 if the vector was too long, else 0.
    """
    u = available_voltage(v)
    first = left_by_emf(v, u)
    d = clamp(u_d, -first, first)
    rest = sqrt(maximum(u * u - d * d, 0.0))
    q = clamp(u_q, -rest, rest)
    return q, d, where(abs(q - u_q) + abs(d - u_d) > 0.0, 1.0, 0.0)


def reachable_flux(v: Any, u: Any) -> Any:
    """Return the largest flux linkage in Wb that a voltage u in V allows at this speed."""
    return u / maximum(abs(v.N_p * v.alpha_RL * v.v_hat), 1e-6)


def weakest_current(v: Any) -> Any:
    """Return the most negative i_d* in A: cancelled magnet flux, or 0.7 of i_max; 0 without weakening."""
    return -v.weaken_field * minimum(v.Phi_PM / v.L_d, 0.7 * v.i_max)


def current_limit(v: Any, u: Any) -> Any:
    """Return the largest |i_q*| in A: i_max less `i_reserve`, or what a voltage u can hold at this speed.

    The latter is with a weakened field. With more, the vector of L_q i_q and the magnet's flux would be
    longer than the reachable flux. A tenth of that is kept for i_q if nothing is left.
    """
    flux = reachable_flux(v, u)
    beside = v.Phi_PM + v.L_d * weakest_current(v)
    held = sqrt(maximum(flux * flux - beside * beside, 0.01 * flux * flux)) / v.L_q
    return minimum((1.0 - v.i_reserve) * v.i_max, held)


def weakening_current(v: Any, i_q_ref: Any, u: Any) -> Any:
    """Return the i_d* in A that reduces the flux until u can hold i_q*; 0 if it can without."""
    flux, across = reachable_flux(v, u), v.L_q * i_q_ref
    along = sqrt(maximum(flux * flux - across * across, 1e-4 * flux * flux))  # avoids the root of 0
    return clamp((along - v.Phi_PM) / v.L_d, weakest_current(v), 0.0)


def base_speed(v: Any, u: Any) -> Any:
    """Return the screw speed in m/s up to which u drives i_max without field weakening; R_s is left out."""
    flux, across = v.Phi_PM, v.L_q * v.i_max
    return u / (v.N_p * v.alpha_RL * sqrt(flux * flux + across * across))


def fastest(v: Any, u: Any) -> Any:
    """Return the largest |speed| in m/s to command: 95 % of v_max, at most the base speed for u.

    Above that, the back-EMF takes the voltage that braking needs. If the reference itself is that fast,
    2 % of its speed are added for corrections.
    """
    return maximum(minimum(0.95 * v.v_max, base_speed(v, u)), 1.02 * abs(v.v_d))


def braked(a_max: Any, k: Any, e: Any) -> tuple[Any, Any]:
    """Return the speed in m/s that corrects an error e in m, and its slope over e in 1/s.

    The speed is k e for small errors, then what `a_max` can brake: sqrt(2 a_max (|e| - a_max / (2 k^2))).
    """
    distance = abs(e)
    linear_range = a_max / (k * k)  # here the braking parabola touches the line; beyond, it is below
    braking = sqrt(2.0 * a_max * maximum(distance - 0.5 * linear_range, 0.5 * linear_range))
    is_linear = distance <= linear_range
    return where(is_linear, k * e, sign(e) * braking), where(is_linear, k, a_max / braking)


def approach(v: Any, k: Any, e: Any) -> tuple[Any, Any]:
    """Return the speed in m/s beside v_d that corrects an error e in m, and its slope over e in 1/s.

    It is that of `braked`. Together with v_d it is at most `fastest`.
    """
    wanted, slope = braked(v.a_max, k, e)
    most = fastest(v, available_voltage(v))
    w = clamp(v.v_d + wanted, -most, most) - v.v_d
    return w, where(abs(v.v_d + wanted) < most, slope, 0.0)
