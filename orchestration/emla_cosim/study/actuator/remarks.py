"""Warnings on a built-in system before its run: on its actuators, and on overrides."""

import math
from collections.abc import Iterator, Sequence

from emla_fmu import EmlaAxis, EmlaCompliantAxis, ScrewCommand

from ...base.errors import CommandError, join_names
from ...run.options import Options
from ...system.model import System
from ..controllers import COMPLIANT, choose_controller
from ..joint import COMPLIANT_PLANTS
from ..joints.motions import OF_ACTUATOR
from ..machines.motion import motion_of_system
from .actuator import Actuator
from .derived import holding_torque
from .model_parameters import describe_stale_parameters, get_number, is_own
from .profiles import largest_load, read_stroke_table, reference_reach, run_span

_BY_RULE = ("compensated", "robust", "rule")
"""Sets of gains that scale with the sample rate; all others were tuned or printed for one joint."""

_ROUNDING = 1.0 + 1e-9
_LED = "machine.trajectory"


def remarks(system: System, options: Options) -> Sequence[str]:
    """Return warnings without full stops.

    Raises:
        CommandError: An actuator cannot do what its joint requires, or a load control has the wrong sensor.
    """
    own = {joint: one for joint, one in options.actuator.items() if isinstance(one, Actuator)}
    problems = [p for joint, one in own.items() for p in _describe_impossible(joint, one, system, options)]
    problems += _describe_wrong_sensors(system, options)
    if problems:
        raise CommandError("\n  ".join(f"{p}." for p in problems), problems=problems)
    found = [f"{joint}: {said}" for joint, one in own.items() for said in one.remarks]
    for joint, one in own.items():
        found += _describe_heavy_load(joint, one, system, options)
        found += _describe_other_stiffness(joint, one, system)
    found += _describe_short_tables(system, options)
    return [*found, *_gains(own, system, options), *describe_stale_parameters(system, options)]


def _gains(own: dict[str, Actuator], system: System, options: Options) -> Iterator[str]:
    """Yield a warning if the gains were made for another actuator."""
    if not own:
        return
    found = choose_controller(
        options.controller, options.gains, COMPLIANT if _list_compliant(system) else None
    )
    name = found.gain_set
    if found.gains.has_controller_gains and name not in _BY_RULE:
        yield (
            f"the gains '{name}' were made for the joint's own actuator; only a_max is adapted. Gains that "
            "adapt to any actuator: rsba's compensated and robust, and foc's rule"
        )


def _describe_impossible(joint: str, own: Actuator, system: System, options: Options) -> Iterator[str]:
    """Yield a message, without full stop, if start, reference or speed exceed the limits."""
    low, high, fastest = own.emla.q_LB, own.emla.q_UB, own.emla.v_max
    stroke = f"the stroke of its actuator, {1e3 * low:.4g} to {1e3 * high:.4g} mm"
    start = get_number(system, options, f"{joint}.plant", "start.x_L")
    if start is not None and not low <= start <= high:
        yield f"{joint} starts at {1e3 * start:.4g} mm, outside {stroke}; set {joint}.plant.start.x_L"
    found = _motion(joint, system, options)
    if found is None:
        return
    nearest, farthest, peak, ways = found
    subject = "reference"
    if get_number(system, options, f"{joint}.command", "model.stiffness"):
        subject = "commanded screw"
        ahead = get_number(system, options, f"{joint}.plant", "start.deflection") or 0.0
        nearest, farthest = nearest + ahead, farthest + ahead
    if not (low <= nearest and farthest <= high):
        yield (
            f"the {subject} of {joint} goes from {1e3 * nearest:.4g} to {1e3 * farthest:.4g} mm, "
            f"outside {stroke}; {ways[0]}, or enter screw.q_LB"
        )
    if peak > _ROUNDING * fastest:
        yield (
            f"the reference of {joint} peaks at {1e3 * peak:.4g} mm/s, faster than its actuator's "
            f"{1e3 * fastest:.4g} mm/s; {ways[1]} {math.ceil(100.0 * peak / fastest) / 100.0:g} times as long"
        )


def _describe_other_stiffness(joint: str, own: Actuator, system: System) -> Iterator[str]:
    """Yield a warning, without full stop, if stiffness or backlash of an actuator lack or are not used."""
    entered = [entry for part in OF_ACTUATOR if (entry := f"compliance.{part}") in own.values]
    missing = [part for part in OF_ACTUATOR if f"compliance.{part}" not in own.values]
    is_compliant = f"{joint}.plant" in _list_compliant(system)
    if not is_compliant and entered:
        verb = "is" if len(entered) == 1 else "are"
        yield f"{joint}: {join_names(entered)} {verb} not used, because the load is rigid here"
    if is_compliant and missing and own.file is not None:
        yield (
            f"{joint}: {join_names(missing)} between motor and load are those of the joint's own actuator; "
            f"add them to [compliance] of {own.label}"
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
        table, motion = read_stroke_table(joint, system, options), _motion(joint, system, options)
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


def _motion(
    joint: str, system: System, options: Options
) -> tuple[float, float, float, tuple[str, str]] | None:
    """Return range in m and peak speed in m/s of a reference in a run, and how to change both."""
    if (found := reference_reach(joint, system, options)) is not None:
        ways = f"set {joint}.reference.waypoint[*]", f"make {joint}.reference.move.duration[*]"
        return *found, ways
    if any(c.name == _LED for c in system.components) and is_own(_LED, options):
        ways = "use another --trajectory", "use a --trajectory that takes"
        return *motion_of_system(system).travel(joint, *run_span(options)), ways
    return None


def _describe_heavy_load(joint: str, own: Actuator, system: System, options: Options) -> Iterator[str]:
    """Yield a warning, without full stop, on a load that the motor cannot hold at all or not continuously."""
    load = largest_load(joint, system, options)
    if load is None:
        return
    needed, most = holding_torque(own.values, load), own.emla.tau_max
    lasting = own.i_N * most / own.emla.i_max
    message = f"{joint}: a load of {load:.4g} N needs {needed:.4g} N m of the motor at rest"
    if needed > most:
        yield f"{message}, more than its peak torque of {most:.4g} N m; the motor cannot hold it"
    elif 0.0 < lasting < needed:
        yield f"{message}, more than its continuous torque of {lasting:.4g} N m"
