"""Whether an actuator can do what its joint is to do: stroke, speed, load."""

from collections.abc import Iterator
from itertools import pairwise

from emla_fmu.schedule import NEVER

from ...options import Options
from ...system.model import System
from .actuator import Actuator
from .derived import holding_torque
from .settings import number, numbers

_ROUNDING = 1.0 + 1e-9


def impossible(joint: str, own: Actuator, system: System, options: Options) -> Iterator[str]:
    """Sentences, without their stops, on a start, a reference or a speed beyond what it can."""
    low, high, fastest = own.emla.q_LB, own.emla.q_UB, own.emla.v_max
    stroke = f"the stroke of its actuator, {1e3 * low:.4g} to {1e3 * high:.4g} mm"
    start = number(system, options, f"{joint}.plant", "start.x_L")
    if start is not None and not low <= start <= high:
        yield f"{joint} starts at {1e3 * start:.4g} mm, outside {stroke}; set {joint}.plant.start.x_L"
    points = numbers(system, options, f"{joint}.reference", "waypoint")
    if points and not (low <= min(points) and max(points) <= high):
        yield (
            f"the reference of {joint} goes from {1e3 * min(points):.4g} to {1e3 * max(points):.4g} mm, "
            f"outside {stroke}; set {joint}.reference.waypoint[*], or enter screw.q_LB"
        )
    peak = _peak_speed(joint, system, options)
    if peak > _ROUNDING * fastest:
        yield (
            f"the reference of {joint} peaks at {1e3 * peak:.4g} mm/s, faster than its actuator's "
            f"{1e3 * fastest:.4g} mm/s; make {joint}.reference.move.duration[*] "
            f"{peak / fastest:.3g} times as long"
        )


def heavy(joint: str, own: Actuator, system: System, options: Options) -> Iterator[str]:
    """A sentence, without its stop, on a load that the motor cannot hold, or not for ever."""
    levels = numbers(system, options, f"{joint}.disturbance", "load.level")
    if not levels:
        return
    load = max(map(abs, levels)) + 0.5 * (
        number(system, options, f"{joint}.disturbance", "load.ripple") or 0.0
    )
    needed, most = holding_torque(own.values, load), own.emla.tau_max
    lasting = own.i_N * most / own.emla.i_max
    told = f"{joint}: a load of {load:.4g} N takes {needed:.4g} N m of the motor at rest"
    if needed > most:
        yield f"{told}, more than its peak torque of {most:.4g} N m: it cannot be held"
    elif 0.0 < lasting < needed:
        yield f"{told}, more than the {lasting:.4g} N m that i_N gives for ever"


def _peak_speed(joint: str, system: System, options: Options) -> float:
    """Largest speed in m/s of quintic moves, those that happen: 15/8 of distance over time."""
    component = f"{joint}.reference"
    points = numbers(system, options, component, "waypoint")
    starts, durations = (
        numbers(system, options, component, f"move.{name}") for name in ("start", "duration")
    )
    moves = zip(pairwise(points), starts, durations, strict=False)
    return max(
        (1.875 * abs(b - a) / t for (a, b), begin, t in moves if begin < NEVER and t > 0.0), default=0.0
    )
