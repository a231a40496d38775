"""Limits of a data sheet, how much of each a cycle uses, and those that cannot be examined."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ...base.wording import format_rounded
from ...study.actuator import derived
from ...study.actuator.entries import ROOT_2, ROOT_3, TURN
from ...study.limits import format_distinct
from .cycle import Cycle
from .figures import SizingFigures
from .motor import Winding, continuous_torque

_ROUNDING = 1e-9

YOUNG, DENSITY = 2.06e11, 7850.0
"""Of steel, in Pa and kg/m3, as in catalogues."""

SPEED_SAFETY, BUCKLING_SAFETY = 0.8, 0.5
"""Permissible fractions of critical speed and buckling load, as in the catalogues of THK and MISUMI."""

_EIGENVALUES = (1.8751, math.pi, 3.9266, 4.7300)
"""First eigenvalues of a beam, by the bearings of `ENDS`."""

_EULER = (0.25, 1.0, 2.0, 4.0)
"""Factors of Euler's buckling load, by the bearings of `ENDS`."""

Values = Mapping[str, float]


def format_percent(fraction: float) -> str:
    """Return a fraction in percent with three digits."""
    return format_rounded(100.0 * fraction)


def format_value(value: float) -> str:
    """Return a value with four digits."""
    return "unlimited" if math.isinf(value) else format_rounded(value, 4)


@dataclass(frozen=True)
class Utilisation:
    """How much of a limit a cycle uses.

    Attributes:
        name: Name of the limit.
        used: Value that the cycle reaches, in `unit`.
        limit: Value of the limit, in `unit`.
        unit: Unit for people.
        fraction: Used fraction of the limit; above 1 the limit is exceeded.
        source: Entries of the data sheet that are the limit, or an option.
    """

    name: str
    used: float
    limit: float
    unit: str
    fraction: float
    source: str

    @property
    def holds(self) -> bool:
        """Whether the limit is not exceeded."""
        return self.fraction <= 1.0 + _ROUNDING

    @property
    def sentence(self) -> str:
        """What exceeds the limit, in words, without full stop."""
        used, limit = format_value(self.used), format_value(self.limit)
        if used == limit:
            used, limit = format_distinct(self.used, self.limit)
        return (
            f"{self.name}: {used} {self.unit} of {limit} {self.unit} "
            f"({format_percent(self.fraction)} %, {self.source})"
        )


@dataclass(frozen=True)
class Unexamined:
    """A limit that was not examined, and what is missing for it."""

    name: str
    missing: str


_Examined = Utilisation | Unexamined


@dataclass(frozen=True)
class Requirements:
    """What the application requires beside the cycle.

    Attributes:
        ambient: Temperature around the motor in K.
        life: Time in s for which the cycle is to repeat; None if it is not stated.
    """

    ambient: float
    life: float | None


def examine(
    cycle: Cycle, values: Values, figures: SizingFigures, requirements: Requirements, winding: Winding | str
) -> Iterator[Utilisation | Unexamined]:
    """Yield all limits; `values` are entries of the data sheet, in SI units and peak values."""
    yield from _examine_motor(cycle, values, figures)
    yield from examine_heat(values, figures, requirements.ambient, winding)
    yield from _examine_motion(values, figures)
    yield from _examine_screw(values, figures, requirements.life)
    yield _check_entry(values, "brake resistor power", figures.brake_power_mean_W, "inverter.P_brake", "W")


def _make_utilisation(
    name: str, used: float, limit: float, unit: str, factor: float, source: str
) -> Utilisation:
    """Return the use of a limit; `factor` converts both values from SI units to `unit`."""
    return Utilisation(name, factor * used, factor * limit, unit, used / limit, source)


def _check_entry(
    values: Values, name: str, used: float, entry: str, unit: str, factor: float = 1.0
) -> Utilisation | Unexamined:
    """Return the utilisation of a limit that is one entry."""
    if entry not in values:
        return Unexamined(name, entry)
    return _make_utilisation(name, used, values[entry], unit, factor, entry)


def _examine_motor(cycle: Cycle, values: Values, figures: SizingFigures) -> Iterator[_Examined]:
    """Yield the limits of torque, currents and voltage."""
    source, limit = min(derived.torques(values), key=lambda torque: torque[1])
    # a motor at its limit hides what the motion requires beyond it
    torque = max(figures.required_torque_peak_N_m, figures.torque_peak_N_m)
    yield _make_utilisation("peak torque", torque, limit, "N m", 1.0, source)
    rms = 1.0 / ROOT_2
    peak, effective = figures.current_peak_A, figures.current_rms_A
    yield _check_entry(values, "motor peak current", peak, "motor.i_max", "A rms", rms)
    yield _check_entry(values, "inverter peak current", peak, "inverter.i_max", "A rms", rms)
    yield _check_entry(values, "motor rms current", effective, "motor.i_N", "A rms", rms)
    yield _check_entry(values, "inverter rms current", effective, "inverter.i_N", "A rms", rms)
    lasting = continuous_torque(values, np.array([cycle.rms(cycle.omega)]))
    if lasting is None:
        yield Unexamined("rms torque", "motor.tau_N")
    else:
        entry = "motor.tau_N" if "motor.tau_N" in values else "motor.i_N"
        entry += ", motor.tau_R" if "motor.tau_R" in values else ""
        limit = float(lasting[0])
        share = figures.torque_rms_N_m / limit if limit > 0.0 else math.inf
        yield Utilisation("rms torque", figures.torque_rms_N_m, limit, "N m", share, entry)
    # the entry from which u_max follows, in the order in which `derived.voltage` looks for them
    source = next(e for e in ("inverter.U_DC", "inverter.U_supply", "inverter.u_max") if e in values)
    yield _make_utilisation("voltage", figures.voltage_peak_V, cycle.emla.u_max, "V peak", 1.0, source)


def examine_heat(
    values: Values, figures: SizingFigures, ambient: float, winding: Winding | str
) -> Iterator[Utilisation | Unexamined]:
    """Yield the limits of the winding temperature at an ambient temperature in K; see `examine`."""
    rise = figures.temperature_rise_peak_K
    if isinstance(winding, str) or rise is None:
        yield Unexamined("winding temperature", str(winding))
        return
    yield _make_utilisation(
        "winding temperature rise", rise, winding.permitted_rise, "K", 1.0, winding.source
    )
    if "thermal.T_max" in values:
        permitted, zero = values["thermal.T_max"] - ambient, 273.15
        share = rise / permitted if permitted > 0.0 else math.inf
        reached, limit = rise + ambient - zero, values["thermal.T_max"] - zero
        yield Utilisation("winding temperature", reached, limit, "°C", share, "thermal.T_max")


def _examine_motion(values: Values, figures: SizingFigures) -> Iterator[_Examined]:
    """Yield the limits of speed, stroke and axial force."""
    omega = figures.motor_speed_peak_rad_s
    yield _check_entry(values, "motor speed", omega, "motor.n_max", "rpm", 60.0 / TURN)
    yield _check_entry(values, "screw speed", figures.speed_peak_m_s, "screw.v_max", "mm/s", 1e3)
    half = 0.5 * values["screw.stroke"]
    middle = values.get("screw.q_LB", 0.0) + half
    outside = max(figures.position_max_m - middle, middle - figures.position_min_m)
    travel = figures.position_max_m - figures.position_min_m
    # within the ends the used length counts; beyond one of them the distance from the middle
    share = travel / values["screw.stroke"] if outside <= half * (1.0 + _ROUNDING) else outside / half
    yield Utilisation("stroke", 1e3 * travel, 2e3 * half, "mm", share, "screw.stroke")
    yield _check_entry(values, "axial force", figures.force_peak_N, "screw.F_max", "kN", 1e-3)


def _examine_screw(values: Values, figures: SizingFigures, life: float | None) -> Iterator[_Examined]:
    """Yield static load, critical speed, buckling and life of the screw."""
    yield _check_entry(values, "screw static load", figures.force_peak_N, "screw.C_0a", "kN", 1e-3)
    shape = ("screw.d_root", "screw.L_free", "screw.ends")
    if missing := [entry for entry in shape if entry not in values]:
        yield Unexamined("screw critical speed", ", ".join(missing))
        yield Unexamined("screw buckling", ", ".join(missing))
    else:
        d_root, length, ends = (values[entry] for entry in shape)
        turning = TURN * figures.speed_peak_m_s / values["screw.lead"]
        permitted = critical_speed(d_root, length, round(ends))
        source = "screw.d_root, L_free, ends"
        yield _make_utilisation("screw critical speed", turning, permitted, "rpm", 60.0 / TURN, source)
        load = buckling_load(d_root, length, round(ends))
        yield _make_utilisation("screw buckling", figures.compression_peak_N, load, "kN", 1e-3, source)
    if figures.life_s is None:
        yield Unexamined("screw life", "screw.C_a")
    elif life is None:
        yield Unexamined("screw life", "the required life, --life")
    else:
        yield _make_utilisation("screw life", life, figures.life_s, "h", 1.0 / 3600.0, "--life, screw.C_a")


def link_capacity(values: Values) -> float:
    """Return the energy in J that the DC link stores from its normal voltage until the resistor turns on."""
    if "inverter.C_DC" not in values:
        return 0.0
    normal = ROOT_3 * derived.voltage(values)
    return 0.5 * values["inverter.C_DC"] * max(values["inverter.U_brake"] ** 2 - normal**2, 0.0)


def critical_speed(d_root: float, length: float, ends: int) -> float:
    """Return the permissible speed in rad/s: `SPEED_SAFETY` of the first resonance of a round shaft."""
    wave = (_EIGENVALUES[ends] / length) ** 2
    return SPEED_SAFETY * wave * 0.25 * d_root * math.sqrt(YOUNG / DENSITY)


def buckling_load(d_root: float, length: float, ends: int) -> float:
    """Return the permissible compressive force in N: `BUCKLING_SAFETY` of Euler's load."""
    inertia = math.pi / 64.0 * d_root**4
    return BUCKLING_SAFETY * _EULER[ends] * math.pi**2 * YOUNG * inertia / length**2
