"""The prototype EMLA and its two experiments (Section V): plant at 10 kHz, control at 1 kHz."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from math import tau
from typing import Any

from emla_fmu.disturbance import LEVELS
from emla_fmu.parameters import EMLAS
from emla_fmu.reference import MOVES, quintic_duration
from emla_fmu.schedule import NEVER

from ..system.model import System
from .controllers import chosen
from .joint import joint
from .systems import ENCODER_STEPS, Choice

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
class Experiment:
    """Peak speed of all moves in m/s, levels of the load in N, and the times in s when they begin."""

    v_peak: float
    levels: tuple[float, ...]
    starts: tuple[float, ...] = ()


EXPERIMENTS = {
    # "added" loads are read as levels: their sum would be 190 kN, and the text ends at 70 to 75 kN
    "experiment-1": Experiment(0.026, (7e3, 20e3, 40e3, 60e3, 70e3), (40.0, 100.0, 200.0, 280.0)),
    "experiment-2": Experiment(0.030, (70e3,)),
}


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


def _prototype(experiment: Experiment, measured: bool, controller: Choice, gains: Choice) -> System:
    """The joint in an experiment; `measured` adds what a drive's sensors and computing time do."""
    emla, start = EMLAS[NAME], WAY_POINTS[0] - START_ERROR
    closing, gain_set = chosen(controller, gains if gains is None else str(gains))
    missing = LEVELS - len(experiment.levels)
    plant = {"x_L_start": start, "resolution": emla.rho * emla.lead / ENCODER_STEPS}
    return joint(
        NAME,
        emla=emla,
        controller=closing.model,
        gains=gain_set.of_controller(NAME, on_machine=False),
        observer_gains=gain_set.observer[NAME],
        reference=cycle(experiment.v_peak),
        disturbance={
            "level": (*experiment.levels, *[experiment.levels[-1]] * missing),
            "level_start": (NEVER, *experiment.starts, *[NEVER] * (LEVELS - 1 - len(experiment.starts))),
            "ripple": RIPPLE,
            "ripple_omega": tau / RIPPLE_PERIOD,
        },
        plant=plant | (_drive(emla.i_range) if measured else {}),
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


SYSTEMS: dict[str, Callable[[Choice, Choice], System]] = {
    NAME: partial(_prototype, EXPERIMENTS["experiment-2"], False),
    **{name: partial(_prototype, experiment, True) for name, experiment in EXPERIMENTS.items()},
}
"""Systems by name, made for a controller and a set of its gains."""
