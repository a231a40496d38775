"""Warnings on actuators and overrides before a run, and the extremes of its motion and load."""

import math
from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from itertools import chain
from types import SimpleNamespace

from emla_fmu import Disturbance, EmlaAxis, EmlaCompliantAxis, Reference, ScrewCommand
from emla_fmu.schedule import NEVER
from fmublock import Block

from ...base.errors import CommandError, join_names
from ...run.options import Options
from ...system.model import System
from ..controllers import COMPLIANT, choose_controller
from ..joint import COMPLIANT_PLANTS
from ..joints.motions import ACTUATOR_PARTS, StrokeTable, read_plant_table
from ..machines.motion import read_system_motion
from .actuator import Actuator
from .derived import holding_torque
from .model_parameters import describe_stale_parameters, follows_start_values, get_number

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
    """Return the largest magnitude in N of the load at these moments plus a force along the stroke."""
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
    """Set the time in these parameters, and return the same object."""
    p.time = time
    return p


_ADAPTIVE_SETS = ("compensated", "robust", "rule")
"""Sets of gains that scale with the sample rate; all others were tuned or printed for one joint."""

_ROUNDING = 1.0 + 1e-9
_TRAJECTORY_COMPONENT = "machine.trajectory"


def remarks(system: System, options: Options) -> Sequence[str]:
    """Return warnings on actuators and overrides, without full stops.

    Raises:
        CommandError: An actuator cannot do what its joint requires, or a load control has the wrong sensor.
    """
    actuators = {
        joint: actuator for joint, actuator in options.actuator.items() if isinstance(actuator, Actuator)
    }
    problems = [
        p
        for joint, actuator in actuators.items()
        for p in _describe_impossible(joint, actuator, system, options)
    ]
    problems += _describe_wrong_sensors(system, options)
    # now, as the run would fail later or give nonsense
    if problems:
        raise CommandError("\n  ".join(f"{p}." for p in problems), problems=problems)
    warnings = [
        f"{joint}: {warning}" for joint, actuator in actuators.items() for warning in actuator.remarks
    ]
    for joint, actuator in actuators.items():
        warnings += _describe_heavy_load(joint, actuator, system, options)
        warnings += _describe_other_stiffness(joint, actuator, system)
    warnings += _describe_short_tables(system, options)
    return [
        *warnings,
        *_describe_foreign_gains(actuators, system, options),
        *describe_stale_parameters(system, options),
    ]


def _describe_foreign_gains(
    actuators: dict[str, Actuator], system: System, options: Options
) -> Iterator[str]:
    """Yield a warning, without full stop, if the gains were made for another actuator."""
    if not actuators:
        return
    choice = choose_controller(
        options.controller, options.gains, COMPLIANT if _list_compliant_plants(system) else None
    )
    name = choice.gain_set
    if choice.gains.has_controller_gains and name not in _ADAPTIVE_SETS:
        yield (
            f"the gains '{name}' were made for the joint's own actuator; only a_max is adapted. Gains that "
            "adapt to any actuator: rsba's compensated and robust, and foc's rule"
        )


def _describe_impossible(joint: str, actuator: Actuator, system: System, options: Options) -> Iterator[str]:
    """Yield a message, without full stop, if start, reference or speed exceed the limits."""
    low, high, fastest = actuator.emla.q_LB, actuator.emla.q_UB, actuator.emla.v_max
    stroke = f"the stroke of its actuator, {1e3 * low:.4g} to {1e3 * high:.4g} mm"
    start = get_number(system, options, f"{joint}.plant", "start.x_L")
    if start is not None and not low <= start <= high:
        yield f"{joint} starts at {1e3 * start:.4g} mm, outside {stroke}; set {joint}.plant.start.x_L"
    motion = _find_motion(joint, system, options)
    if motion is None:
        return
    nearest, farthest, peak, remedies = motion
    subject = "reference"
    if get_number(system, options, f"{joint}.command", "model.stiffness"):
        subject = "commanded screw"
        deflection = get_number(system, options, f"{joint}.plant", "start.deflection") or 0.0
        # the screw is ahead of the load by the deflection
        nearest, farthest = nearest + deflection, farthest + deflection
    if not (low <= nearest and farthest <= high):
        yield (
            f"the {subject} of {joint} goes from {1e3 * nearest:.4g} to {1e3 * farthest:.4g} mm, "
            f"outside {stroke}; {remedies[0]}, or enter screw.q_LB"
        )
    if peak > _ROUNDING * fastest:
        yield (
            f"the reference of {joint} peaks at {1e3 * peak:.4g} mm/s, faster than its actuator's "
            f"{1e3 * fastest:.4g} mm/s; {remedies[1]} "
            f"{math.ceil(100.0 * peak / fastest) / 100.0:g} times as long"
        )


def _describe_other_stiffness(joint: str, actuator: Actuator, system: System) -> Iterator[str]:
    """Yield a warning, without full stop, if stiffness or backlash of an actuator are missing or not used."""
    entered = [entry for part in ACTUATOR_PARTS if (entry := f"compliance.{part}") in actuator.values]
    missing = [part for part in ACTUATOR_PARTS if f"compliance.{part}" not in actuator.values]
    is_compliant = f"{joint}.plant" in _list_compliant_plants(system)
    if not is_compliant and entered:
        verb = "is" if len(entered) == 1 else "are"
        yield f"{joint}: {join_names(entered)} {verb} not used, because the load is rigid here"
    if is_compliant and missing and actuator.file is not None:
        yield (
            f"{joint}: {join_names(missing)} between motor and load are those of the joint's own actuator; "
            f"add them to [compliance] of {actuator.label}"
        )


def _list_compliant_plants(system: System) -> list[str]:
    """Return the plants with loads that are not rigid."""
    models = {block.__name__ for block in COMPLIANT_PLANTS}
    return [c.name for c in system.components if c.model in models]


def _describe_short_tables(system: System, options: Options) -> Iterator[str]:
    """Yield a warning, without full stop, on each load along the stroke that a motion leaves."""
    for component in system.components:
        joint = component.name.partition(".")[0]
        if component.model not in (EmlaAxis.__name__, EmlaCompliantAxis.__name__):
            continue
        table, motion = read_stroke_table(joint, system, options), _find_motion(joint, system, options)
        if table is None or motion is None:
            continue
        low, high, (nearest, farthest, *_) = table.position[0], table.position[-1], motion
        if not (low <= nearest and farthest <= high):
            yield (
                f"{joint}: the load along the stroke is known from {1e3 * low:.4g} to {1e3 * high:.4g} mm, "
                f"but the reference goes from {1e3 * nearest:.4g} to {1e3 * farthest:.4g} mm; beyond the "
                "table, the force of its end acts"
            )


def _describe_wrong_sensors(system: System, options: Options) -> Iterator[str]:
    """Yield a message, without full stop, if a load control adds a deflection that the encoder measures."""
    for component in system.components:
        joint, _, role = component.name.partition(".")
        stiffness = get_number(system, options, component.name, "model.stiffness")
        if component.model != ScrewCommand.__name__ or role != "command" or not stiffness:
            continue
        if get_number(system, options, f"{joint}.plant", "sensor.at_load"):
            yield (
                f"{joint}.plant.sensor.at_load is true, so the encoder measures the load, but the load "
                "control expects it at the motor and adds the deflection; use --load-control none"
            )


def _find_motion(
    joint: str, system: System, options: Options
) -> tuple[float, float, float, tuple[str, str]] | None:
    """Return range in m and peak speed in m/s of a reference in a run, and how to change both."""
    if (range_and_speed := find_reference_range(joint, system, options)) is not None:
        remedies = f"set {joint}.reference.waypoint[*]", f"make {joint}.reference.move.duration[*]"
        return *range_and_speed, remedies
    if any(c.name == _TRAJECTORY_COMPONENT for c in system.components) and follows_start_values(
        _TRAJECTORY_COMPONENT, options
    ):
        remedies = "use another --trajectory", "use a --trajectory that takes"
        return *read_system_motion(system).travel(joint, *get_run_span(options)), remedies
    return None


def _describe_heavy_load(joint: str, actuator: Actuator, system: System, options: Options) -> Iterator[str]:
    """Yield a warning, without full stop, on a load that the motor cannot hold at all or not continuously."""
    load = find_largest_load(joint, system, options)
    if load is None:
        return
    holding, peak_torque = holding_torque(actuator.values, load), actuator.emla.tau_max
    continuous_torque = actuator.i_N * peak_torque / actuator.emla.i_max
    message = f"{joint}: a load of {load:.4g} N needs {holding:.4g} N m of the motor at rest"
    if holding > peak_torque:
        yield f"{message}, more than its peak torque of {peak_torque:.4g} N m; the motor cannot hold it"
    elif 0.0 < continuous_torque < holding:
        yield f"{message}, more than its continuous torque of {continuous_torque:.4g} N m"
