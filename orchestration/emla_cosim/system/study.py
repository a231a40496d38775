"""The built-in systems: joints of the paper's study with their references, loads and disturbances."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from emla_fmu import TorqueSource, observer_gains
from emla_fmu.disturbance import LEVELS
from emla_fmu.parameters import EMLAS
from emla_fmu.reference import rest_to_rest
from rsba_fmu import gains

from ..errors import check_choice
from .joint import joint
from .model import System


@dataclass(frozen=True)
class JointStudy:
    """What one joint of the paper's simulation study does and meets."""

    x_start: float
    """Initial screw position in m (Table V)."""
    estimate: float
    """Initial position estimate in m (87)."""
    q_S: float
    """Start of the reference in m (Table II)."""
    q_E: float
    """End of the reference in m (Table II)."""
    v_peak: float
    """Peak speed of the reference in m/s: v_E of the table, the telescope's cut to its bound."""
    load: float
    """Load force in N: the manipulator's static force, positive against extension."""
    d_2: Mapping[str, Any]
    """(82) as parameters of the disturbance."""
    seed: int
    """Start of the joint's random sequences."""


STUDY = {
    "lift": JointStudy(
        x_start=0.240,
        estimate=0.240,
        q_S=0.244,
        q_E=0.270,
        v_peak=0.0607,
        load=57e3,
        d_2={"amplitude_2": (0.8, 0.7), "omega_2": (8.0, 20.0), "arctan_2": 1.2, "decay_2": 3.0},
        seed=1690412731,
    ),
    "tilt": JointStudy(
        x_start=0.385,
        estimate=0.358,
        q_S=0.389,
        q_E=0.442,
        v_peak=0.0808,
        load=25e3,
        d_2={"amplitude_2": (0.8, 0.95), "omega_2": (7.0, 18.0), "low_2": 0.0, "high_2": 2.0},
        seed=715827883,
    ),
    "telescope": JointStudy(
        x_start=0.5,
        estimate=0.5,
        q_S=0.499,
        q_E=0.348,
        v_peak=0.210,
        load=-3.4e3,
        d_2={"amplitude_2": (0.9, -0.3), "omega_2": (65.0, 50.0), "phase_2": (0.0, math.pi / 4.0)},
        seed=1327217885,
    ),
}

VOLTAGE_DISTURBANCES = {
    "amplitude_3": (0.42, 0.032),
    "omega_3": (8.0, 5.0),
    "phase_3": (math.pi / 3.0, -math.pi / 2.0),
    "amplitude_4": -0.15,
    "omega_4": 12.0,
    "phase_4": math.pi / 6.0,
}
"""(83) as parameters of the disturbance; sin(5 t) is cos(5 t - pi/2)."""

UNCERTAINTIES = {"F_2": 0.01, "F_3": 0.002, "F_4": 0.001}
"""(84) as parameters of the plant."""

CONTROLLERS = ("robust", "published")
"""Names of the gain sets of controller and observer."""

ENCODER_STEPS = 2**20
"""Steps per motor turn of the position sensor: a 20-bit encoder (assumed)."""


def _study_joint(
    name: str, controller: str, *, as_printed: bool = False, true_feedback: bool = False
) -> System:
    """One joint of the study.

    `as_printed` is the paper's plant: driven by the commanded current, with an ideal sensor.
    """
    study, emla = STUDY[name], EMLAS[name]
    plant: dict[str, Any] = {"x_L_start": study.x_start, "seed": study.seed, **UNCERTAINTIES}
    if as_printed:
        plant["torque_source"] = int(TorqueSource.COMMAND)
    else:
        plant["resolution"] = emla.rho * emla.lead / ENCODER_STEPS
    published = controller == "published"
    return joint(
        name,
        emla=emla,
        gains=(gains.PUBLISHED if published else gains.ROBUST)[name],
        observer_gains=(observer_gains.PUBLISHED if published else observer_gains.ROBUST)[name],
        reference=rest_to_rest(study.q_S, study.q_E, study.v_peak),
        disturbance={
            "level": (study.load,) * LEVELS,
            "seed": study.seed,
            **study.d_2,
            **VOLTAGE_DISTURBANCES,
        },
        plant=plant,
        estimate=study.estimate if published else study.x_start,
        true_feedback=true_feedback,
    )


def _three_joints(controller: str, **options: bool) -> System:
    first, *others = (_study_joint(name, controller, **options) for name in STUDY)
    return sum(others, first)


def _one_joint(name: str) -> Callable[[str], System]:
    return lambda controller: _study_joint(name, controller)


SYSTEMS: dict[str, Callable[[str], System]] = {
    "study": _three_joints,
    **{name: _one_joint(name) for name in STUDY},
    "published": lambda controller: _three_joints(controller, as_printed=True),
    "published-true-states": lambda controller: _three_joints(
        controller, as_printed=True, true_feedback=True
    ),
}
"""Systems by name, made for one of the gain sets of `CONTROLLERS`."""


def built_in_system(name: str, controller: str) -> System:
    """A system by name; CommandError for a name or a controller that does not exist."""
    check_choice("system", name, SYSTEMS)
    check_choice("controller", controller, CONTROLLERS)
    return SYSTEMS[name](controller)
