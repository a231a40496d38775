"""The electrical half of an EMLA, motor with inverter and sensors: functions of the plant's values `v`.

Its inputs from the mechanical half are position and speed of the screw, `v.x_L` and `v.v_L`. Its output to
that half is the torque. Quantities are amplitude-invariant d-q quantities.
"""

from typing import Any

from fmublock import sin, where

from . import inverter, motion_law, sensors, thermal


def derivatives(v: Any) -> dict[str, Any]:
    """Return the derivatives of the currents (9) with (26) and (84), and of the winding's temperature."""
    u_q, u_d, _ = terminal_voltage(v)
    omega_e = v.N_p * motion_law.alpha_RL(v) * v.v_L
    R_s = thermal.resistance(v)
    g_3 = (-R_s * v.i_q - omega_e * (v.i_d * v.L_d + v.Phi_PM)) / v.L_q
    g_4 = (-R_s * v.i_d + omega_e * v.i_q * v.L_q) / v.L_d
    return {
        "i_q": u_q / v.L_q + (1.0 + v.F_3) * g_3,
        "i_d": u_d / v.L_d + (1.0 + v.F_4) * g_4,
        "temperature_rise": thermal.heating(v),
    }


def update(v: Any) -> dict[str, Any]:
    """Return sensor noise, the voltages of the next communication step, and the supply's voltage limit.

    The limit is sampled, so that a controller that reads it need not wait for the disturbance.
    """
    return {**sensors.drawn(v), **inverter.delayed(v), "u_measured": inverter.available_voltage(v)}


def outputs(v: Any) -> dict[str, Any]:
    """Return sensors, torque, voltages after the inverter, electrical power, and phase currents."""
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
    """Return the motor's u_q and u_d in V, inverter plus disturbance, and whether they are limited."""
    u_q, u_d, saturated = inverter.motor_voltage(v)
    return u_q + v.d_3, u_d + v.d_4, saturated


def torque(v: Any) -> Any:
    """Return tau_m of (3) in N m, with the magnet's current chosen by use_commanded_current."""
    return magnet_torque(v) + reluctance_torque(v)


def magnet_torque(v: Any) -> Any:
    """Return the part of tau_m in N m from the permanent magnet: with i_q or i_q*, and cogging."""
    return 1.5 * v.N_p * v.Phi_PM * where(v.use_commanded_current, v.i_q_ref, v.i_q) + cogging_torque(v)


def cogging_torque(v: Any) -> Any:
    """Return the torque in N m between the magnets and the slots of the stator, without current."""
    angle = motion_law.alpha_RL(v) * v.x_L
    return where(v.tau_cog > 0.0, v.tau_cog * sin(v.n_cog * angle), 0.0)


def reluctance_torque(v: Any) -> Any:
    """Return the part of tau_m in N m from the difference of L_d and L_q."""
    return 1.5 * v.N_p * v.i_q * v.i_d * (v.L_d - v.L_q)
