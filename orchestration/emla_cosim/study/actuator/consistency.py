"""Contradictions and improbable values in an actuator's data."""

import math
from collections.abc import Iterator
from dataclasses import asdict

from . import derived
from .derived import Values
from .entries import ROOT_2, ROOT_3, TURN

WARNING_DIFFERENCE, ERROR_DIFFERENCE = 0.1, 0.3
"""Relative differences of the constants for a warning and for an error.

Data sheets allow 10 %; rms mistaken for peak makes 41 %.
"""

_MARGIN = 1.1
"""Relative tolerance of printed torques and currents, which are rounded and refer to a hot motor."""


def find_contradictions(v: Values) -> Iterator[str]:
    """Yield a message, without full stop, for each contradiction in the data."""
    if not _is_finite(v):
        yield "the derived parameters are too large or too small to compute with; check the units"
        return
    if (difference := _compare_fluxes(v)) > ERROR_DIFFERENCE:
        yield (
            f"{_describe_fluxes(v, difference)}; check for each whether it is rms or peak, line to line or "
            "per phase"
        )
    # rms mistaken for peak makes 41 %, which 10 % of tolerance do not hide
    torque_per_current = derived.torque_per_current(v)
    for torque, current in (("tau_N", "i_N"), ("tau_max", "i_max")):
        t, i = v.get(f"motor.{torque}"), v.get(f"motor.{current}")
        if t is not None and i is not None and t > _MARGIN * torque_per_current * i:
            yield (
                f"motor.{torque} is {t:.4g} N m, but motor.{current} = {_format_current(i)} gives "
                f"{torque_per_current * i:.4g} N m; that torque needs "
                f"{_format_current(t / torque_per_current)}"
            )
    for low, high in (("i_N", "i_max"), ("tau_N", "tau_max")):
        if v.get(f"motor.{low}", 0.0) > v.get(f"motor.{high}", float("inf")):
            yield f"motor.{low} is more than motor.{high}"
    yield from _describe_excessive_speed(v)
    yield from _describe_incomplete_pairs(v)
    plant = derived.plant(v)
    if "F_C" in plant and plant["F_S"] < plant["F_C"]:
        yield "friction.F_S is less than friction.F_C; the breakaway force cannot be smaller"


def _describe_incomplete_pairs(v: Values) -> Iterator[str]:
    """Yield a message for each entry that means something only with another, and for a brake that is on."""
    for first, second in (("motor.tau_R", "motor.n_R"), ("inverter.C_DC", "inverter.U_brake")):
        if (first in v) != (second in v):
            present, lacking = (first, second) if first in v else (second, first)
            yield f"{present} needs {lacking}"
    voltage = ROOT_3 * derived.voltage(v)
    if v.get("inverter.U_brake", math.inf) < voltage:
        yield (
            f"inverter.U_brake is {v['inverter.U_brake']:.4g} V, below the DC link of {voltage:.4g} V; the "
            "brake resistor would always be on"
        )


def remarks(v: Values) -> Iterator[str]:
    """Yield warnings, without full stops, on values that are possible but probably not meant."""
    if WARNING_DIFFERENCE < (difference := _compare_fluxes(v)) <= ERROR_DIFFERENCE:
        yield f"{_describe_fluxes(v, difference)}; the one of kT is used"
    bounds = dict(derived.torques(v))
    motor = min((t for name, t in bounds.items() if name.startswith("motor.")), default=0.0)
    # an inverter for a smaller motor is possible, but seldom meant
    if (inverter_torque := bounds.get("inverter.i_max", motor)) < motor:
        yield f"inverter.i_max leaves {inverter_torque:.4g} N m of the motor's {motor:.4g} N m"


def _describe_excessive_speed(v: Values) -> Iterator[str]:
    """Yield a message if the back-EMF at the largest speed exceeds the inverter's voltage."""
    emla = derived.emla(v)
    speed = emla.alpha_RL * emla.v_max
    emf = emla.N_p * emla.Phi_PM * speed
    if emf > emla.u_max:
        possible = speed * emla.u_max / emf
        yield (
            f"at its largest speed, {speed * 60.0 / TURN:.4g} rpm of the motor, the back-EMF is "
            f"{emf:.4g} V peak ({emf * ROOT_3 / ROOT_2:.4g} V rms line to line), above the "
            f"inverter's {emla.u_max:.4g} V peak; enter a motor.n_max of at most "
            f"{_round_down(possible * 60.0 / TURN)} rpm, or a screw.v_max of at most "
            f"{_round_down(1e3 * possible / emla.alpha_RL)} mm/s"
        )


def _compare_fluxes(v: Values) -> float:
    """Return the relative difference of the two fluxes; 0 with only one constant."""
    first, *further = derived.fluxes(v).values()
    return abs(further[0] - first) / min(first, further[0]) if further else 0.0


def _describe_fluxes(v: Values, difference: float) -> str:
    """Return both fluxes with their relative difference as a clause of a message."""
    fluxes = derived.fluxes(v)
    return (
        f"motor.kT means a flux of {fluxes['kT']:.4g} Wb and motor.K_E one of {fluxes['K_E']:.4g} Wb, which "
        f"differ by {100.0 * difference:.0f} %"
    )


def _is_finite(v: Values) -> bool:
    """Return whether all that is computed from the entries is finite, and no divisor is nearly zero."""
    try:
        emla = derived.emla(v)
        values = [*asdict(emla).values(), emla.alpha_RL, emla.A_eq, emla.B_eq, emla.D_eq, emla.i_max]
        values += [derived.braking(v, 0.0), *derived.plant(v).values()]
        divisors = emla.alpha_RL, emla.A_eq, emla.i_max, emla.v_max, emla.Phi_PM, emla.u_max, emla.eta_GB
    except (ZeroDivisionError, OverflowError):
        return False
    return all(map(math.isfinite, values)) and all(divisor >= _MIN_DIVISOR for divisor in divisors)


# smaller ones overflow in squares of their inverse
_MIN_DIVISOR = 1e-30


def _round_down(number: float) -> str:
    """Return a number with four digits, rounded down."""
    unit = 10.0 ** (math.floor(math.log10(number)) - 3)
    return f"{math.floor(number / unit) * unit:.4g}"


def _format_current(peak: float) -> str:
    return f"{peak / ROOT_2:.4g} A rms ({peak:.4g} A peak)"
