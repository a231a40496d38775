"""Figures of a joint over a cycle that repeats."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.arrays import Vector
from . import screw, thermal
from .braking import brake_power
from .cycle import Cycle
from .winding import Winding


@dataclass(frozen=True)
class SizingFigures:
    """Figures of one joint over one cycle; the unit is in the name. None marks what the data sheet lacks.

    Currents are amplitudes (peak); `current_rms_A` is the root mean square of the amplitude over the cycle.
    `required_torque_peak_N_m` is what reference and load require, also beyond the motor's limit.
    `trip_time_s` is how long the cycle repeats from cold until the winding trips; infinity if it never does.
    """

    cycle_s: float
    torque_peak_N_m: float
    torque_rms_N_m: float
    required_torque_peak_N_m: float
    current_peak_A: float
    current_rms_A: float
    force_peak_N: float
    compression_peak_N: float
    force_rms_N: float
    force_mean_N: float
    speed_peak_m_s: float
    speed_mean_m_s: float
    motor_speed_peak_rad_s: float
    voltage_peak_V: float
    position_min_m: float
    position_max_m: float
    mechanical_power_peak_W: float
    electrical_power_peak_W: float
    regenerated_power_peak_W: float
    electrical_power_mean_W: float
    energy_in_J: float
    energy_regenerated_J: float
    energy_load_J: float
    energy_motor_loss_J: float
    energy_brake_J: float
    brake_power_peak_W: float
    brake_power_mean_W: float
    temperature_rise_peak_K: float | None
    temperature_rise_mean_K: float | None
    cycles_until_warm: int | None
    trip_time_s: float | None
    life_turns: float | None
    life_travel_m: float | None
    life_s: float | None


def compute_figures(
    cycle: Cycle,
    values: Mapping[str, float],
    capacity: float,
    winding: Winding | str,
    rise: Vector | None,
) -> SizingFigures:
    """Return the figures of a cycle.

    Args:
        cycle: The cycle.
        values: Entries of the data sheet, in SI units and peak values.
        capacity: Energy in J that the DC link stores until the brake resistor turns on.
        winding: Thermal data of the winding, or what is missing for them.
        rise: Temperature rise in K of the repeated cycle; None without thermal data.
    """
    energy = lambda power: float(np.trapezoid(power, cycle.time))  # noqa: E731
    force, power = cycle.force, cycle.P_el
    shaft = cycle.torque * cycle.omega
    torque = _largest(cycle.torque)
    brake = brake_power(cycle.time, power, capacity)
    burnt = float(brake @ np.diff(cycle.time))
    load = screw.mean_load(force, cycle.v, cycle.time)
    turns = travel = lasting = None
    speed = cycle.mean(np.abs(cycle.v))
    if "screw.C_a" in values:
        turns = screw.life_turns(values["screw.C_a"], load, values.get("screw.f_w", 1.0))
        travel = turns * values["screw.lead"]
        lasting = travel / speed if speed > 0.0 else np.inf
    return SizingFigures(
        cycle_s=cycle.duration,
        torque_peak_N_m=torque,
        torque_rms_N_m=cycle.rms(cycle.torque),
        required_torque_peak_N_m=_largest(cycle.required) if cycle.has_required else torque,
        current_peak_A=_largest(cycle.current),
        current_rms_A=cycle.rms(cycle.current),
        force_peak_N=_largest(force),
        compression_peak_N=max(float(force.max()), 0.0),
        force_rms_N=cycle.rms(force),
        force_mean_N=load,
        speed_peak_m_s=_largest(cycle.v),
        speed_mean_m_s=speed,
        motor_speed_peak_rad_s=_largest(cycle.omega),
        voltage_peak_V=_largest(_voltage(cycle)),
        position_min_m=float(cycle.x.min()),
        position_max_m=float(cycle.x.max()),
        mechanical_power_peak_W=_largest(shaft),
        electrical_power_peak_W=float(power.max()),
        regenerated_power_peak_W=max(float(-power.min()), 0.0),
        electrical_power_mean_W=cycle.mean(power),
        energy_in_J=energy(np.maximum(power, 0.0)),
        energy_regenerated_J=energy(np.maximum(-power, 0.0)),
        energy_load_J=energy(cycle.load * cycle.v),
        energy_motor_loss_J=energy(power - shaft),
        energy_brake_J=burnt,
        brake_power_peak_W=float(brake.max()),
        brake_power_mean_W=burnt / cycle.duration,
        **_thermal_figures(cycle, winding, rise),
        life_turns=turns,
        life_travel_m=travel,
        life_s=lasting,
    )


def _thermal_figures(cycle: Cycle, winding: Winding | str, rise: Vector | None) -> dict[str, Any]:
    if isinstance(winding, str) or rise is None:
        names = ("temperature_rise_peak_K", "temperature_rise_mean_K", "cycles_until_warm", "trip_time_s")
        return dict.fromkeys(names)
    tau = winding.tau_th
    return {
        "temperature_rise_peak_K": float(rise.max()),
        "temperature_rise_mean_K": cycle.mean(rise),
        "cycles_until_warm": thermal.cycles_until_warm(cycle.duration, tau),
        "trip_time_s": thermal.time_until_rise(cycle.time, rise, tau, winding.trip_rise),
    }


def _voltage(cycle: Cycle) -> Vector:
    """Return the voltage in V that the currents need, without their changes."""
    p, omega = cycle.emla, cycle.emla.N_p * cycle.omega
    u_q = p.R_s * cycle.i_q + omega * (p.L_d * cycle.i_d + p.Phi_PM)
    return np.hypot(u_q, p.R_s * cycle.i_d - omega * p.L_q * cycle.i_q)


def _largest(values: Vector) -> float:
    return float(np.abs(values).max())
