"""The built-in systems of the manipulator: three joints with one trajectory and one machine as load."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from emla_fmu import ScrewCommand
from fmublock import Block
from machine_fmu.trajectory import JOINTS

from ..base.errors import CommandError, join_names
from ..system.bond import Bond
from ..system.model import Component, System, Value
from .actuator.joint_actuators import NONE, Actuators, check_joints
from .joint import start_values
from .joints.schema import load_joint
from .load_control import check_notch_joints
from .machine_motion import Motion, describe_other_machine, load_motion
from .machines.blocks import manipulator_blocks
from .systems import Choice, study_joint

_LED: dict[str, str | None] = {
    f"reference.{name}": f"machine.trajectory.{name}[{{element}}]" for name in ("x_d", "v_d", "a_d")
}
_LOADED = {**_LED, "disturbance.F_L": "machine.manipulator.F_L[{element}]"}
_MOVED = {
    **_LED,
    "plant.x_L": "machine.plant.x_L[{element}]",
    "plant.v_L": "machine.plant.v_L[{element}]",
    "plant.d_2": "machine.plant.d_2[{element}]",
    "plant.F_L": None,
}
_REPLAYED = (
    "machine.trajectory.x_d[{element}] -> machine.manipulator.x_L[{element}]",
    "machine.trajectory.v_d[{element}] -> machine.manipulator.v_L[{element}]",
    "machine.trajectory.a_d[{element}] -> machine.manipulator.a_L[{element}]",
)
_COUPLED = (
    "{joint}.plant.x_L -> machine.manipulator.x_L[{element}]",
    "{joint}.plant.v_L -> machine.manipulator.v_L[{element}]",
    "{joint}.plant.a_L -> machine.manipulator.a_L[{element}]",
)
_BOND = Bond("machine.manipulator.F_L[{element}]", "{joint}.plant.v_L")
_MERGED = (
    "{joint}.motor.tau_m -> machine.plant.tau_m[{element}]",
    "machine.plant.x_L[{element}] -> {joint}.motor.x_L",
    "machine.plant.v_L[{element}] -> {joint}.motor.v_L",
)

_NOT_MERGED = ("friction", "stop")
"""Tables of an actuator that the merged plant does not support."""


def _separate(
    wires: Sequence[str],
    bond: Bond | None,
    controller: Choice,
    gains: Choice,
    trajectory: Path | None = None,
    actuators: Actuators = NONE,
    **variant: Any,
) -> System:
    """Build the machine with the manipulator as a component of its own, which loads the joints."""
    machine = Component("machine.manipulator", "HdrmManipulator")
    if actuators:  # with their masses and strokes
        block = manipulator_blocks().load
        values = start_values(block, _by_joint(block, actuators))
        machine = replace(machine, parameters=values)
    wanted = load_motion(trajectory)
    return _system(controller, gains, wanted, machine, _LOADED, wires, actuators, bond=bond, **variant)


def _merged(
    controller: Choice,
    gains: Choice,
    trajectory: Path | None = None,
    actuators: Actuators = NONE,
    **variant: Any,
) -> System:
    """Build the machine with the mechanics of plants and manipulator in one component."""
    wanted = load_motion(trajectory)
    check_joints(actuators, JOINTS)
    for joint, own in actuators.items():
        if lost := [place for place in own.values if place.partition(".")[0] in _NOT_MERGED]:
            raise CommandError(
                f"the merged machine does not support friction and end stops of single actuators; for "
                f"{joint}, remove {join_names(lost)}, or run hdrm-coupled."
            )
    machine = Component("machine.plant", "HdrmPlant", _mechanics(wanted, actuators))
    return _system(controller, gains, wanted, machine, _MOVED, _MERGED, actuators, electrical=True, **variant)


def _system(
    controller: Choice,
    gains: Choice,
    wanted: Motion,
    machine: Component,
    elsewhere: Mapping[str, str | None],
    wires: Sequence[str],
    actuators: Actuators,
    electrical: bool = False,
    bond: Bond | None = None,
    **variant: Any,
) -> System:
    """Return three joints with their machine; `elsewhere`, `wires` and `bond` are patterns for each joint."""
    check_joints(actuators, JOINTS)
    check_notch_joints(variant.get("notch", {}), JOINTS)
    components, connections, bonds = list[Component](), list[str](), dict[str, Bond]()
    for element, joint in enumerate(JOINTS, 1):
        made = study_joint(
            load_joint(joint),
            controller,
            gains,
            reference=None,
            load={},
            ahead=wanted.ahead[joint],
            actuators=actuators,
            on_machine=True,
            electrical=electrical,
            elsewhere={
                end: None if place is None else place.format(joint=joint, element=element)
                for end, place in elsewhere.items()
            },
            **variant,
        )
        components += made.components
        patterns = wires
        if any(c.model == ScrewCommand.__name__ for c in made.components):
            patterns = [_follow_command(wire) for wire in wires]
        connections += [*made.wires, *(wire.format(joint=joint, element=element) for wire in patterns)]
        if bond is not None:
            bonds[joint] = bond.with_names(joint=joint, element=element)
    block = manipulator_blocks().plant if electrical else manipulator_blocks().load
    note = partial(describe_other_machine, wanted.problem, machine.name, block) if wanted.problem else ""
    shared = (Component("machine.trajectory", "Trajectory", wanted.parameters, note=note), machine)
    system = System((*components, *shared), ()).with_connections(*connections)
    return replace(system, bonds=bonds)


def _follow_command(wire: str) -> str:
    """Return a pattern of a connection to the machine, which makes the motion after the notches."""
    for name in ("x", "v", "a"):
        wire = wire.replace(f"machine.trajectory.{name}_d[{{element}}]", f"{{joint}}.command.{name}_s")
    return wire


def _mechanics(wanted: Motion, actuators: Actuators) -> dict[str, Value]:
    """Return the parameters of the actuators in the merged plant, and its start position."""
    start = [load_joint(joint).start.x_L + wanted.ahead[joint] for joint in JOINTS]
    uncertain = [load_joint(joint).plant.get("F_2", 0.0) for joint in JOINTS]
    block = manipulator_blocks().plant
    return start_values(block, {**_by_joint(block, actuators), "x_L_start": start, "F_2": uncertain})


def _by_joint(block: type[Block], actuators: Actuators) -> dict[str, Any]:
    """Return a block's parameters of all actuators, by attribute."""
    emlas = [(actuators.get(joint) or load_joint(joint).actuator).emla for joint in JOINTS]
    names = {x.attribute: str(x.name).rpartition(".")[2] for x in block.layout().parameters if x.shape}
    return {
        attribute: [getattr(emla, name) for emla in emlas]
        for attribute, name in sorted(names.items())
        if hasattr(emlas[0], name)
    }


SYSTEMS: dict[str, Callable[..., System]] = {
    # load forces of the reference motion, as in the paper; no joint affects them
    "hdrm-replay": partial(_separate, _REPLAYED, None),
    # load forces of the actual motion: both sides exchange motion and force
    "hdrm-coupled": partial(_separate, _COUPLED, _BOND),
    "hdrm-merged": _merged,
}
"""Systems by name, made for a controller and its gains, and optionally a trajectory file and actuators."""
