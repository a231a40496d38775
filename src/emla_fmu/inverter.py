"""The inverter, averaged over a PWM period: computing delay, voltage limit, dead time.

Functions of the plant's values `v`. Voltages and currents are amplitude-invariant d-q quantities.
"""

import math
from typing import Any

from fmublock import cos, floor, limit_magnitude, maximum, minimum, sin, sqrt, where

from . import motion_law

LONGEST_DELAY = 32
"""Largest delay of a voltage in communication steps."""

_OLDER = LONGEST_DELAY - 1
_ROOT_3 = math.sqrt(3.0)


def available_voltage(v: Any) -> Any:
    """Return the longest voltage vector in V that the inverter can generate with the present supply."""
    return v.u_max * (1.0 - v.sag)


def motor_voltage(v: Any) -> tuple[Any, Any, Any]:
    """Return the inverter's u_q and u_d in V, and whether the voltage that takes effect now is limited."""
    late = v.delay > 0.0
    demand_q, demand_d = where(late, v.u_q_late, v.u_q), where(late, v.u_d_late, v.u_d)
    u_q, u_d, saturated = limit_magnitude(demand_q, demand_d, available_voltage(v))
    e_q, e_d = dead_time_error(v)
    return u_q + e_q, u_d + e_d, saturated


def dead_time_error(v: Any) -> tuple[Any, Any]:
    """Return the mean q- and d-axis voltage in V that dead time takes: against each phase's current, by (2).

    In each period a phase loses U_dc times the fraction of the dead time. Linear modulation reaches
    u_max = U_dc / sqrt(3).
    """
    size = v.dead_time * v.f_PWM * _ROOT_3 * available_voltage(v)
    axes = phase_axes(v)
    e_a, e_b, e_c = (-size * _saturated(i, v.i_0) for i in phase_currents(v))
    (c, s), (c_b, s_b), (c_c, s_c) = axes
    e_d = 2.0 / 3.0 * (c * e_a + c_b * e_b + c_c * e_c)
    e_q = -2.0 / 3.0 * (s * e_a + s_b * e_b + s_c * e_c)
    return where(v.dead_time > 0.0, e_q, 0.0), where(v.dead_time > 0.0, e_d, 0.0)


def phase_axes(v: Any) -> tuple[tuple[Any, Any], ...]:
    """Return cosine and sine of the electrical angle theta, theta - 2 pi / 3 and theta + 2 pi / 3."""
    theta = v.N_p * motion_law.alpha_RL(v) * v.x_L
    c, s = cos(theta), sin(theta)
    b = -0.5 * c + 0.5 * _ROOT_3 * s, -0.5 * s - 0.5 * _ROOT_3 * c
    return (c, s), b, (-0.5 * c - 0.5 * _ROOT_3 * s, -0.5 * s + 0.5 * _ROOT_3 * c)


def phase_currents(v: Any) -> tuple[Any, ...]:
    """Return i_a, i_b, i_c in A: the inverse of (1), without zero sequence."""
    return tuple(v.i_d * cosine - v.i_q * sine for cosine, sine in phase_axes(v))


def _saturated(i: Any, i_0: Any) -> Any:
    """Return a smooth sign of a phase's current: linear below i_0, where the legs' capacitances dominate."""
    return i / sqrt(i * i + i_0 * i_0)


def delayed(v: Any) -> dict[str, Any]:
    """Return the delay line after a communication step, and the demand that takes effect in the next one.

    `u_q_line[0]` is the demand of the step before this one, and so on. The delay is rounded to whole steps
    of this length, at least one. A delay beyond the line is infinite, which discards the step.
    """
    h = v.time - v.delay_clock
    steps = maximum(floor(v.delay / where(h > 0.0, h, 1.0) + 0.5), 1.0)
    wanted = where(v.delay > 0.0, steps, 0.0)
    chosen = minimum(wanted, LONGEST_DELAY + 0.0)
    return {
        "delay_clock": v.time,
        "delay_steps": where(wanted <= LONGEST_DELAY, wanted, math.inf),
        "u_q_late": where(v.delay > 0.0, _chosen(chosen, v.u_q, v.u_q_line), 0.0),
        "u_d_late": where(v.delay > 0.0, _chosen(chosen, v.u_d, v.u_d_line), 0.0),
        "u_q_line": [v.u_q, *v.u_q_line[: _OLDER - 1]],
        "u_d_line": [v.u_d, *v.u_d_line[: _OLDER - 1]],
    }


def _chosen(steps: Any, newest: Any, line: Any) -> Any:
    """Return the demand of `steps` steps ago, counted from 1."""
    total = (steps == 1.0) * newest
    for i in range(_OLDER):
        total = total + (steps == i + 2.0) * line[i]
    return total
