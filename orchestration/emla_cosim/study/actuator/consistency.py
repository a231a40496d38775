"""Contradictions and improbable values in an actuator's data."""

import math
from collections.abc import Iterator
from dataclasses import asdict

from . import derived
from .derived import Values
from .entries import ROOT_2, ROOT_3, TURN

WORTH_SAYING, IMPOSSIBLE = 0.1, 0.3
"""Relative differences of the constants for a warning and for an error.

Data sheets allow 10 %; rms mistaken for peak makes 41 %.
"""

_MARGIN = 1.1
"""Relative tolerance of printed torques and currents, which are rounded and refer to a hot motor."""


def find_contradictions(v: Values) -> Iterator[str]:
    """Yield a message for each contradiction in the data."""
    if not _is_finite(v):
        yield "the derived parameters are too large or too small to compute with; check the units"
        return
    if (off := _disagreement(v)) > IMPOSSIBLE:
        yield f"{_two_fluxes(v, off)}; check for each whether it is rms or peak, line to line or per phase"
    per_current = derived.torque_per_current(v)
    for torque, current in (("tau_N", "i_N"), ("tau_max", "i_max")):
        t, i = v.get(f"motor.{torque}"), v.get(f"motor.{current}")
        if t is not None and i is not None and t > _MARGIN * per_current * i:
            yield (
                f"motor.{torque} is {t:.4g} N m, but motor.{current} = {_rms(i)} gives "
                f"{per_current * i:.4g} N m; that torque needs {_rms(t / per_current)}"
            )
    for low, high in (("i_N", "i_max"), ("tau_N", "tau_max")):
        if v.get(f"motor.{low}", 0.0) > v.get(f"motor.{high}", float("inf")):
            yield f"motor.{low} is more than motor.{high}"
    yield from _too_fast(v)
    yield from _halves(v)
    made = derived.plant(v)
    if "F_C" in made and made["F_S"] < made["F_C"]:
        yield "friction.F_S is less than friction.F_C; the breakaway force cannot be smaller"


def _halves(v: Values) -> Iterator[str]:
    """Yield a message for each entry that means something only with another, and for a brake that is on."""
    for one, other in (("motor.tau_R", "motor.n_R"), ("inverter.C_DC", "inverter.U_brake")):
        if (one in v) != (other in v):
            there, lacking = (one, other) if one in v else (other, one)
            yield f"{there} needs {lacking}"
    normal = ROOT_3 * derived.voltage(v)
    if v.get("inverter.U_brake", math.inf) < normal:
        yield (
            f"inverter.U_brake is {v['inverter.U_brake']:.4g} V, below the DC link of {normal:.4g} V; the "
            "brake resistor would always be on"
        )


def remarks(v: Values) -> Iterator[str]:
    """Yield warnings, without full stops, on values that are possible but probably not meant."""
    if WORTH_SAYING < (off := _disagreement(v)) <= IMPOSSIBLE:
        yield f"{_two_fluxes(v, off)}; the one of kT is used"
    bounds = dict(derived.torques(v))
    motor = min((t for place, t in bounds.items() if place.startswith("motor.")), default=0.0)
    if (limited := bounds.get("inverter.i_max", motor)) < motor:
        yield f"inverter.i_max leaves {limited:.4g} N m of the motor's {motor:.4g} N m"


def _too_fast(v: Values) -> Iterator[str]:
    """Yield a message if the back-EMF at the largest speed exceeds the inverter's voltage."""
    made = derived.emla(v)
    speed = made.alpha_RL * made.v_max
    emf = made.N_p * made.Phi_PM * speed
    if emf > made.u_max:
        possible = speed * made.u_max / emf
        yield (
            f"at its largest speed, {speed * 60.0 / TURN:.4g} rpm of the motor, the back-EMF is "
            f"{emf:.4g} V peak ({emf * ROOT_3 / ROOT_2:.4g} V rms line to line), above the "
            f"inverter's {made.u_max:.4g} V peak; enter a motor.n_max of at most "
            f"{_at_most(possible * 60.0 / TURN)} rpm, or a screw.v_max of at most "
            f"{_at_most(1e3 * possible / made.alpha_RL)} mm/s"
        )


def _disagreement(v: Values) -> float:
    """Return the relative difference of the two fluxes; 0 with only one constant."""
    first, *others = derived.fluxes(v).values()
    return abs(others[0] - first) / min(first, others[0]) if others else 0.0


def _two_fluxes(v: Values, off: float) -> str:
    by = derived.fluxes(v)
    return (
        f"motor.kT means a flux of {by['kT']:.4g} Wb and motor.K_E one of {by['K_E']:.4g} Wb, which differ "
        f"by {100.0 * off:.0f} %"
    )


def _is_finite(v: Values) -> bool:
    """Return whether all that is computed of the entries is finite, and no divisor is zero."""
    try:
        made = derived.emla(v)
        found = [*asdict(made).values(), made.alpha_RL, made.A_eq, made.B_eq, made.D_eq, made.i_max]
        found += [derived.braking(v, 0.0), *derived.plant(v).values()]
        divisors = made.alpha_RL, made.A_eq, made.i_max, made.v_max, made.Phi_PM, made.u_max, made.eta_GB
    except (ZeroDivisionError, OverflowError):
        return False
    return all(map(math.isfinite, found)) and all(one >= _SMALLEST for one in divisors)


_SMALLEST = 1e-30


def _at_most(number: float) -> str:
    """Return a number with four digits, rounded down."""
    unit = 10.0 ** (math.floor(math.log10(number)) - 3)
    return f"{math.floor(number / unit) * unit:.4g}"


def _rms(peak: float) -> str:
    return f"{peak / ROOT_2:.4g} A rms ({peak:.4g} A peak)"
