"""What a joint idealises: effects that its plant leaves out, read from the values of the plant's parameters.

docs/metrics.md lists them.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from .criteria import format_length
from .roles import find_values, find_variable

_VALUE = "VALUE"
"""In an option: a value that only the user knows."""

_DRIVE, _COMPLIANT = "study-drive", "study-compliant"
"""Scenarios with typical values."""

_COMPLIANT_PLANT = "fmus/EmlaCompliantPlant/EmlaCompliantPlant.fmu"
"""Where `emla build EmlaCompliantPlant` writes the plant with a load that is not rigid."""


@dataclass(frozen=True)
class Idealisation:
    """An effect that a joint leaves out.

    Attributes:
        name: What is idealised.
        label: A few words for a list.
        sentence: A message.
        option: Options of `emla run` that remove it, with `VALUE` for what only the user knows; empty if
            none does.
        source: Where typical values are: a scenario or a standard; empty without one.
    """

    name: str
    label: str
    sentence: str
    option: str
    source: str


class _Effect(NamedTuple):
    """An effect that is off while all its parameters are 0: their roles, with values for the option."""

    name: str
    label: str
    sentence: str
    values: Mapping[str, str]
    source: str


_LEAD = _Effect(
    "lead",
    "exact lead",
    "The lead of the screw is exact; grade 5 of ISO 3408-3 permits 23 µm in 300 mm.",
    # 23 µm in 300 mm, and half of 8 µm in a turn
    {"lead_error": "7.67e-5", "wobble": "4e-6"},
    "ISO 3408-3",
)

_ELECTRICAL = (
    _Effect("position noise", "no position noise", "The encoder has no noise.", {"sigma": _VALUE}, _DRIVE),
    _Effect(
        "position resolution",
        "no position steps",
        "The encoder resolves any distance.",
        {"resolution": _VALUE},
        _DRIVE,
    ),
    _Effect(
        "eccentricity",
        "no eccentricity",
        "The encoder is centred on its shaft.",
        {"eccentricity": "9.7e-5"},  # rad, 20 arc seconds, as in docs/systems.md
        "",
    ),
    _Effect(
        "current measurement",
        "exact currents",
        "The current sensors have neither noise nor steps.",
        dict.fromkeys(("sigma_i", "resolution_i"), _VALUE),
        _DRIVE,
    ),
    _Effect("computing delay", "no delay", "A voltage takes effect at once.", {"delay": _VALUE}, _DRIVE),
    _Effect("dead time", "no dead time", "The inverter has no dead time.", {"dead_time": _VALUE}, _DRIVE),
    _Effect(
        "heating",
        "no heating",
        "The winding does not heat; its temperature is not examined.",
        {"i_N": _VALUE},
        _DRIVE,
    ),
)


def list_idealisations(
    joint: str, parameters: Mapping[str, float], roles: Mapping[str, str] | None = None
) -> list[Idealisation]:
    """Return what a joint idealises. A parameter that its plant does not have says nothing.

    Args:
        joint: The joint.
        parameters: Values of all parameters by full name; Booleans are 0 or 1. Use `RoleNames` to look up
            many joints.
        roles: Names by JOINT.ROLE, which override the default ones.
    """
    plant = _Plant(joint, parameters, roles or {})
    return [
        *_find_ideal_friction(plant),
        *_find_missing_effects(plant, _LEAD),
        *_find_ideal_transmission(plant),
        *_find_assumed_load_force(plant),
        *_find_ideal_losses(plant),
        *_find_missing_effects(plant, *_ELECTRICAL),
        *_find_ideal_torque(plant),
    ]


class _Plant(NamedTuple):
    """The parameters of a joint by role."""

    joint: str
    parameters: Mapping[str, float]
    roles: Mapping[str, str]

    def name(self, role: str) -> str | None:
        """Return the full name of a parameter; None if the plant does not have it."""
        return find_variable(self.joint, role, self.parameters, self.roles)

    def value(self, role: str) -> float:
        """Return the value of a parameter; NaN if the plant does not have it."""
        return find_values(self.joint, self.parameters, self.roles, role)[0]

    def is_off(self, *roles: str) -> bool:
        """Return whether the plant has some of these parameters, all of them 0."""
        values = find_values(self.joint, self.parameters, self.roles, *roles)
        return 0.0 in values and all(x == 0.0 or math.isnan(x) for x in values)

    def option(self, values: Mapping[str, str]) -> str:
        """Return the options that set the parameters of these roles."""
        names = {role: self.name(role) for role in values}
        return " ".join(f"--set {name}={values[role]}" for role, name in names.items() if name is not None)


def _find_missing_effects(plant: _Plant, *effects: _Effect) -> Iterator[Idealisation]:
    """Yield the effects that are off: the plant has their parameters, and all are 0."""
    for effect in effects:
        if plant.is_off(*effect.values):
            option = plant.option(effect.values)
            yield Idealisation(effect.name, effect.label, effect.sentence, option, effect.source)


def _find_ideal_friction(plant: _Plant) -> Iterator[Idealisation]:
    """Yield that the screw has no friction, or only a viscous one."""
    coulomb: dict[str, str] = {"F_C": _VALUE, "F_S": _VALUE}
    if plant.is_off(*coulomb, "B_BS"):
        option = plant.option(coulomb | {"B_BS": _VALUE})
        yield Idealisation("friction", "no friction", "The screw has no friction.", option, _DRIVE)
    elif plant.is_off(*coulomb):
        sentence, option = "The friction of the screw is viscous only.", plant.option(coulomb)
        yield Idealisation("friction", "no Coulomb friction", sentence, option, _DRIVE)


def _find_ideal_transmission(plant: _Plant) -> Iterator[Idealisation]:
    """Yield that the load is rigid, and that it has no backlash; both for plants without such parameters."""
    stiffness, backlash = plant.value("stiffness"), plant.value("backlash")
    screw = plant.name("C_eq")
    is_rigid = math.isnan(stiffness) and screw is not None and not plant.parameters[screw]
    replacement = ""
    if is_rigid and screw is not None and screw.startswith(f"{plant.joint}.plant."):
        replacement = f"--replace {plant.joint}.plant={_COMPLIANT_PLANT}"
    if is_rigid or math.isinf(stiffness):
        sentence = "Nothing yields between screw and load; 100 N/µm yield 100 µm under 10 kN."
        option = replacement or plant.option({"stiffness": _VALUE})
        yield Idealisation("compliance", "rigid", sentence, option, _COMPLIANT)
    if is_rigid or backlash == 0.0:
        sentence = "There is no play between screw and load."
        option = replacement or plant.option({"backlash": _VALUE})
        yield Idealisation("backlash", "no backlash", sentence, option, _COMPLIANT)


def _find_assumed_load_force(plant: _Plant) -> Iterator[Idealisation]:
    """Yield what the load control takes for granted if it does not measure the load."""
    assumed, stiffness = plant.value("assumed_stiffness"), plant.value("stiffness")
    if not (assumed > 0.0 and stiffness > 0.0 and plant.value("k_0") == 0.0):
        return
    play = 0.5 * plant.value("backlash")
    # of the plant's stiffness, which can differ from the one that the load control assumes
    # the play yields to any force, so only the spring counts
    deflection = max(abs(plant.value("start_deflection")) - play, 0.0) * assumed / stiffness
    tenth = format_length(0.1 * deflection)
    yield Idealisation(
        "load force",
        f"known load force (10 % more: {tenth})",
        "The load control knows load force and stiffness, not the position of the load; 10 % more load force "
        f"would move the load by {tenth}.",
        "--load-control sensor",
        "",
    )


def _find_ideal_losses(plant: _Plant) -> Iterator[Idealisation]:
    """Yield that gearbox and screw have no losses, or none when the load drives."""
    if plant.value("eta_GB") == 1.0:
        sentence = "Gearbox and screw have no losses."
        yield Idealisation("losses", "no losses", sentence, plant.option({"eta_GB": _VALUE}), _DRIVE)
    elif plant.value("directional") == 0.0:
        yield Idealisation(
            "losses",
            "no losses when the load drives",
            "A load that drives the joint returns more energy than it gives: its torque is divided by the "
            "efficiency, too.",
            plant.option({"directional": "true"}),
            _DRIVE,
        )


def _find_ideal_torque(plant: _Plant) -> Iterator[Idealisation]:
    if plant.value("ideal_torque") > 0.0:
        sentence = "The motor makes the commanded torque at once, whatever its currents are."
        yield Idealisation("torque", "ideal torque", sentence, plant.option({"ideal_torque": "false"}), "")
