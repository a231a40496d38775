"""The experiments with the prototype EMLA (Section V): plant at 10 kHz, control at 1 kHz."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from math import tau
from typing import Any

from emla_fmu.reference import MOVES, quintic_duration
from emla_fmu.schedule import NEVER

from ..system.model import System
from .actuator.fitting import NONE, Actuators, check_joints
from .joints.library import joint_named
from .joints.schema import Load, Start
from .systems import Choice, study_joint

NAME = "prototype"
"""What the joint is called."""

WAY_POINTS = (0.05, 0.1333, 0.2167, 0.30, 0.2375, 0.175, 0.1125, 0.05)
"""Way-points of a cycle in m, read off the figures: two stops on the way out, three on the way back."""

CYCLE = 40.0
"""Time in s after which the motion repeats; dwells of equal length fill it (assumed)."""

START_ERROR = 4e-3
"""How far in m the screw stands behind the reference at the start: as lift and tilt in Table V (assumed)."""

RIPPLE, RIPPLE_PERIOD = 5e3, 0.01
"""Width of the load's ripple in N, and its period in s: speeds change "every 0.01 s"; a sine is assumed."""


@dataclass(frozen=True)
class Task:
    """What the joint does and meets in an experiment: parameters of the reference, and the load."""

    reference: Mapping[str, Any]
    load: Load


def cycle(v_peak: float) -> dict[str, Any]:
    """Parameters of the reference: moves with this peak speed in m/s through all way-points, and again."""
    moves = len(WAY_POINTS) - 1
    durations = [quintic_duration(b - a, v_peak) for a, b in pairwise(WAY_POINTS)]
    dwell = (CYCLE - sum(durations)) / moves
    starts = [sum(durations[:i]) + i * dwell for i in range(moves)]
    rest = MOVES - moves
    return {
        "x": [*WAY_POINTS, *[WAY_POINTS[-1]] * rest],
        "start": [*starts, *[NEVER] * rest],
        "duration": [*durations, *[1.0] * rest],
        "period": CYCLE,
    }


TASKS = {
    # "added" loads are read as levels: their sum would be 190 kN, and the text ends at 70 to 75 kN
    "experiment-1": Task(
        cycle(0.026),
        Load(
            (7e3, 20e3, 40e3, 60e3, 70e3),
            (40.0, 100.0, 200.0, 280.0),
            ripple=RIPPLE,
            ripple_omega=tau / RIPPLE_PERIOD,
        ),
    ),
    "experiment-2": Task(cycle(0.030), Load((70e3,), (), ripple=RIPPLE, ripple_omega=tau / RIPPLE_PERIOD)),
}
"""What the joint does, by the name of the scenario."""


def _experiment(task: Task, controller: Choice, gains: Choice, actuators: Actuators = NONE) -> System:
    """Return the prototype with a task of its experiments."""
    check_joints(actuators, (NAME,))
    own = joint_named(NAME)
    start = task.reference["x"][0] - START_ERROR
    measured = _measured((actuators.get(NAME) or own.actuator).emla.i_range, own.sample_time)
    own = replace(own, start=Start(start), load=task.load, plant={**own.plant, **measured})
    return study_joint(
        own,
        controller,
        gains,
        reference=task.reference,
        load=task.load.parameters(),
        actuators=actuators,
    ).alone()


def _measured(i_range: float, sample_time: float) -> dict[str, Any]:
    """Return what sensors and computing time of the drive do; all of it assumed, but for the sample."""
    return {
        "sigma": 1e-8,  # 3 steps of the encoder
        "delay": sample_time,
        "sigma_i": 1e-3 * i_range,
        "resolution_i": 2.0 * i_range / 2**12,
    }


SYSTEMS: dict[str, Callable[..., System]] = {name: partial(_experiment, task) for name, task in TASKS.items()}
"""Systems by name, made for a controller, a set of its gains, and maybe another actuator."""
