"""Control of the load's position where it is not that of the screw: what a joint gets for it.

docs/load-control.md explains the methods.
"""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

from emla_fmu.parameters import EmlaParameters
from emla_fmu.screw_command import NOTCHES

from ..base.errors import CommandError, suggest_names
from ..base.quantities import parse_quantity, parse_unit_name
from ..run.system_options import LOAD_CONTROLS
from ..system.model import System
from .joints.motions import Compliance, LoadFeedback

NONE, MOTOR, SENSOR = LOAD_CONTROLS
"""Values of the option `load_control`: the sensors by which the load's position is controlled."""

_APPROACH_PERIODS = 3.0
"""Shortest duration of the approach in periods of the load on a held screw: with 1.6, a load of 3.2 Hz swings
more after a planned start than after one by the controller alone."""

_SPEED_SHARE = 0.9
"""Fraction of the joint's largest speed that reference motion and approach may take together. Controllers
limit themselves to 0.95: a command with that speed leaves them nothing for errors, and tilt lags by
millimetres."""

_APPROACH_FORCE_SHARE = 0.1
"""Fraction of the force that the motor has left under the load for the acceleration of the approach."""


@dataclass(frozen=True)
class LoadControl:
    """How a joint's screw is commanded.

    Attributes:
        sensors: One of `NONE`, `MOTOR` and `SENSOR`.
        frequencies: What the reference motion avoids, in Hz.
    """

    sensors: str = NONE
    frequencies: tuple[float, ...] = ()

    @property
    def has_command(self) -> bool:
        """Whether a `ScrewCommand` is between reference and controller."""
        return self.sensors != NONE or bool(self.frequencies)

    @property
    def has_sensor(self) -> bool:
        """Whether a sensor at the load and a `LoadObserver` are used."""
        return self.sensors == SENSOR


def choose_load_control(
    joint: str, sensors: str | None, notch: Mapping[str, float | str], compliant: bool
) -> LoadControl:
    """Return how a joint's screw is commanded.

    Args:
        joint: The joint.
        sensors: The option `load_control`; None is `MOTOR` for a load that is not rigid.
        notch: The option `notch`: frequencies by joint, `*` for all.
        compliant: Whether the load is not rigid.

    Raises:
        CommandError: A rigid load has no position of its own, or a frequency is wrong.
    """
    if sensors in (MOTOR, SENSOR) and not compliant:
        raise CommandError(
            f"the load of {joint} is rigid, so its position is that of the screw; the load control "
            f"'{sensors}' is for loads that are not rigid, as in study-compliant.",
            joint=joint,
        )
    text = notch.get(joint, notch.get("*"))
    frequencies = () if text is None else _read_frequencies(joint, text)
    return LoadControl(sensors or (MOTOR if compliant else NONE), frequencies)


def check_notch_joints(notch: Mapping[str, float | str], joints: Collection[str]) -> None:
    """Raise CommandError if a joint of the option `notch` does not exist."""
    for name in notch:
        if name not in ("*", *joints):
            raise CommandError(
                f"the joint '{name}' of a notch does not exist; {suggest_names(name, list(joints))}"
            )


def complete_order(system: System, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the option `order` with load controls and brakes before controllers; empty without an order.

    They have no step multiple, even if the controller has one: like a reference, they make a motion, and a
    held motion is late.

    Args:
        system: The system.
        options: Options of the algorithm that are set.
    """
    order = list[str](options.get("order") or ())
    for component in system.components:
        joint, _, role = component.name.partition(".")
        controller = f"{joint}.controller"
        if (
            role in ("load_observer", "command", "brake")
            and controller in order
            and component.name not in order
        ):
            order.insert(order.index(controller), component.name)
    return {"order": order} if order else {}


def _read_frequencies(joint: str, entry: float | str) -> tuple[float, ...]:
    """Return the frequencies in Hz of an entry such as 6.5, "6.5 Hz" or "6.5 Hz, 20 Hz"."""
    parts = entry.split(",") if isinstance(entry, str) else [entry]
    label = f"the notch of {joint}"
    frequencies = tuple(
        _read_frequency(part.strip(), label) if isinstance(part, str) else float(part) for part in parts
    )
    if len(frequencies) > NOTCHES or not all(0.0 < f < math.inf for f in frequencies):
        raise CommandError(
            f"{label} is {entry!r}; it must be one or {NOTCHES} positive frequencies, such as 6.5 Hz.",
            joint=joint,
        )
    return frequencies


def _read_frequency(text: str, label: str) -> float:
    """Return a frequency in Hz of a text that may have an angular frequency or a speed of turns."""
    hertz = parse_unit_name("Hz", label)
    quantity = parse_quantity(text, label, hertz)
    is_angular = quantity.unit is not None and quantity.unit.powers.get("rad", 0) != 0
    return quantity.in_unit(hertz, label) / (2.0 * math.pi if is_angular else 1.0)


def command_parameters(
    control: LoadControl,
    emla: EmlaParameters,
    compliance: Compliance | None,
    feedback: LoadFeedback,
    force: float,
) -> dict[str, Any]:
    """Return the parameters of `ScrewCommand`, by attribute.

    Args:
        control: How the screw is commanded.
        emla: The actuator.
        compliance: The load that is not rigid; None for a rigid one.
        feedback: The poles of the feedback.
        force: The load force at the start in N, as far as the command knows it.
    """
    values: dict[str, Any] = {}
    if control.frequencies:
        count = len(control.frequencies)
        values["frequency"] = [*control.frequencies, *[0.0] * (NOTCHES - count)]
        # the zero of the filter is at the poles of the swing; the frequency of a rigid joint has unknown
        # damping
        zeta = 0.0 if compliance is None else compliance.damping_ratio
        values["damping_ratio"] = [zeta] * count + [0.0] * (NOTCHES - count)
    if control.sensors == NONE or compliance is None:
        return values
    moved_mass = emla.alpha_RL * emla.A_eq + compliance.mass
    available_force = emla.eta_GB * emla.alpha_RL * emla.tau_max - abs(force)
    values |= {
        "stiffness": compliance.stiffness,
        "m_load": compliance.mass,
        "backlash": compliance.backlash,
        "approach_time": approach_duration(compliance.mass, compliance.stiffness),
        "v_max": _SPEED_SHARE * emla.v_max,
        "approach_acceleration": _APPROACH_FORCE_SHARE * max(available_force, 0.1 * abs(force)) / moved_mass,
    }
    if control.has_sensor:
        values |= feedback.gains(compliance.omega)
    else:
        # a sensor at the load measures the force by the deflection at the start
        values["F_hat"] = force
    return values


def approach_duration(mass: float, stiffness: float) -> float:
    """Return the shortest duration of the approach in s for a load of kg behind a spring of N/m."""
    return _APPROACH_PERIODS * 2.0 * math.pi / math.sqrt(stiffness / mass)


def observer_parameters(compliance: Compliance, feedback: LoadFeedback) -> dict[str, Any]:
    """Return the parameters of `LoadObserver`, by attribute."""
    w = feedback.observer * compliance.omega
    k, c, m = compliance.stiffness, compliance.damping, compliance.mass
    # three equal poles at -w: the coefficients of (s + w)^3 without those of the load itself
    l_1 = 3.0 * w - c / m
    return {
        "stiffness": k,
        "damping": c,
        "m_load": m,
        "backlash": compliance.backlash,
        "l_1": l_1,
        "l_2": 3.0 * w * w - (k + c * l_1) / m,
        "l_3": w * w * w,
    }
