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
from ..joints.stroke_table import StrokeTable, read_plant_table
from .model_parameters import follows_start_values, get_number

_SAMPLES = 200
"""Number of evenly spaced moments at which a profile is sampled, beside the ends of its parts."""

_MAX_PEAKS = 1000
"""Above this number of ripple peaks, the highest peak is assumed to coincide with the highest load."""


def find_largest_load(joint: str, system: System, options: Options) -> float | None:
    """Return the largest load force in N, as a magnitude, of a joint in a run.

    With a force along the stroke, it is a bound: times and positions of its parts may not coincide.

    Returns:
        None if the joint has no profile or no load.
    """
    p = _read_parameters(Disturbance, f"{joint}.disturbance", system, options)
    if p is None:
        return None
    ends = chain.from_iterable((t, t + p.ramp) for t in p.level_start[1:])
    moments, width = _list_moments(ends, options), abs(0.5 * p.ripple)
    stroke_forces = _find_stroke_forces(joint, system, options)
    if width and p.ripple_omega:
        first, last = min(moments), max(moments)
        half = math.pi / abs(p.ripple_omega)
        # with so many peaks, one is close to the largest level
        if (last - first) / half > _MAX_PEAKS:
            p.ripple = 0.0
            return _find_largest_force(p, moments, stroke_forces) + width or None
        k = range(math.floor(first / half), math.ceil(last / half) + 1)
        moments += [t for t in ((i + 0.5) * half for i in k) if first <= t <= last]
    return _find_largest_force(p, moments, stroke_forces) or None


def _find_largest_force(
    p: SimpleNamespace, moments: Iterable[float], stroke_forces: Sequence[float]
) -> float:
    forces = [Disturbance.load(Disturbance(), _set_time(p, t)) for t in moments]
    return max(abs(force + stroke_force) for force in forces for stroke_force in stroke_forces)


def _find_stroke_forces(joint: str, system: System, options: Options) -> Sequence[float]:
    """Return the least and the largest force in N along the stroke on a joint's reference; 0 without any."""
    table = read_stroke_table(joint, system, options)
    if table is None:
        return (0.0,)
    range_ = find_reference_range(joint, system, options)
    nearest, farthest = (table.position[0], table.position[-1]) if range_ is None else range_[:2]
    positions = [nearest, farthest, *(x for x in table.position if nearest < x < farthest)]
    forces = [table.force_at(x) for x in positions]
    return min(forces), max(forces)


def read_stroke_table(joint: str, system: System, options: Options) -> StrokeTable | None:
    """Return the load of a joint along the stroke as it runs; None without one."""
    return read_plant_table(partial(get_number, system, options, f"{joint}.plant"))


def find_reference_range(joint: str, system: System, options: Options) -> tuple[float, float, float] | None:
    """Return the range in m and the peak speed in m/s of a joint's reference in a run.

    Returns:
        Lowest and highest position, and peak speed; None if the joint has no reference of its own.
    """
    p = _read_parameters(Reference, f"{joint}.reference", system, options)
    if p is None:
        return None
    moves = [(t, t + 0.5 * d, t + d) for t, d in zip(p.start, p.duration, strict=True)]
    samples = [
        Reference().outputs(_set_time(p, t))
        for t in _list_moments(_repeat_moves(moves, p.period, options), options)
    ]
    positions = [sample["x_d"] for sample in samples]
    return min(positions), max(positions), max(abs(sample["v_d"]) for sample in samples)


def _repeat_moves(moves: Iterable[tuple[float, ...]], period: float, options: Options) -> Iterable[float]:
    """Return the moments of moves; repeated moves count in every period of a run, at most a thousand."""
    single_moments = [t for move in moves for t in move if t < 0.5 * NEVER]
    first, last = get_run_span(options)
    if period <= 0.0 or not math.isfinite(last):
        return single_moments
    first_period = math.floor(first / period)
    periods = range(first_period, min(math.ceil(last / period), first_period + _MAX_PEAKS))
    # the position jumps at the end of a period if its ends differ, so the last moment before counts
    return [i * period + t for i in periods for t in (*single_moments, 0.0, math.nextafter(period, 0.0))]


def get_run_span(options: Options) -> tuple[float, float]:
    """Return start and stop time of a run in s; infinity if no stop time is known."""
    return options.start_time or 0.0, math.inf if options.stop_time is None else options.stop_time


def _list_moments(ends: Iterable[float], options: Options) -> list[float]:
    """Return moments in a run: start, stop, those of `ends`, and some between them."""
    first, last = get_run_span(options)
    inside = [t for t in ends if first < t < last and t < 0.5 * NEVER]
    if not math.isfinite(last):
        # without a stop time, until the last part has begun
        last = max(inside, default=first) + 1.0
    evenly = (first + (last - first) * i / _SAMPLES for i in range(_SAMPLES))
    return [*evenly, last, *inside]


def _read_parameters(
    block: type[Block], component: str, system: System, options: Options
) -> SimpleNamespace | None:
    """Return the parameters of a component by attribute of its block; None if it is not ours."""
    exists = any(c.name == component and c.model == block.__name__ for c in system.components)
    if not exists or not follows_start_values(component, options):
        return None
    parameters = SimpleNamespace()
    for parameter in block.layout().parameters:
        read = [get_number(system, options, component, scalar.name) for scalar in parameter.scalars()]
        values = [
            float(scalar.start) if value is None else value
            for scalar, value in zip(parameter.scalars(), read, strict=True)
        ]
        setattr(parameters, parameter.attribute, values if parameter.shape else values[0])
    return parameters


def _set_time(p: SimpleNamespace, time: float) -> SimpleNamespace:
    p.time = time
    return p
