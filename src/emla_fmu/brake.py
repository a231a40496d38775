"""The holding brake at the motor shaft, and the inverter that is off meanwhile: functions of the values `v`.

The brake is elasto-plastic: its torque follows the elastic angle of hub and disc, so that it really holds, up
to the torque at which it slips. Stiffness and damping are those of a frequency and a damping ratio of the
motor's inertia on the brake.
"""

import math
from typing import Any

from fmublock import clamp, logical_and, sign, where

from . import motion_law, thermal

_RESET_TIME = 1e-3
"""Time constant in s with which the elastic angle of a released brake vanishes, and with which that of a
slipping brake returns to its limit, which an integration step can exceed."""


def conditions(v: Any) -> dict[str, Any]:
    """Refuse a brake that is too stiff for the internal step."""
    angle = where(v.brake_torque > 0.0, 2.0 * math.pi * v.brake_frequency * v.internal_step, 0.0)
    return {"2 pi brake.frequency solver.internal_step must be at most 1": angle <= 1.0}


def torque(v: Any) -> Any:
    """Return the torque in N m with which the brake opposes the motor."""
    omega = 2.0 * math.pi * v.brake_frequency
    inertia = motion_law.A_eq(v) / motion_law.alpha_RL(v)
    speed = motion_law.alpha_RL(v) * v.v_L
    elastic = inertia * omega * (omega * v.brake_angle + 2.0 * v.brake_damping_ratio * speed)
    return where(is_engaged(v), clamp(elastic, -v.brake_torque, v.brake_torque), 0.0)


def is_engaged(v: Any) -> Any:
    """Return whether there is a brake that is closed."""
    return logical_and(v.brake_torque > 0.0, v.engaged > 0.5)


def _largest_angle(v: Any) -> Any:
    """Return the elastic angle in rad from which on the brake slips."""
    omega = 2.0 * math.pi * v.brake_frequency
    return v.brake_torque * motion_law.alpha_RL(v) / (motion_law.A_eq(v) * omega * omega)


def derivatives(v: Any, rates: dict[str, Any]) -> dict[str, Any]:
    """Return the derivatives of a plant with the brake; without an inverter, currents decay in R_s and L."""
    speed, R_s = motion_law.alpha_RL(v) * v.v_L, thermal.resistance(v)
    excess, is_off = abs(v.brake_angle) - _largest_angle(v), v.disabled > 0.5
    slips = logical_and(excess >= 0.0, v.brake_angle * speed > 0.0)
    closed = where(slips, -sign(v.brake_angle) * excess / _RESET_TIME, speed)
    return {
        **rates,
        "v_L": acceleration(v, rates["v_L"]),
        "i_q": where(is_off, -R_s * v.i_q / v.L_q, rates["i_q"]),
        "i_d": where(is_off, -R_s * v.i_d / v.L_d, rates["i_d"]),
        "brake_angle": where(is_engaged(v), closed, -v.brake_angle / _RESET_TIME),
        "slip": where(logical_and(is_engaged(v), slips), abs(v.v_L), 0.0),
    }


def outputs(v: Any, shown: dict[str, Any]) -> dict[str, Any]:
    """Return the outputs of a plant with the brake; an inverter that is off has no voltage and no power."""
    is_off = v.disabled > 0.5
    off = {name: where(is_off, 0.0, shown[name]) for name in ("v_q", "v_d", "saturated", "P_el")}
    return {
        **shown,
        **off,
        "a_L": acceleration(v, shown["a_L"]),
        "tau_m": shown["tau_m"] - _missing_torque(v),
        "tau_brake": torque(v),
    }


def acceleration(v: Any, without: Any) -> Any:
    """Return the acceleration of the screw in m/s2, from that of the same motion without a brake."""
    return without - (torque(v) + _missing_torque(v)) / motion_law.A_eq(v)


def _missing_torque(v: Any) -> Any:
    """Return the torque in N m of a commanded current that an inverter, which is off, does not make."""
    commanded = 1.5 * v.N_p * v.Phi_PM * v.i_q_ref
    return where(v.disabled > 0.5, where(v.use_commanded_current, commanded, 0.0), 0.0)
