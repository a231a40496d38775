"""The experiments with the prototype EMLA (Section V): plant at 10 kHz, control at 1 kHz."""

from collections.abc import Callable
from functools import partial
from typing import Any

import msgspec

from ..system.model import System
from .actuator.joint_actuators import NONE, Actuators, check_joints
from .joints.schema import load_joint
from .systems import Choice, study_joint

EXPERIMENTS = {"experiment-1": "prototype", "experiment-2": "prototype"}
"""The joint of each scenario; its file has motion and load, in `[experiment.SCENARIO]`."""


def _experiment(scenario: str, controller: Choice, gains: Choice, actuators: Actuators = NONE) -> System:
    """Return a joint with the motion and the load of an experiment."""
    name = EXPERIMENTS[scenario]
    check_joints(actuators, (name,))
    own = load_joint(name)
    task = own.experiment(scenario)
    measured = _measured((actuators.get(name) or own.actuator).emla.i_range, own.sample_time)
    own = msgspec.structs.replace(own, load=task.load, plant={**own.plant, **measured})
    return study_joint(
        own,
        controller,
        gains,
        reference=task.reference.parameters(),
        load=task.load.parameters(),
        actuators=actuators,
    ).alone()


def _measured(i_range: float, sample_time: float) -> dict[str, Any]:
    """Return parameters of the drive's sensors and computing time; assumed, except the sample time.

    They are not in a joint file because they follow from the actuator, which the user can replace.
    """
    return {
        "sigma": 1e-8,  # three steps of the encoder
        "delay": sample_time,
        "sigma_i": 1e-3 * i_range,
        "resolution_i": 2.0 * i_range / 2**12,
    }


SYSTEMS: dict[str, Callable[..., System]] = {name: partial(_experiment, name) for name in EXPERIMENTS}
"""Systems by name, made for a controller, a set of its gains, and optionally other actuators."""
