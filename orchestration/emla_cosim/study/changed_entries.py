"""Actuators with other entries than their data sheets have."""

from collections.abc import Mapping
from pathlib import Path

from ..base.errors import CommandError, join_names
from ..system.model import Value
from .actuator.actuator import Actuator
from .actuator.entries import TABLES
from .joints.schema import list_joint_names, load_joint
from .systems import EXPERIMENTS


def change_entries(
    system: str, actuators: Mapping[str, Path | Actuator], entries: Mapping[str, Value]
) -> dict[str, Actuator]:
    """Read the actuators of joints, and return them with other entries.

    Args:
        system: Name of the system; its own joint may have no other actuator.
        actuators: Actuators, or their files, by joint.
        entries: Values by JOINT.TABLE.ENTRY, as data sheets print them.

    Raises:
        CommandError: A name is wrong, a joint has no data sheet, or the changed data sheet has errors.
    """
    found = {name: Actuator.read(one) if isinstance(one, Path) else one for name, one in actuators.items()}
    changes: dict[str, dict[str, dict[str, Value]]] = {}
    for place, value in entries.items():
        joint, table, key = _split(place)
        changes.setdefault(joint, {}).setdefault(table, {})[key] = value
    for joint, tables in changes.items():
        base = found.get(joint) or _own(system, joint)
        found[joint] = base.changed(tables, f"{base.label} with changes")
    return found


def _split(place: str) -> tuple[str, str, str]:
    joint, _, rest = place.partition(".")
    table, _, key = rest.partition(".")
    if table not in TABLES:
        raise CommandError(
            f"the entry '{place}' of a data sheet does not exist; write JOINT.TABLE.ENTRY, with a table of "
            f"{join_names(TABLES)}.",
            entry=place,
        )
    return joint, table, key


def _own(system: str, joint: str) -> Actuator:
    """Return the actuator that a joint of a built-in system has without another one."""
    own = {EXPERIMENTS.get(system, joint), joint}
    if joint not in list_joint_names() or own != {joint}:
        raise CommandError(
            f"{joint} has no data sheet whose entries can change; add --actuator {joint}=FILE.toml.",
            joint=joint,
        )
    return load_joint(joint).sheet
