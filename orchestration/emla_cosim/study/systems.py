"""The built-in systems: joints of the paper's study with their references, loads and disturbances."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any

from emla_fmu import TorqueSource
from emla_fmu.disturbance import LEVELS
from emla_fmu.reference import rest_to_rest
from fmublock.noise import MODULUS

from ..system.model import System
from .actuator.fitting import (
    NONE,
    Actuators,
    check_joints,
    controller_gains,
    drive_plant,
    emla_of,
    observer_gains,
    usual_plant,
)
from .controllers import chosen
from .joint import Joint, joint


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

SAMPLE = 1e-4
"""Sample time of observer and controller in s."""

MECHANICAL = ("x_L_start", "F_2", "stop_stiffness", "stop_damping")
"""What of the values below and beside them belongs to the mechanical half of the plant."""

UNCERTAINTIES = {"F_2": 0.01, "F_3": 0.002, "F_4": 0.001}
"""(84) as parameters of the plant."""

Choice = str | type | None
"""A controller, or a set of gains: by name, the controller also as a block; None for the usual one."""


def _study_joint(
    name: str,
    controller: Choice,
    gains: Choice,
    *,
    actuators: Actuators = NONE,
    as_printed: bool = False,
    true_feedback: bool = False,
    drive: bool = False,
) -> System:
    """One joint of the study; see `study_joint`."""
    study = STUDY[name]
    return study_joint(
        name,
        controller,
        gains,
        reference=rest_to_rest(study.q_S, study.q_E, study.v_peak),
        load={"level": (study.load,) * LEVELS},
        actuators=actuators,
        as_printed=as_printed,
        true_feedback=true_feedback,
        drive=drive,
    ).alone()


def study_joint(
    name: str,
    controller: Choice,
    gains: Choice,
    *,
    reference: Mapping[str, Any] | None,
    load: Mapping[str, Any],
    ahead: float = 0.0,
    actuators: Actuators = NONE,
    as_printed: bool = False,
    true_feedback: bool = False,
    drive: bool = False,
    on_machine: bool = False,
    electrical: bool = False,
    elsewhere: Mapping[str, str | None] = MappingProxyType({}),
) -> Joint:
    """One joint of the study, or `on_machine` of the manipulator.

    It starts where the study has it, or by `ahead` m farther out. `load` is the load force as parameters of
    the disturbance, `reference` the motion as those of the reference; see `joint` for `electrical` and
    `elsewhere`. One of `actuators` may take the place of its own. `as_printed` is the paper's plant: driven
    by the commanded current, with an ideal sensor.
    `drive` is a drive as it is (`emla_fmu.drive`).
    """
    study, own = STUDY[name], actuators.get(name)
    plant: dict[str, Any] = {"x_L_start": study.x_start + ahead, "seed": study.seed, **UNCERTAINTIES}
    if as_printed:
        plant["torque_source"] = int(TorqueSource.COMMAND)
    elif drive:
        plant |= {**drive_plant(name, actuators), "seed_i": current_seed(study.seed)}
    else:
        plant |= usual_plant(name, actuators)
    if on_machine:  # a joint that loses its power falls until it is stopped
        stops = drive_plant(name, actuators)
        plant |= {stop: stops[stop] for stop in ("stop_stiffness", "stop_damping")}
    if electrical:
        plant = {name: value for name, value in plant.items() if name not in MECHANICAL}
    closing, gain_set = chosen(controller, gains if gains is None else str(gains))
    estimate = study.estimate if gain_set.printed_estimate else study.x_start
    return joint(
        name,
        emla=emla_of(name, actuators),
        controller=closing.model,
        gains=controller_gains(gain_set.of_controller(name, on_machine), own, study.load, SAMPLE),
        observer_gains=observer_gains(gain_set.observer[name], own, SAMPLE),
        reference=reference,
        disturbance={**load, "seed": study.seed, **study.d_2, **VOLTAGE_DISTURBANCES},
        plant=plant,
        estimate=estimate + ahead,
        true_feedback=true_feedback,
        electrical=electrical,
        elsewhere=elsewhere,
    )


def current_seed(seed: int) -> int:
    """Seed of the current sensors' noise beside that of the position's: far from it in the sequence."""
    return 69621 * seed % int(MODULUS)


def _side_by_side(
    joints: Iterable[str], controller: Choice, gains: Choice, actuators: Actuators = NONE, **variant: bool
) -> System:
    check_joints(actuators, joints)
    first, *others = (
        _study_joint(name, controller, gains, actuators=actuators, **variant) for name in joints
    )
    return sum(others, first)


_three_joints = partial(_side_by_side, tuple(STUDY))

SYSTEMS: dict[str, Callable[..., System]] = {
    "study": _three_joints,
    "study-drive": partial(_three_joints, drive=True),
    **{name: partial(_side_by_side, (name,)) for name in STUDY},
    "published": partial(_three_joints, as_printed=True),
    "published-true-states": partial(_three_joints, as_printed=True, true_feedback=True),
}
"""Systems by name, made for a controller, a set of its gains, and maybe other actuators by joint."""
