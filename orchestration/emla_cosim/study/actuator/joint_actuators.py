"""Parameters of a joint's plant, observer and controller with another actuator."""

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
"""Actuators by joint, which replace the joint's own."""

NONE: Actuators = {}


def check_actuator_joints(actuators: Actuators, joints: Iterable[str]) -> None:
    """Raise CommandError if a joint with an actuator does not exist."""
    names = list(joints)
    for name in actuators:
        if name not in names:
            raise CommandError(
                f"there is no joint '{name}' for an actuator; use {join_names(names)}.", name=name
            )


def realistic_plant_values(actuator: Actuator) -> dict[str, Any]:
    """Return the parameters of a realistic drive: entries, and the rest by the rule for all drives."""
    return asdict(drive(actuator.emla, actuator.i_N)) | actuator.plant


def controller_gains(gains: Any, actuator: Actuator | None, load: float, sample_time: float) -> Any:
    """Return the gains of a joint's controller for an actuator.

    a_max is what the motor can brake. Unless the actuator sets their rates, position and speed loop keep
    theirs.

    Args:
        gains: Gains of the controller.
        actuator: The actuator; None leaves the gains unchanged.
        load: Load force in N.
        sample_time: Sample time in s; the actuator's entries are parts of 1 / `sample_time`.
    """
    if actuator is None or not is_dataclass(gains) or isinstance(gains, type):
        return gains
    changes: dict[str, Any] = {"a_max": actuator.braking(load)}
    entered = {name: actuator.values.get(f"control.{name}") for name in _LOOPS}
    rates = {name: k / sample_time for name, k in entered.items() if k is not None}
    if isinstance(gains, RsbaGains):
        # the loops of the currents depend on the sample time alone
        beta_1, beta_2, *currents = gains.beta
        k_1, k_2 = rates.get("k_1", 0.5 * beta_1), rates.get("k_2", 0.5 * beta_2)
        changes["beta"] = (2.0 * k_1, 2.0 * k_2, *currents)
    if isinstance(gains, FocGains):
        changes |= {name: rates[k] for k, name in zip(_LOOPS, ("k_p", "k_v"), strict=True) if k in rates}
    return replace(gains, **changes)


_LOOPS = ("k_1", "k_2")


def observer_gains(gains: ObserverGains, actuator: Actuator | None, sample_time: float) -> ObserverGains:
    """Return the gains of a joint's observer for an actuator."""
    if actuator is None or "control.observer" not in actuator.values:
        return gains
    return with_poles(gains, actuator.values["control.observer"] / sample_time)
