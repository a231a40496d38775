"""Warnings on a built-in system before its run: on its actuators, and on overrides."""

import math
from collections.abc import Iterator, Sequence

from emla_fmu import EmlaAxis, EmlaCompliantAxis, ScrewCommand

from ...base.errors import CommandError, join_names
from ...run.options import Options
from ...system.model import System
from ..controllers import COMPLIANT, choose_controller
from ..joint import COMPLIANT_PLANTS
from ..joints.motions import ACTUATOR_PARTS
from ..machines.motion import read_system_motion
from .actuator import Actuator
from .derived import holding_torque
from .model_parameters import describe_stale_parameters, follows_start_values, get_number
from .profiles import find_largest_load, find_reference_range, get_run_span, read_stroke_table

_ADAPTIVE_SETS = ("compensated", "robust", "rule")
"""Sets of gains that scale with the sample rate; all others were tuned or printed for one joint."""

_ROUNDING = 1.0 + 1e-9
_TRAJECTORY_COMPONENT = "machine.trajectory"


def remarks(system: System, options: Options) -> Sequence[str]:
    """Return warnings without full stops.

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
    return [*warnings, *_check_gains(actuators, system, options), *describe_stale_parameters(system, options)]


def _check_gains(actuators: dict[str, Actuator], system: System, options: Options) -> Iterator[str]:
    """Yield a warning if the gains were made for another actuator."""
    if not actuators:
        return
    choice = choose_controller(
        options.controller, options.gains, COMPLIANT if _list_compliant(system) else None
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
    """Yield a warning, without full stop, if stiffness or backlash of an actuator lack or are not used."""
    entered = [entry for part in ACTUATOR_PARTS if (entry := f"compliance.{part}") in actuator.values]
    missing = [part for part in ACTUATOR_PARTS if f"compliance.{part}" not in actuator.values]
    is_compliant = f"{joint}.plant" in _list_compliant(system)
    if not is_compliant and entered:
        verb = "is" if len(entered) == 1 else "are"
        yield f"{joint}: {join_names(entered)} {verb} not used, because the load is rigid here"
    if is_compliant and missing and actuator.file is not None:
        yield (
            f"{joint}: {join_names(missing)} between motor and load are those of the joint's own actuator; "
            f"add them to [compliance] of {actuator.label}"
        )


def _list_compliant(system: System) -> list[str]:
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
