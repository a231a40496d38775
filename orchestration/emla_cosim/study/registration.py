"""Register the study's systems, scenarios, metrics and plots; seeds of random sequences."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from ..base.wording import matches_pattern
from ..inputs.schedules import SCHEDULES
from ..recorders.metrics import METRICS, ROLES, TRACKED
from ..run.registered import FOLLOWERS, SEEDS
from ..run.scenarios.scenario_file import (
    CHANGES,
    EXTENSIONS,
    FOLLOWING,
    KINDS,
    PLANS,
    REMARKS,
    SCENARIOS,
    STEPPING,
    SYSTEMS,
    TUNINGS,
    Kind,
)
from ..views.animation import ANIMATIONS
from ..views.plots.pictures import FIGURES
from ..views.plots.stacked import BY_UNIT
from . import brakes, supply, systems
from .actuator.model_parameters import follow_plant_changes
from .actuator.remarks import remarks
from .figures import JOINT_FIGURES, MACHINE_FIGURES, JointMap
from .joints.joint_table import KEYS
from .joints.schema import KIND, list_joint_names, read_joint_text
from .load_control import complete_order
from .loads import create_load_metrics, scheduled_times
from .machines import systems as machines
from .machines.schema import KIND as MACHINE
from .machines.schema import MACHINE_KEYS, read_machine_text
from .metrics import create_joint_metrics
from .packaged_files import read_packaged_text
from .roles import find_machine_roles, find_tracked_joints, find_tracked_loads
from .sketch.machine_picture import MachineAnimation, MachinePicture
from .systems import change_entries, joint_scenario
from .tuning_plans import list_tuning_plans

SEED = "*.seed"
"""Pattern of the start values that seed random sequences."""

MAGNITUDES: Mapping[str, tuple[str, ...]] = {
    "d_2.seed": ("d_2.low", "d_2.high"),
    "sensor.seed": ("sensor.sigma",),
    "sensor.current.seed": ("sensor.current.sigma",),
}
"""Start values that scale a random sequence, by the end of its seed's name.

Two are the ends of a uniform distribution, one is a standard deviation.
"""


def is_random(seed: str, value: Callable[[str], float | None]) -> bool:
    """Return whether a sequence has any effect; sequences that are not ours count as effective.

    Args:
        seed: Full name of the seed.
        value: Returns a start value by full name, or None if it is unknown.
    """
    # a sequence of equal ends, or of zero deviation, is the same for any seed
    for end, scales in MAGNITUDES.items():
        if seed.endswith(f".{end}"):
            prefix = seed.removesuffix(end)
            low, high = [0.0, *(value(f"{prefix}{scale}") for scale in scales)][-2:]
            return low is None or high is None or low != high
    return True


def find_seeds(parameters: Mapping[str, float]) -> list[str]:
    """Return the full names of the seeds of sequences that have an effect, from all parameters."""
    return [name for name in parameters if matches_pattern(name, SEED) and is_random(name, parameters.get)]


JOINTS = "joints"
"""Key of the joints' figures in metrics.json."""

LOADS = "loads"
"""Key of the figures of loads that are not rigid."""


def register() -> None:
    """Register everything under its name; calling it again changes nothing."""
    built_in = systems.SYSTEMS | machines.SYSTEMS
    SYSTEMS.update(built_in)
    FOLLOWING.update(machines.SYSTEMS)
    CHANGES["actuator"] = change_entries
    EXTENSIONS["supply"] = supply.share_supply
    functions: list[tuple[list[Any], Callable[..., Any]]] = [
        (STEPPING, complete_order),
        (STEPPING, supply.complete_order),
        (REMARKS, remarks),
        (REMARKS, supply.remarks),
        (FOLLOWERS, follow_plant_changes),
        (SEEDS, find_seeds),
        (ROLES, find_machine_roles),
        (SCHEDULES, scheduled_times),
    ]
    for registered, function in functions:
        if function not in registered:
            registered.append(function)
    KINDS[KIND] = Kind(KEYS, joint_scenario)
    texts = {
        **{name: partial(read_joint_text, name) for name in list_joint_names()},
        **{name: partial(read_machine_text, name) for name in machines.BUILT_IN},
    }
    for name in built_in:
        SCENARIOS[name] = texts.get(name) or partial(read_packaged_text, "scenarios", name)
    KINDS[MACHINE] = Kind(MACHINE_KEYS, machines.machine_scenario)
    PLANS["study-robustness"] = partial(read_packaged_text, "plans", "study-robustness")
    TUNINGS.update(list_tuning_plans())
    METRICS[LOADS] = create_load_metrics  # before the joints: tables show it first
    METRICS[JOINTS] = create_joint_metrics
    METRICS[brakes.BRAKES] = brakes.create_brake_metrics
    METRICS[supply.SUPPLY] = supply.create_supply_metrics
    TRACKED[JOINTS] = find_tracked_joints
    TRACKED[LOADS] = find_tracked_loads  # after the joints: the last pair of a joint counts
    FIGURES.update(JOINT_FIGURES | MACHINE_FIGURES)
    FIGURES["joints"] = JointMap()
    FIGURES["manipulator"] = MachinePicture()
    FIGURES.update(BY_UNIT)
    ANIMATIONS["manipulator"] = MachineAnimation()
