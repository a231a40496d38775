"""Figures of a joint over a cycle that repeats, with what the brake resistor takes, and their losses."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.arrays import Vector
from ...base.wording import format_rounded
from .cycle import Cycle, JointPlant
from .motor import Winding, cycles_until_warm, time_until_rise

RATED_TURNS = 1e6
"""Turns for which a dynamic load rating holds (ISO 3408-5)."""


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
    temperature_rise_peak_K: float | None = None
    temperature_rise_mean_K: float | None = None
    cycles_until_warm: int | None = None
    trip_time_s: float | None = None
    life_turns: float | None = None
    life_travel_m: float | None = None
    life_s: float | None = None


def compute_figures(
    cycle: Cycle, values: Mapping[str, float], capacity: float, winding: Winding | str, rise: Vector | None
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
    torque = _find_peak(cycle.torque)
    brake = brake_power(cycle.time, power, capacity)
    burnt = float(brake @ np.diff(cycle.time))
    load = mean_load(force, cycle.v, cycle.time)
    speed = cycle.mean(np.abs(cycle.v))
    further: dict[str, Any] = {}
    if isinstance(winding, Winding) and rise is not None:
        further |= {
            "temperature_rise_peak_K": float(rise.max()),
            "temperature_rise_mean_K": cycle.mean(rise),
            "cycles_until_warm": cycles_until_warm(cycle.duration, winding.tau_th),
            "trip_time_s": time_until_rise(cycle.time, rise, winding.tau_th, winding.trip_rise),
        }
    if "screw.C_a" in values:
        turns = life_turns(values["screw.C_a"], load, values.get("screw.f_w", 1.0))
        travel = turns * values["screw.lead"]
        life = travel / speed if speed > 0.0 else np.inf
        further |= {"life_turns": turns, "life_travel_m": travel, "life_s": life}
    return SizingFigures(
        cycle_s=cycle.duration,
        torque_peak_N_m=torque,
        torque_rms_N_m=cycle.rms(cycle.torque),
        required_torque_peak_N_m=_find_peak(cycle.required) if cycle.has_required else torque,
        current_peak_A=_find_peak(cycle.current),
        current_rms_A=cycle.rms(cycle.current),
        force_peak_N=_find_peak(force),
        compression_peak_N=max(float(force.max()), 0.0),
        force_rms_N=cycle.rms(force),
        force_mean_N=load,
        speed_peak_m_s=_find_peak(cycle.v),
        speed_mean_m_s=speed,
        motor_speed_peak_rad_s=_find_peak(cycle.omega),
        voltage_peak_V=_find_peak(_compute_voltage(cycle)),
        position_min_m=float(cycle.x.min()),
        position_max_m=float(cycle.x.max()),
        mechanical_power_peak_W=_find_peak(shaft),
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
        **further,
    )


def _compute_voltage(cycle: Cycle) -> Vector:
    """Return the voltage in V that the currents need, without their changes."""
    p, omega = cycle.emla, cycle.emla.N_p * cycle.omega
    u_q = p.R_s * cycle.i_q + omega * (p.L_d * cycle.i_d + p.Phi_PM)
    return np.hypot(u_q, p.R_s * cycle.i_d - omega * p.L_q * cycle.i_q)


def _find_peak(values: Vector) -> float:
    return float(np.abs(values).max())


def mean_load(force: Vector, speed: Vector, time: Vector) -> float:
    """Return the equivalent mean load in N: the cubic mean of |force| over the travel (ISO 3408-5)."""
    travel = np.trapezoid(np.abs(speed), time)
    if not travel > 0.0:
        return 0.0  # a screw at rest rolls over no track
    return float(np.cbrt(np.trapezoid(np.abs(force) ** 3 * np.abs(speed), time) / travel))


def life_turns(C_a: float, load: float, f_w: float = 1.0) -> float:
    """Return the nominal life L10 in turns of the screw, infinity without load; `f_w` is for shocks."""
    return RATED_TURNS * (C_a / (f_w * load)) ** 3 if load > 0.0 else math.inf


def brake_power(time: Vector, power: Vector, capacity: float) -> Vector:
    """Return the power in W of the brake resistor in each interval of a cycle that repeats.

    Energy from the motor first charges the DC link. When this is full, the resistor takes the rest. The motor
    takes its energy first from the DC link, then from the supply.

    Args:
        time: Times in s, shape (rows,).
        power: Electrical power into the motor in W, shape (rows,).
        capacity: Energy in J that the DC link stores until the resistor turns on.

    Returns:
        Mean power in W of each interval, shape (rows - 1,).
    """
    steps = np.diff(time)
    energy = -0.5 * (power[1:] + power[:-1]) * steps
    stored, burnt = 0.0, np.zeros_like(energy)
    for _ in range(2):  # the second time, the link starts as it ended
        for row, gain in enumerate(energy.tolist()):
            stored = max(stored + gain, 0.0)
            burnt[row] = max(stored - capacity, 0.0)
            stored = min(stored, capacity)
    return np.divide(burnt, steps, out=np.zeros_like(burnt), where=steps > 0.0)


_DIVIDE = "divide the load by the efficiency in both directions, as the paper prints"
_OPPOSE = "oppose the motion"


@dataclass(frozen=True)
class Losses:
    """Losses of gearbox and screw that the figures contain.

    Attributes:
        convention: What they do in the plant.
        torque_rms_N_m: Rms torque over the cycle.
        other_convention: What else they could do; None if the plant does not state its own.
        other_torque_rms_N_m: Rms torque over the same motion with the other convention.
        setting: Value for `--set` that chooses the other convention; None if the plant does not offer it.
    """

    convention: str
    torque_rms_N_m: float
    other_convention: str | None = None
    other_torque_rms_N_m: float | None = None
    setting: str | None = None

    @property
    def sentence(self) -> str:
        """Which losses were used, and the effect of the other convention; without full stop."""
        text = f"the losses of gearbox and screw {self.convention}"
        if self.other_torque_rms_N_m is None:
            return text
        condition = f"with --set {self.setting}" if self.setting else "if"
        other_rms, rms = (format_rounded(x, 4) for x in (self.other_torque_rms_N_m, self.torque_rms_N_m))
        effect = f"rms torque {other_rms} N m instead of {rms} N m"
        return f"{text}; {condition} they {self.other_convention}: {effect}"


def describe_losses(cycle: Cycle, plant: JointPlant) -> Losses:
    """Return the losses of a cycle with the plant of its joint."""
    rms = cycle.rms(cycle.torque)
    if "eta_GB" not in plant.names:
        return Losses("are those of its FMU, which has no gearbox.eta_GB", rms)
    directional = plant.values["directional"]
    # an eta_back of 0 is the same friction in both directions, which is none if eta_GB is 1
    if plant.values["eta_GB"] == 1.0 and plant.values["eta_back"] in (0.0, 1.0):
        return Losses(f"are none: {plant.names['eta_GB']} is 1", rms)
    used, alternative = (plant.load_torque(cycle.v, cycle.load, x) for x in (directional, 1.0 - directional))
    conventions = (_OPPOSE, _DIVIDE) if directional else (_DIVIDE, _OPPOSE)
    name = plant.names.get("directional")
    return Losses(
        conventions[0],
        rms,
        conventions[1],
        cycle.rms(cycle.torque + alternative - used),
        None if name is None else f"{name}={'false' if directional else 'true'}",
    )
