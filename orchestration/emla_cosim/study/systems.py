"""The built-in systems: joints of the paper's study with their references, loads and disturbances.

Their actuators can have other entries than their data sheets.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import msgspec

from emla_fmu import EmlaMotor
from emla_fmu.observer_gains import ObserverGains
from fmublock.noise import MODULUS

from ..base.errors import CommandError, join_names
from ..run.scenarios.scenario_file import ScenarioFile
from ..system.model import System, Value
from .actuator.actuator import (
    NONE,
    Actuator,
    Actuators,
    check_actuator_joints,
    controller_gains,
    observer_gains,
    realistic_plant_values,
)
from .actuator.entries import TABLES
from .controllers import COMPLIANT, ControllerWithGains, choose_controller
from .joint import Joint, build_joint
from .joints.schema import JointFile, list_joint_names, load_joint, parse_joint
from .load_control import (
    LoadControl,
    check_notch_joints,
    choose_load_control,
    command_parameters,
    observer_parameters,
)

STUDY = ("lift", "tilt", "telescope")
"""The joints of the study; further joint files do not add to them."""

EXPERIMENTS = {"experiment-1": "prototype", "experiment-2": "prototype"}
"""The joint of each experiment with the prototype EMLA (Section V): plant at 10 kHz, control at 1 kHz.

Its file has motion and load, in `[experiment.SCENARIO]`.
"""

Choice = str | type | None
"""A controller or a set of gains by name, a controller also as a block; None for the default."""


def build_joint_system(
    joint_file: JointFile,
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
    compliant: bool = False,
    load_control: str | None = None,
    notch: Mapping[str, float | str] = MappingProxyType({}),
    elsewhere: Mapping[str, str | None] = MappingProxyType({}),
) -> Joint:
    """Return a joint, alone or on a machine: its components and connections.

    Args:
        joint_file: The file of the joint.
        controller: The controller.
        gains: The set of its gains.
        reference: The motion, as parameters of the reference; see `build_joint` for None.
        load: The load force, as parameters of the disturbance.
        ahead: Distance in m by which the joint starts farther out than in its file.
        actuators: Actuators by joint, which replace the joint's own.
        as_printed: Whether to use the paper's plant: driven by the commanded current, with an ideal sensor.
        true_feedback: See `build_joint`.
        drive: Whether to use a realistic drive (`emla_fmu.drive`).
        on_machine: Whether the joint moves a machine, and so has the gains and the end stops for it.
        electrical: See `build_joint`.
        compliant: Whether to use the load of `[compliance]`, which is not rigid. A file can say so for all
            scenarios but those with the paper's plant or with the manipulator.
        load_control: See `choose_load_control`.
        notch: See `choose_load_control`.
        elsewhere: See `build_joint`.

    Raises:
        CommandError: The joint has no gains for the controller, no `[compliance]`, or no load to control.
    """
    if joint_file.compliance is not None and joint_file.compliance.always:
        # the paper has rigid joints, and on a machine the machine is the load
        compliant = compliant or not (as_printed or on_machine)
    replacement = actuators.get(joint_file.name)
    actuator, x_L = replacement or joint_file.actuator, joint_file.start.x_L
    plant: dict[str, Any] = {**joint_file.plant, "x_L_start": x_L + ahead}
    seeds = {} if joint_file.seed is None else {"seed": joint_file.seed}
    plant |= seeds
    if as_printed:
        plant["use_commanded_current"] = True
    elif drive or joint_file.drive.always:
        plant |= realistic_plant_values(replacement or joint_file.realistic)
        plant |= {} if joint_file.seed is None else {"seed_i": derive_current_seed(joint_file.seed)}
    else:
        plant |= actuator.plant  # the encoder step, and all that was entered
    if on_machine:  # a joint without power falls until an end stop holds it
        stops = realistic_plant_values(replacement or joint_file.realistic)
        plant |= {stop: stops[stop] for stop in ("stop_stiffness", "stop_damping")}
    if electrical:
        attributes = {x.attribute for x in EmlaMotor.layout().parameters}
        plant = {name: value for name, value in plant.items() if name in attributes}
    control = choose_load_control(joint_file.name, load_control, notch, compliant)
    compliance, force = None, load["level"][0] if load else 0.0
    if compliant:
        compliance = joint_file.compliant_load.with_actuator(actuator.values)
    table = joint_file.load.table if load else None  # on a machine, the machine is the load
    if table is not None:
        force = joint_file.load.force_at_start(x_L + ahead, compliance)
        plant |= table.parameters()
    if joint_file.brake is not None:
        _check_brake(joint_file.name, electrical, control)
        plant |= {"brake_torque": joint_file.brake.torque}
    if compliance is not None:
        plant |= compliance.parameters(force)
    load_observer, feedback = None, joint_file.load_feedback
    if control.has_sensor and compliance is not None:
        load_observer = observer_parameters(compliance, feedback)
        plant |= {"sigma_load": feedback.sigma, "resolution_load": feedback.resolution}
        # 48271 as in `derive_current_seed`
        plant |= {} if joint_file.seed is None else {"seed_load": 48271 * joint_file.seed % int(MODULUS)}
    command = None
    if control.has_command:
        command = command_parameters(control, actuator.emla, compliance, feedback, force)
    # joint files of users can lack this set
    has_compliant_gains = compliant and COMPLIANT in joint_file.gains.get(str(controller or "rsba"), {})
    choice = choose_controller(
        controller, gains if gains is None else str(gains), COMPLIANT if has_compliant_gains else None
    )
    loop_gains, of_observer, estimate = _choose_gains(joint_file, choice, on_machine)
    return build_joint(
        joint_file.name,
        emla=actuator.emla,
        controller=choice.controller.model,
        gains=controller_gains(loop_gains, replacement, joint_file.load.largest, joint_file.sample_time),
        observer_gains=observer_gains(of_observer, replacement, joint_file.sample_time),
        reference=reference,
        disturbance={**load, **seeds, **joint_file.disturbance},
        plant=plant,
        # the observer begins as near to the screw as in the file
        estimate=estimate + ahead,
        true_feedback=true_feedback,
        electrical=electrical,
        compliant=compliant,
        on_stroke=table is not None or joint_file.brake is not None,
        command=command,
        load_observer=load_observer,
        brake=None if joint_file.brake is None else joint_file.brake.parameters(),
        elsewhere=elsewhere,
    )


def _check_brake(joint: str, electrical: bool, control: LoadControl) -> None:
    """Raise CommandError if the joint's brake is not supported."""
    if electrical:
        raise CommandError(
            f"the merged machine does not support the holding brake of {joint}; set --mode coupled, or "
            "remove [brake] from its joint file.",
            joint=joint,
        )
    if control.has_sensor:
        raise CommandError(
            f"the load control 'sensor' of {joint} does not support its holding brake: its feedback would "
            "wind up while the screw is held; set --load-control motor, or remove [brake] from its joint "
            "file.",
            joint=joint,
        )


def _choose_gains(
    joint_file: JointFile, choice: ControllerWithGains, on_machine: bool
) -> tuple[Any, ObserverGains, float]:
    """Return the gains of controller and observer, and where the observer starts in m.

    Raises:
        CommandError: The joint has no such gains.
    """
    of_set, x_L = choice.gains, joint_file.start.x_L
    if of_set.in_file:
        in_file = joint_file.gain_set(choice.name, choice.gain_set)
        observer = in_file.observer
        return (
            in_file.on_machine if on_machine else in_file.controller,
            observer.gains,
            x_L if observer.estimate is None else observer.estimate,
        )
    default = of_set.controller.get(joint_file.name)
    if default is None and of_set.controller:
        raise CommandError(
            f"the gains '{choice.gain_set}' of the controller '{choice.name}' have none for the joint "
            f"'{joint_file.name}'; add them to its ec.Gains.",
            joint=joint_file.name,
        )
    of_controller = of_set.on_machine.get(joint_file.name, default) if on_machine else default
    observer = joint_file.observer_of(of_set.observer, choice.name, choice.gain_set)
    printed = joint_file.observers.get("published") if of_set.printed_estimate else None
    estimate = (printed or observer).estimate
    return of_controller or {}, observer.gains, x_L if estimate is None else estimate


def derive_current_seed(seed: int) -> int:
    """Return the seed of the current sensors' noise, far from that of the position noise."""
    # a multiplier of Lehmer generators with this modulus, as 48271 is, which the load sensor has for the
    # same reason; 16807 is that of the noise itself
    return 69621 * seed % int(MODULUS)


def joint_system(
    joint_file: JointFile, controller: Choice, gains: Choice, actuators: Actuators = NONE, **variant: Any
) -> System:
    """Return the system of one joint alone, with the motion and the load of its file."""
    return _combine_joints((joint_file,), controller, gains, actuators, **variant)


def joint_scenario(content: Mapping[str, Any], where: str, folder: Path) -> ScenarioFile:
    """Return the scenario of a joint file's content; see `parse_joint`.

    Args:
        content: The content of the file.
        where: The name of a built-in joint, or the path of a file.
        folder: The folder to which paths in it are relative.
    """
    path = Path(where)
    label = f"the joint file '{where}'" if path.suffix else f"the joint '{where}'"
    joint_file = parse_joint(content, label, path.stem, folder)
    system = path.name if path.suffix else where
    return ScenarioFile(
        joint_file.description, system, joint_file.run, where, folder, partial(joint_system, joint_file)
    )


def _combine_joints(
    joint_files: Sequence[JointFile], controller: Choice, gains: Choice, actuators: Actuators, **variant: Any
) -> System:
    """Return one system of several joints; raise CommandError for options that name other joints."""
    names = [joint_file.name for joint_file in joint_files]
    check_actuator_joints(actuators, names)
    check_notch_joints(variant.get("notch", {}), names)
    first, *further = (
        build_joint_system(
            joint_file,
            controller,
            gains,
            reference=joint_file.reference.parameters(),
            load=joint_file.load.parameters(),
            actuators=actuators,
            **variant,
        ).to_system()
        for joint_file in joint_files
    )
    return sum(further, first)


def _build_system_of_joints(
    joints: Iterable[str], controller: Choice, gains: Choice, actuators: Actuators = NONE, **variant: Any
) -> System:
    """Return the system of built-in joints, by name."""
    joint_files = [load_joint(name) for name in joints]
    return _combine_joints(joint_files, controller, gains, actuators, **variant)


def _build_experiment_system(
    scenario: str, controller: Choice, gains: Choice, actuators: Actuators = NONE, **variant: Any
) -> System:
    """Return a joint with the motion and the load of an experiment."""
    joint_file = load_joint(EXPERIMENTS[scenario])
    task = joint_file.experiment(scenario)
    i_range = (actuators.get(joint_file.name) or joint_file.actuator).emla.i_range
    # they are not in the joint file because they follow from the actuator, which the user can replace;
    # all but the delay of one sample are assumed
    sensors = {
        "sigma": 1e-8,  # three steps of the encoder
        "delay": joint_file.sample_time,
        "sigma_i": 1e-3 * i_range,
        "resolution_i": 2.0 * i_range / 2**12,
    }
    plant = {**joint_file.plant, **sensors}
    joint_file = msgspec.structs.replace(joint_file, reference=task.reference, load=task.load, plant=plant)
    return _combine_joints((joint_file,), controller, gains, actuators, **variant)


_build_study = partial(_build_system_of_joints, STUDY)

SYSTEMS: dict[str, Callable[..., System]] = {
    "study": _build_study,
    "study-drive": partial(_build_study, drive=True),
    "study-compliant": partial(_build_study, drive=True, compliant=True),
    **{
        name: partial(_build_system_of_joints, (name,))
        for name in dict.fromkeys((*STUDY, *list_joint_names()))
    },
    "published": partial(_build_study, as_printed=True),
    "published-true-states": partial(_build_study, as_printed=True, true_feedback=True),
    **{name: partial(_build_experiment_system, name) for name in EXPERIMENTS},
}
"""Systems by name, made for a controller, a set of its gains, and optionally other actuators by joint."""


def change_entries(
    system: str,
    actuators: Mapping[str, Path | Actuator],
    entries: Mapping[str, Value],
    sheets: Mapping[str, Any] = MappingProxyType({}),
) -> dict[str, Actuator]:
    """Read the actuators of joints, and return them with other entries.

    Args:
        system: Name of the system; its own joint may have no other actuator.
        actuators: Actuators, or their files, by joint.
        entries: Values by JOINT.TABLE.ENTRY, as data sheets print them.
        sheets: Actuators of the joints of a machine.

    Raises:
        CommandError: A name is wrong, a joint has no data sheet, or the changed data sheet has errors.
    """
    changed = {
        name: Actuator.read(actuator) if isinstance(actuator, Path) else actuator
        for name, actuator in actuators.items()
    }
    changes: dict[str, dict[str, dict[str, Value]]] = {}
    for entry, value in entries.items():
        joint, _, name = entry.partition(".")
        table, _, key = name.partition(".")
        if table not in TABLES:
            raise CommandError(
                f"the entry '{entry}' of a data sheet does not exist; write JOINT.TABLE.ENTRY, with a table "
                f"of {join_names(TABLES)}.",
                entry=entry,
            )
        changes.setdefault(joint, {}).setdefault(table, {})[key] = value
    for joint, tables in changes.items():
        base = changed.get(joint) or sheets.get(joint) or _get_default_actuator(system, joint)
        changed[joint] = base.changed(tables, f"{base.label} with changes")
    return changed


def _get_default_actuator(system: str, joint: str) -> Actuator:
    """Return the actuator of a built-in joint; raise CommandError if the system has no such joint."""
    if joint not in list_joint_names() or EXPERIMENTS.get(system, joint) != joint:
        raise CommandError(
            f"{joint} has no data sheet whose entries can change; add --actuator {joint}=FILE.toml.",
            joint=joint,
        )
    return load_joint(joint).sheet
