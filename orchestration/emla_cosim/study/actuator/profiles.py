"""Extremes of a joint's reference and load between start and stop time of a run."""

import math
from collections.abc import Iterable, Sequence
from functools import partial
from itertools import chain
from types import SimpleNamespace

from emla_fmu import Disturbance, Reference
from emla_fmu.schedule import NEVER
from fmublock import Block

from ...run.options import Options
from ...system.model import System
from ..joints.stroke_table import StrokeTable, table_of_plant
from .model_parameters import get_number, is_own

_EVENLY = 200
"""Number of evenly spaced moments at which a profile is sampled, beside the ends of its parts."""

_MOST_PEAKS = 1000
"""Above this number of ripple peaks, the highest peak is assumed to coincide with the highest load."""


def largest_load(joint: str, system: System, options: Options) -> float | None:
    """Return the largest load force in N, as a magnitude, of a joint in a run.

    With a force along the stroke, it is a bound: times and positions of its parts may not coincide.

    Returns:
        None if the joint has no profile or no load.
    """
    p = _parameters(Disturbance, f"{joint}.disturbance", system, options)
    if p is None:
        return None
    ends = chain.from_iterable((t, t + p.ramp) for t in p.level_start[1:])
    moments, width = _moments(ends, options), abs(0.5 * p.ripple)
    along = _forces_on_the_way(joint, system, options)
    if width and p.ripple_omega:
        first, last = min(moments), max(moments)
        half = math.pi / abs(p.ripple_omega)
        if (last - first) / half > _MOST_PEAKS:
            p.ripple = 0.0
            return _largest(p, moments, along) + width or None
        k = range(math.floor(first / half), math.ceil(last / half) + 1)
        moments += [t for t in ((i + 0.5) * half for i in k) if first <= t <= last]
    return _largest(p, moments, along) or None


def _largest(p: SimpleNamespace, moments: Iterable[float], along: Sequence[float]) -> float:
    forces = [Disturbance.load(Disturbance(), _at(p, t)) for t in moments]
    return max(abs(force + other) for force in forces for other in along)


def _forces_on_the_way(joint: str, system: System, options: Options) -> Sequence[float]:
    """Return the least and the largest force in N along the stroke on a joint's reference; 0 without any."""
    table = read_stroke_table(joint, system, options)
    if table is None:
        return (0.0,)
    reach = reference_reach(joint, system, options)
    nearest, farthest = (table.position[0], table.position[-1]) if reach is None else reach[:2]
    ways = [nearest, farthest, *(x for x in table.position if nearest < x < farthest)]
    forces = [table.force_at(x) for x in ways]
    return min(forces), max(forces)


def read_stroke_table(joint: str, system: System, options: Options) -> StrokeTable | None:
    """Return the load of a joint along the stroke as it runs; None without one."""
    return table_of_plant(partial(get_number, system, options, f"{joint}.plant"))


def reference_reach(joint: str, system: System, options: Options) -> tuple[float, float, float] | None:
    """Return the range in m and the peak speed in m/s of a joint's reference in a run.

    Returns:
        Lowest and highest position, and peak speed; None if the joint has no reference of its own.
    """
    p = _parameters(Reference, f"{joint}.reference", system, options)
    if p is None:
        return None
    moves = [(t, t + 0.5 * d, t + d) for t, d in zip(p.start, p.duration, strict=True)]
    found = [
        Reference().outputs(_at(p, t)) for t in _moments(_repeat_moves(moves, p.period, options), options)
    ]
    places = [one["x_d"] for one in found]
    return min(places), max(places), max(abs(one["v_d"]) for one in found)


def _repeat_moves(moves: Iterable[tuple[float, ...]], period: float, options: Options) -> Iterable[float]:
    """Return the moments of moves; repeated moves count in every period of a run, at most a thousand."""
    once = [t for move in moves for t in move if t < 0.5 * NEVER]
    first, last = run_span(options)
    if period <= 0.0 or not math.isfinite(last):
        return once
    begun = math.floor(first / period)
    periods = range(begun, min(math.ceil(last / period), begun + _MOST_PEAKS))
    return [i * period + t for i in periods for t in (*once, 0.0, math.nextafter(period, 0.0))]


def run_span(options: Options) -> tuple[float, float]:
    """Return start and stop time of a run in s; infinity if no stop time is known."""
    return options.start_time or 0.0, math.inf if options.stop_time is None else options.stop_time


def _moments(ends: Iterable[float], options: Options) -> list[float]:
    """Return moments in a run: start, stop, those of `ends`, and some between them."""
    first, last = run_span(options)
    inside = [t for t in ends if first < t < last and t < 0.5 * NEVER]
    if not math.isfinite(last):
        last = max(inside, default=first) + 1.0
    evenly = (first + (last - first) * i / _EVENLY for i in range(_EVENLY))
    return [*evenly, last, *inside]


def _parameters(
    block: type[Block], component: str, system: System, options: Options
) -> SimpleNamespace | None:
    """Return the parameters of a component by attribute of its block; None if it is not ours."""
    there = any(c.name == component and c.model == block.__name__ for c in system.components)
    if not there or not is_own(component, options):
        return None
    found = SimpleNamespace()
    for parameter in block.layout().parameters:
        read = [get_number(system, options, component, scalar.name) for scalar in parameter.scalars()]
        values = [
            float(scalar.start) if value is None else value
            for scalar, value in zip(parameter.scalars(), read, strict=True)
        ]
        setattr(found, parameter.attribute, values if parameter.shape else values[0])
    return found


def _at(p: SimpleNamespace, time: float) -> SimpleNamespace:
    p.time = time
    return p
