"""The prototype EMLA in one move and in its experiments (Section V): plant at 10 kHz, control at 1 kHz."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from math import tau
from typing import Any

from emla_fmu.disturbance import LEVELS
from emla_fmu.reference import MOVES, quintic_duration, rest_to_rest
from emla_fmu.schedule import NEVER

from ..system.model import System
from .actuator.fitting import (
    NONE,
    Actuators,
    check_joints,
    controller_gains,
    emla_of,
    observer_gains,
    usual_plant,
)
from .controllers import chosen
from .joint import joint
from .systems import Choice

NAME = "prototype"
"""What the joint is called."""

WAY_POINTS = (0.05, 0.1333, 0.2167, 0.30, 0.2375, 0.175, 0.1125, 0.05)
"""Way-points of a cycle in m, read off the figures: two stops on the way out, three on the way back."""

CYCLE = 40.0
"""Time in s after which the motion repeats; dwells of equal length fill it (assumed)."""

START_ERROR = 4e-3
"""How far in m the screw stands behind the reference at the start: as lift and tilt in Table V (assumed)."""

SAMPLE = 1e-3
"""Sample time of observer and controller in s; the drive's computing takes one."""

RIPPLE, RIPPLE_PERIOD = 5e3, 0.01
"""Width of the load's ripple in N, and its period in s: speeds change "every 0.01 s"; a sine is assumed."""


@dataclass(frozen=True)
class Task:
    """What the joint does and meets: parameters of the reference, and levels of the load in N.

    `starts` are the times in s when all levels but the first begin. `ripple` is the load's width in N, and
    `measured` adds what a drive's sensors and computing time do.
    """

    reference: Mapping[str, Any]
    levels: tuple[float, ...]
    starts: tuple[float, ...] = ()
    ripple: float = 0.0
    measured: bool = False


def one_move(x_i: float, x_f: float, duration: float) -> dict[str, Any]:
    """Parameters of the reference: a quintic move from x_i to x_f (m) in so many seconds, then hold."""
    return rest_to_rest(x_i, x_f, 15.0 * abs(x_f - x_i) / (8.0 * duration))


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
    NAME: Task(one_move(0.05, 0.15, 4.0), (20e3,)),
    # "added" loads are read as levels: their sum would be 190 kN, and the text ends at 70 to 75 kN
    "experiment-1": Task(
        cycle(0.026), (7e3, 20e3, 40e3, 60e3, 70e3), (40.0, 100.0, 200.0, 280.0), RIPPLE, measured=True
    ),
    "experiment-2": Task(cycle(0.030), (70e3,), (), RIPPLE, measured=True),
}
"""What the joint does, by the name of the scenario."""


def _prototype(task: Task, controller: Choice, gains: Choice, actuators: Actuators = NONE) -> System:
    """The joint with a task."""
    check_joints(actuators, (NAME,))
    emla, own, start = emla_of(NAME, actuators), actuators.get(NAME), task.reference["x"][0] - START_ERROR
    closing, gain_set = chosen(controller, gains if gains is None else str(gains))
    missing, load = LEVELS - len(task.levels), max(task.levels) + 0.5 * task.ripple
    return joint(
        NAME,
        emla=emla,
        controller=closing.model,
        gains=controller_gains(gain_set.of_controller(NAME, on_machine=False), own, load, SAMPLE),
        observer_gains=observer_gains(gain_set.observer[NAME], own, SAMPLE),
        reference=task.reference,
        disturbance={
            "level": (*task.levels, *[task.levels[-1]] * missing),
            "level_start": (NEVER, *task.starts, *[NEVER] * (LEVELS - 1 - len(task.starts))),
            "ripple": task.ripple,
            "ripple_omega": tau / RIPPLE_PERIOD,
        },
        plant={
            "x_L_start": start,
            **(_drive(emla.i_range) if task.measured else {}),
            **usual_plant(NAME, actuators),
        },
        estimate=start,
    ).alone()


def _drive(i_range: float) -> dict[str, Any]:
    """What the sensors and the computing time of the drive do; all of it assumed, but for the sample."""
    return {
        "sigma": 1e-8,  # 3 steps of the encoder
        "delay": SAMPLE,
        "sigma_i": 1e-3 * i_range,
        "resolution_i": 2.0 * i_range / 2**12,
    }


SYSTEMS: dict[str, Callable[..., System]] = {name: partial(_prototype, task) for name, task in TASKS.items()}
"""Systems by name, made for a controller, a set of its gains, and maybe another actuator."""
