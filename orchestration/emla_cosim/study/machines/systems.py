"""Systems of a machine: its joints with one trajectory, and the machine as a load or merged with them."""

import contextlib
import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from emla_fmu import EmlaPlant, ScrewCommand
from fmublock import Block
from machine_fmu import write_definition
from machine_fmu.spline import default_spline

from ...base.errors import CommandError, check_choice, join_names
from ...run.options import Options
from ...run.scenarios.scenario_file import ScenarioFile
from ...run.system_options import MODES
from ...system.bond import Bond
from ...system.model import Component, System
from ..actuator.actuator import NONE, Actuator, Actuators, check_actuator_joints
from ..joint import start_values
from ..joints.schema import JointFile
from ..load_control import check_notch_joints
from ..systems import Choice, build_joint_system
from .blocks import MANIPULATOR, MachineBlocks, build_machine_blocks
from .machine_file import MachineFile, load_machine_file, parse_machine_file
from .motion import COMPONENT, Motion, Start, describe_other_machine, find_start, load_motion, rest_at
from .schema import list_machine_names, machines_folder

COUPLED, REPLAYED, MERGED = MODES

_MOTION = ("x", "v", "a")

_REFERENCE_FROM_TRAJECTORY: dict[str, str | None] = {
    f"reference.{x}_d": f"machine.trajectory.{x}_d[{{element}}]" for x in _MOTION
}
_REFERENCE_AND_LOAD = {**_REFERENCE_FROM_TRAJECTORY, "disturbance.F_L": "machine.manipulator.F_L[{element}]"}
_TRAJECTORY_OUTPUT = re.compile(r"machine\.trajectory\.([xva])_d\[\{element\}\]")

_NOT_MERGED = ("friction", "stop")
"""Tables of an actuator that the merged plant does not support."""

_SAMPLED_ROLES = ("disturbance", "observer", "controller")
"""Components of a joint that are sampled like a digital controller, so that all loops of connections are in
the machine."""

_GAINS = "damped", "compensated"
"""The sets of gains of machines whose file names none; the second one if a joint lacks the first."""

_HOLD_TIME = 10.0
"""Stop time in s of a machine without motion."""

_INERTIA = "model.A_eq"
"""The inertia of a drive in the models of controllers and observers."""

_SAME_INERTIA = 0.01
"""Relative difference of inertias up to which a model is not changed: masses in joint files are rounded."""


@dataclass(frozen=True)
class _Mode:
    """How joints and machine are connected.

    Attributes:
        machine: The component of the machine.
        elsewhere: Variables that replace ends of a joint's connections.
        wires: Further connections of a joint.
        bond: The power bond of a joint; None without.
    """

    machine: str
    elsewhere: Mapping[str, str | None]
    wires: Sequence[str]
    bond: Bond | None = None


_MODES: Mapping[str, _Mode] = {
    # load forces of the actual motion: both sides exchange motion and force
    COUPLED: _Mode(
        "machine.manipulator",
        _REFERENCE_AND_LOAD,
        (*(f"{{joint}}.plant.{x}_L -> machine.manipulator.{x}_L[{{element}}]" for x in _MOTION),),
        Bond("machine.manipulator.F_L[{element}]", "{joint}.plant.v_L"),
    ),
    # load forces of the reference motion; no joint affects them
    REPLAYED: _Mode(
        "machine.manipulator",
        _REFERENCE_AND_LOAD,
        (
            *(
                f"machine.trajectory.{x}_d[{{element}}] -> machine.manipulator.{x}_L[{{element}}]"
                for x in _MOTION
            ),
        ),
    ),
    MERGED: _Mode(
        "machine.plant",
        {
            **_REFERENCE_FROM_TRAJECTORY,
            "plant.x_L": "machine.plant.x_L[{element}]",
            "plant.v_L": "machine.plant.v_L[{element}]",
            "plant.d_2": "machine.plant.d_2[{element}]",
            "plant.F_L": None,
        },
        (
            "{joint}.motor.tau_m -> machine.plant.tau_m[{element}]",
            "machine.plant.x_L[{element}] -> {joint}.motor.x_L",
            "machine.plant.v_L[{element}] -> {joint}.motor.v_L",
        ),
    ),
}


def build_machine_system(
    file: MachineFile,
    controller: Choice,
    gains: Choice,
    *,
    mode: str | None = None,
    trajectory: Path | None = None,
    actuators: Actuators = NONE,
    **variant: Any,
) -> System:
    """Return the system of a machine.

    Args:
        file: The machine.
        controller: The controller of all joints.
        gains: The set of its gains.
        mode: One of `MODES`. Default: coupled.
        trajectory: A trajectory file, which replaces the motion of the machine file.
        actuators: Actuators by joint, which replace those of the machine.
        **variant: Further arguments of `build_joint_system`.

    Raises:
        CommandError: An argument does not fit the machine.
    """
    check_actuator_joints(actuators, file.joints)
    check_notch_joints(variant.get("notch", {}), list(file.joints))
    mode = mode or COUPLED
    check_choice("mode", mode, MODES)
    if mode == MERGED:
        _check_merged_support(file, actuators)
    mode_data = _MODES[mode]
    motion = load_motion(trajectory, list(file.joints)) if trajectory is not None else file.motion
    motion_start = file.start if motion is None else motion.first
    starts = {joint: motion_start[joint] + file.start_errors.get(joint, 0.0) for joint in file.joints}
    start = find_start(
        file.machine, list((motion_start if mode == REPLAYED else starts).values()), file.label
    )
    masses = start.masses if motion is None else _find_largest_masses(file, motion, start)
    components, connections, bonds = list[Component](), list[str](), dict[str, Bond]()
    for element, (joint, joint_file) in enumerate(file.joints.items(), 1):
        built = build_joint_system(
            joint_file,
            controller,
            gains,
            reference=None,
            load={},
            ahead=starts[joint] - joint_file.start.x_L,
            actuators=actuators,
            on_machine=True,
            electrical=mode == MERGED,
            elsewhere={
                end: None if name is None else name.format(joint=joint, element=element)
                for end, name in mode_data.elsewhere.items()
            },
            **variant,
        )
        # in replay, the screw moves nothing but itself
        joint_components = built.components
        if mode != REPLAYED:  # where the screw moves the machine
            actuator = actuators.get(joint) or joint_file.actuator
            joint_components = tuple(
                _adapt_models(joint_components, joint_file, actuator, masses[element - 1])
            )
        components += joint_components
        wires = mode_data.wires
        if any(c.model == ScrewCommand.__name__ for c in built.components):
            # the machine makes the motion after the notches
            wires = [_TRAJECTORY_OUTPUT.sub(r"{joint}.command.\1_s", wire) for wire in mode_data.wires]
        connections += [*built.wires, *(wire.format(joint=joint, element=element) for wire in wires)]
        if mode_data.bond is not None:
            bonds[joint] = mode_data.bond.with_names(joint=joint, element=element)
    blocks = build_machine_blocks(file.machine, file.name, [joint.emla for joint in file.joints.values()])
    machine = _build_machine_component(file, blocks, mode, start, starts, actuators)
    components += [_build_trajectory(file, blocks, motion, machine), machine]
    system = System(tuple(components), ()).with_connections(*connections)
    record = {"name": file.name, "definition": json.loads(write_definition(file.machine))}
    return replace(system, bonds=bonds, record={"machine": record})


def _check_merged_support(file: MachineFile, actuators: Actuators) -> None:
    """Raise CommandError if an actuator has friction or end stops, which the merged plant lacks."""
    is_paper = file.machine == load_machine_file(MANIPULATOR).machine
    remedy = "run hdrm-coupled" if is_paper else f"set --mode {COUPLED}"
    for joint, joint_file in file.joints.items():
        values = (actuators.get(joint) or joint_file.sheet).values
        if unsupported := [entry for entry in values if entry.partition(".")[0] in _NOT_MERGED]:
            raise CommandError(
                f"the merged machine does not support friction and end stops of single actuators; for "
                f"{joint}, remove {join_names(unsupported)}, or {remedy}."
            )


def _build_machine_component(
    file: MachineFile,
    blocks: MachineBlocks,
    mode: str,
    start: Start,
    starts: Mapping[str, float],
    actuators: Actuators,
) -> Component:
    """Return the component of the machine."""
    block = blocks.plant if mode == MERGED else blocks.load
    parameters: dict[str, Any] = {}
    if mode == MERGED or actuators:  # with their masses and strokes
        parameters = _list_joint_parameters(block, file, actuators)
    if mode == MERGED:
        parameters["x_L_start"] = list(starts.values())
        parameters["F_2"] = [joint.plant.get("F_2", 0.0) for joint in file.joints.values()]
    values = start_values(block, parameters)
    return Component(_MODES[mode].machine, blocks.model(block), {**values, **start.values})


def _list_joint_parameters(block: type[Block], file: MachineFile, actuators: Actuators) -> dict[str, Any]:
    """Return a block's parameters of all actuators, by attribute."""
    emlas = [(actuators.get(name) or joint.actuator).emla for name, joint in file.joints.items()]
    of_plant = {p.name: p.attribute for p in EmlaPlant.layout().parameters if hasattr(emlas[0], p.attribute)}
    return {
        p.attribute: [getattr(emla, of_plant[p.name]) for emla in emlas]
        for p in block.layout().parameters
        if p.shape and p.name in of_plant
    }


def _build_trajectory(
    file: MachineFile, blocks: MachineBlocks, motion: Motion | None, machine: Component
) -> Component:
    """Return the component of the motion, with a note on what is not as expected."""
    note: Any = ""
    if motion is None:
        note = f"{file.label} has no [motion]; its actuators hold their start."
    elif motion.problem:
        block = blocks.plant if machine.name == _MODES[MERGED].machine else blocks.load
        note = partial(describe_other_machine, motion.problem, machine.name, block)
    parameters = (motion or rest_at(file.start)).parameters
    return Component(COMPONENT, blocks.model(blocks.trajectory), parameters, note=note)


def machine_scenario(content: Mapping[str, Any], where: str, folder: Path) -> ScenarioFile:
    """Return the scenario of a machine file's content; see `parse_machine_file`.

    Args:
        content: The content of the file.
        where: The name of a machine that comes with the study, or the path of a file.
        folder: The folder to which paths in it are relative.
    """
    path = Path(where)
    is_file = bool(path.suffix)
    label = f"the machine file '{where}'" if is_file else f"the machine '{where}'"
    file = parse_machine_file(content, label, path.stem, folder if is_file else machines_folder())
    first, second = _GAINS
    has_first = all(first in joint.gains.get("rsba", {}) for joint in file.joints.values())
    default_gains = first if has_first else second
    return ScenarioFile(
        file.description,
        path.name if is_file else where,
        file.run if "controller" in file.run else {"gains": default_gains, **file.run},
        where,
        folder,
        partial(build_machine_system, file),
        partial(_choose_default_options, file),
        {name: joint.sheet for name, joint in file.joints.items()},
    )


def _choose_default_options(file: MachineFile, options: Options) -> dict[str, Any]:
    """Return options of a machine's scenario that its file and the user can override."""
    times = {name: joint.sample_time for name, joint in file.joints.items()}
    step = min(times.values())
    multiples = {joint: max(1, round(time / step)) for joint, time in times.items()}
    motion = file.motion
    if options.trajectory is not None:
        motion = load_motion(options.trajectory, list(file.joints))
    stop = _HOLD_TIME if motion is None else motion.spline.end
    defaults: dict[str, Any] = {"step_size": step, "stop_time": stop}
    if options.mode == REPLAYED:
        # without a loop, a sampled component needs no mark
        multiples = {joint: multiple for joint, multiple in multiples.items() if multiple > 1}
    else:
        # forces that are late by a step make the telescope diverge at any step size
        defaults["algorithm"] = "strong"
    steps = {f"{joint}.{role}": multiple for joint, multiple in multiples.items() for role in _SAMPLED_ROLES}
    return {**defaults, **({"step_multiples": steps} if steps else {})}


def _build_built_in_system(name: str, *arguments: Any, **options: Any) -> System:
    """Return the system of a machine that comes with the study; the paper's has its optimised motion."""
    file = load_machine_file(name)
    if name == MANIPULATOR:
        file = replace(file, motion=Motion(default_spline()))
    return build_machine_system(file, *arguments, **options)


BUILT_IN = tuple(name for name in list_machine_names() if name != MANIPULATOR)
"""The machines that are scenarios by their name: all but the paper's, which has one for each mode."""

SYSTEMS: dict[str, Callable[..., System]] = {
    "hdrm-replay": partial(_build_built_in_system, MANIPULATOR, mode=REPLAYED),
    "hdrm-coupled": partial(_build_built_in_system, MANIPULATOR, mode=COUPLED),
    "hdrm-merged": partial(_build_built_in_system, MANIPULATOR, mode=MERGED),
    **{name: partial(_build_built_in_system, name) for name in BUILT_IN},
}
"""Systems of machines by name, made for a controller and its gains."""


def _find_largest_masses(file: MachineFile, motion: Motion, start: Start) -> Sequence[float]:
    """Return the largest mass in kg that each screw moves, of the start and of poses of a motion.

    Loops have the least margin where the mass is largest. A joint that moves the mass of its gains at the
    start keeps that one: it is on the machine for which it was tuned.
    """
    masses_of_poses = [start.masses]
    for strokes in motion.spline.evaluated(motion.quarters).tolist():
        with contextlib.suppress(CommandError):  # the run says where the motion cannot be made
            masses_of_poses.append(find_start(file.machine, strokes, file.label).masses)
    return [
        masses[0]
        if abs(_compute_inertia_factor(joint_file, joint_file.actuator, masses[0]) - 1.0) < _SAME_INERTIA
        else max(masses)
        for joint_file, masses in zip(file.joints.values(), zip(*masses_of_poses, strict=True), strict=True)
    ]


def _compute_inertia_factor(joint_file: JointFile, actuator: Actuator, mass: float) -> float:
    """Return the factor of the inertia in a joint's models with which its gains fit a mass in kg.

    Controller and observer turn accelerations into torque with the inertia of their model. Gains of a joint
    were tuned with the mass of its `[compliance]`, or alone, while their model had the drive alone.
    """
    tuned_mass = joint_file.compliance.mass if joint_file.compliance is not None else 0.0
    return (1.0 + mass / _compute_drive_mass(actuator)) / (
        1.0 + tuned_mass / _compute_drive_mass(joint_file.actuator)
    )


def _adapt_models(
    components: Iterable[Component], joint_file: JointFile, actuator: Actuator, mass: float
) -> Iterator[Component]:
    """Yield the components of a joint, with models that fit the mass in kg that its screw moves."""
    factor = _compute_inertia_factor(joint_file, actuator, mass)
    for component in components:
        inertia = component.parameters.get(_INERTIA)
        if not isinstance(inertia, float) or abs(factor - 1.0) < _SAME_INERTIA:
            yield component
        else:
            yield replace(component, parameters={**component.parameters, _INERTIA: factor * inertia})


def _compute_drive_mass(actuator: Actuator) -> float:
    """Return the inertia of a drive at its screw in kg."""
    return float(actuator.emla.alpha_RL * actuator.emla.A_eq)
