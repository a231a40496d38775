"""Whether an actuator can do what its joint is to do: stroke, speed, load."""

import math
from collections.abc import Iterator
from itertools import pairwise

from emla_fmu.schedule import NEVER

from ...options import Options
from ...system.model import System
from ..trajectory import motion
from .actuator import Actuator
from .derived import holding_torque
from .settings import is_own, number, numbers

_ROUNDING = 1.0 + 1e-9
_LED = "machine.trajectory"


def impossible(joint: str, own: Actuator, system: System, options: Options) -> Iterator[str]:
    """Sentences, without their stops, on a start, a reference or a speed beyond what it can."""
    low, high, fastest = own.emla.q_LB, own.emla.q_UB, own.emla.v_max
    stroke = f"the stroke of its actuator, {1e3 * low:.4g} to {1e3 * high:.4g} mm"
    start = number(system, options, f"{joint}.plant", "start.x_L")
    if start is not None and not low <= start <= high:
        yield f"{joint} starts at {1e3 * start:.4g} mm, outside {stroke}; set {joint}.plant.start.x_L"
    found = _motion(joint, system, options)
    if found is None:
        return
    nearest, farthest, peak, ways = found
    if not (low <= nearest and farthest <= high):
        yield (
            f"the reference of {joint} goes from {1e3 * nearest:.4g} to {1e3 * farthest:.4g} mm, "
            f"outside {stroke}; {ways[0]}, or enter screw.q_LB"
        )
    if peak > _ROUNDING * fastest:
        yield (
            f"the reference of {joint} peaks at {1e3 * peak:.4g} mm/s, faster than its actuator's "
            f"{1e3 * fastest:.4g} mm/s; {ways[1]} {math.ceil(100.0 * peak / fastest) / 100.0:g} times as long"
        )


def _motion(
    joint: str, system: System, options: Options
) -> tuple[float, float, float, tuple[str, str]] | None:
    """How far in and out a joint's reference goes in m, its largest speed, and what would change both."""
    points = numbers(system, options, f"{joint}.reference", "waypoint")
    if points:
        ways = f"set {joint}.reference.waypoint[*]", f"make {joint}.reference.move.duration[*]"
        return min(points), max(points), _peak_speed(joint, system, options), ways
    if any(c.name == _LED for c in system.components) and is_own(_LED, options):
        ways = "give another --trajectory", "give a --trajectory that takes"
        return *motion(options.trajectory).travel(joint), ways
    return None


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
