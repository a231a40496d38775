"""The electrical half of an EMLA, motor with inverter and sensors: functions of the plant's values `v`.

It needs of the mechanical half position and speed of the screw, `v.x_L` and `v.v_L`, and gives it the torque.
Quantities are amplitude-invariant d-q quantities.
"""

from enum import IntEnum
from typing import Any

from fmublock import where

from . import inverter, motion_law, sensors, thermal


class TorqueSource(IntEnum):
    """Which q-axis current drives the screw."""

    CURRENT = 1
    """The actual current (3): physics."""
    COMMAND = 2
    """The commanded current i_q* (9): the paper's idealisation."""


def derivatives(v: Any) -> dict[str, Any]:
    """The currents of (9) with the disturbances of (26) and the uncertainties of (84); the winding's heat."""
    u_q, u_d, _ = terminal_voltage(v)
    omega_e = v.N_p * motion_law.alpha_RL(v) * v.v_L
    g_3 = (-v.R_s * v.i_q - omega_e * (v.i_d * v.L_d + v.Phi_PM)) / v.L_q
    g_4 = (-v.R_s * v.i_d + omega_e * v.i_q * v.L_q) / v.L_d
    return {
        "i_q": u_q / v.L_q + (1.0 + v.F_3) * g_3,
        "i_d": u_d / v.L_d + (1.0 + v.F_4) * g_4,
        "temperature_rise": thermal.heating(v),
    }


def update(v: Any) -> dict[str, Any]:
    """Sensor noise, the voltage of the next communication step, and what the supply allows.

    The last one is sampled, so that who is told of the supply need not wait for who disturbs it.
    """
    return {**sensors.drawn(v), **inverter.delayed(v), "u_measured": inverter.available_voltage(v)}


def outputs(v: Any) -> dict[str, Any]:
    """Sensors, torque, voltages after the inverter, electrical power, and phase currents."""
    u_q, u_d, saturated = terminal_voltage(v)
    i_q_measured, i_d_measured = sensors.measured_currents(v)
    i_a, i_b, i_c = inverter.phase_currents(v)
    return {
        "x_measured": sensors.measured_position(v),
        "i_q_measured": i_q_measured,
        "i_d_measured": i_d_measured,
        "u_available": v.u_measured,
        "tau_m": torque(v),
        "omega_m": motion_law.alpha_RL(v) * v.v_L,
        "v_q": u_q - v.d_3,
        "v_d": u_d - v.d_4,
        "saturated": saturated,
        "motor_load": thermal.load(v),
        "P_el": 1.5 * (u_q * v.i_q + u_d * v.i_d),
        "i_a": i_a,
        "i_b": i_b,
        "i_c": i_c,
    }


def terminal_voltage(v: Any) -> tuple[Any, Any, Any]:
    """Voltage at the motor in V: what the inverter gives, plus disturbance; and if it was limited."""
    u_q, u_d, saturated = inverter.motor_voltage(v)
    return u_q + v.d_3, u_d + v.d_4, saturated


def torque(v: Any) -> Any:
    """tau_m of (3) in N m, with the magnet's current chosen by torque_source."""
    return magnet_torque(v) + reluctance_torque(v)


def magnet_torque(v: Any) -> Any:
    """Part of tau_m in N m that the permanent magnet makes with i_q or i_q*."""
    return 1.5 * v.N_p * v.Phi_PM * where(v.torque_source == TorqueSource.COMMAND, v.i_q_ref, v.i_q)


def reluctance_torque(v: Any) -> Any:
    """Part of tau_m in N m that comes of L_d and L_q being different."""
    return 1.5 * v.N_p * v.i_q * v.i_d * (v.L_d - v.L_q)
