"""What cannot be in an actuator's data, and what is worth a remark, each in a sentence."""

import math
from collections.abc import Iterator
from dataclasses import asdict

from . import derived
from .derived import Values
from .entries import ROOT_2, ROOT_3, TURN

WORTH_SAYING, IMPOSSIBLE = 0.1, 0.3
"""Parts by which both constants may differ: sheets have a tolerance of 10 %, rms for peak is 41 %."""

_MARGIN = 1.1
"""What is printed of torques and currents, rounded and hot, fits so far."""


def find_contradictions(v: Values) -> Iterator[str]:
    """Sentences on what of the data contradicts itself."""
    if not _is_finite(v):
        yield "what follows from the numbers is too large or too small to compute with; look at their units"
        return
    if (off := _disagreement(v)) > IMPOSSIBLE:
        yield f"{_two_fluxes(v, off)}; look whether each is rms or peak, and line to line or per phase"
    per_current = derived.torque_per_current(v)
    for torque, current in (("tau_N", "i_N"), ("tau_max", "i_max")):
        t, i = v.get(f"motor.{torque}"), v.get(f"motor.{current}")
        if t is not None and i is not None and t > _MARGIN * per_current * i:
            yield (
                f"motor.{torque} is {t:.4g} N m, but motor.{current} = {_rms(i)} gives "
                f"{per_current * i:.4g} N m: that torque takes {_rms(t / per_current)}"
            )
    for low, high in (("i_N", "i_max"), ("tau_N", "tau_max")):
        if v.get(f"motor.{low}", 0.0) > v.get(f"motor.{high}", float("inf")):
            yield f"motor.{low} is more than motor.{high}"
    yield from _too_fast(v)
    made = derived.plant(v)
    if "F_C" in made and made["F_S"] < made["F_C"]:
        yield "friction.F_S is less than friction.F_C: friction that breaks away is never the smaller one"


def remarks(v: Values) -> Iterator[str]:
    """Sentences, without their stops, on what is possible, but may not be meant."""
    if WORTH_SAYING < (off := _disagreement(v)) <= IMPOSSIBLE:
        yield f"{_two_fluxes(v, off)}; that of kT is taken"
    bounds = dict(derived.torques(v))
    motor = min((t for place, t in bounds.items() if place.startswith("motor.")), default=0.0)
    if (limited := bounds.get("inverter.i_max", motor)) < motor:
        yield f"inverter.i_max leaves {limited:.4g} N m of the motor's {motor:.4g} N m"


def _too_fast(v: Values) -> Iterator[str]:
    """Back-EMF above what the inverter has, at the largest speed, without a weakened field."""
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
    """Relative difference of the fluxes that torque and voltage constant stand for; 0 with one of them."""
    first, *others = derived.fluxes(v).values()
    return abs(others[0] - first) / min(first, others[0]) if others else 0.0


def _two_fluxes(v: Values, off: float) -> str:
    by = derived.fluxes(v)
    return (
        f"motor.kT means a flux of {by['kT']:.4g} Wb and motor.K_E one of {by['K_E']:.4g} Wb, which differ "
        f"by {100.0 * off:.0f} %"
    )


def _is_finite(v: Values) -> bool:
    """Whether all that is computed of the entries is finite, and what is divided by is not zero."""
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
    """A number with four digits, rounded so that it is not more."""
    unit = 10.0 ** (math.floor(math.log10(number)) - 3)
    return f"{math.floor(number / unit) * unit:.4g}"


def _rms(peak: float) -> str:
    return f"{peak / ROOT_2:.4g} A rms ({peak:.4g} A peak)"
