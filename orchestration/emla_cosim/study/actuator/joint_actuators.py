"""A joint's own actuator, or another one: what its plant, observer and controller are made of."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, is_dataclass, replace
from typing import Any

from emla_fmu.drive import drive
from emla_fmu.observer_gains import ObserverGains, with_poles
from rsba_fmu.foc_gains import FocGains
from rsba_fmu.gains import RsbaGains

from ...base.errors import CommandError, join_names
from .actuator import Actuator

Actuators = Mapping[str, Actuator]
"""Actuators by joint, in the place of the joint's own."""

NONE: Actuators = {}


def check_joints(actuators: Actuators, joints: Iterable[str]) -> None:
    """Raise CommandError for an actuator of a joint that is not there."""
    known = list(joints)
    for name in actuators:
        if name not in known:
            raise CommandError(
                f"there is no joint '{name}' for an actuator; there is {join_names(known)}.", name=name
            )


def default_plant_values(actuator: Actuator) -> dict[str, Any]:
    """Return what a plant has beside the parameter set: the encoder's step, and all that was entered."""
    return dict(actuator.plant)


def realistic_plant_values(actuator: Actuator) -> dict[str, Any]:
    """Return the realistic drive: what was entered, and the rest by the rule for all drives."""
    return asdict(drive(actuator.emla, actuator.i_N)) | actuator.plant


def controller_gains(gains: Any, own: Actuator | None, load: float, sample_time: float) -> Any:
    """Gains of a joint's controller as they are with this actuator and a load force in N.

    a_max is what the motor can brake; loops are as fast as before, in parts of 1 / `sample_time` (s), unless
    the actuator says otherwise.
    """
    if own is None or not is_dataclass(gains) or isinstance(gains, type):
        return gains
    changed: dict[str, Any] = {"a_max": own.braking(load)}
    entered = {name: own.values.get(f"control.{name}") for name in _LOOPS}
    rates = {name: k / sample_time for name, k in entered.items() if k is not None}
    if isinstance(gains, RsbaGains):
        beta_1, beta_2, *currents = gains.beta
        k_1, k_2 = rates.get("k_1", 0.5 * beta_1), rates.get("k_2", 0.5 * beta_2)
        changed["beta"] = (2.0 * k_1, 2.0 * k_2, *currents)
    if isinstance(gains, FocGains):
        changed |= {name: rates[k] for k, name in zip(_LOOPS, ("k_p", "k_v"), strict=True) if k in rates}
    return replace(gains, **changed)


_LOOPS = ("k_1", "k_2")


def observer_gains(gains: ObserverGains, own: Actuator | None, sample_time: float) -> ObserverGains:
    """Gains of a joint's observer as they are with this actuator."""
    if own is None or "control.observer" not in own.values:
        return gains
    return with_poles(gains, own.values["control.observer"] / sample_time)
