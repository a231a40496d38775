"""Machine files with their joints, motion and options: all that a machine needs to run."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import msgspec

from fmublock.noise import MODULUS
from machine_fmu import Machine, start_strokes

from ...base.errors import CommandError
from ...base.option import RUN
from ...base.toml_structs import describe, extend_struct, list_given
from ...base.values import convert_value
from ...run.scenarios.scenario_file import with_options
from ..joints.schema import JointFile
from .machine_joints import is_toml_path, require_joint
from .motion import Motion, read_motion_table
from .schema import KIND, MachineTable, build_machine, read_machine_content

COMPONENTS = "machine"
"""Start of the names of the components of a machine itself."""

_ROUNDING = 1e-9
"""Distance in m and fraction of a speed by which a motion may leave its limits."""


class MachineRunTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The options of the machine's scenario."""


@dataclass(frozen=True)
class MachineFile:
    """All data of a machine.

    Attributes:
        name: Its name, which is that of its file.
        label: What error messages call the file.
        description: Its purpose, in one line.
        machine: Its mechanics.
        joints: The joint of each actuator, in order, with masses and stroke as in the machine.
        start_errors: Distance in m of each actuator from the motion at the start.
        motion: The motion of the actuators; None to hold the start.
        run: Options of its scenario.
    """

    name: str
    label: str
    description: str
    machine: Machine
    joints: Mapping[str, JointFile]
    start_errors: Mapping[str, float] = field(default_factory=dict)
    motion: Motion | None = None
    run: Mapping[str, Any] = field(default_factory=dict)

    @property
    def start(self) -> dict[str, float]:
        """The stroke of each actuator at the start in m."""
        return dict(zip(self.joints, start_strokes(self.machine), strict=True))


def machine_struct() -> type[MachineTable]:
    """Return the struct of machine files, with the options of a run that are registered."""
    options = with_options(MachineRunTable, "MachineRun", RUN)
    run = Annotated[options, describe("options of its scenario")]
    return extend_struct(MachineTable, "MachineFile", [("run", run, msgspec.field(default_factory=options))])


def load_machine_file(name: str | Path) -> MachineFile:
    """Return the file of a machine that comes with the study, by name, or of another one, by path.

    Raises:
        CommandError: There is no such machine, or an entry of its file is unknown, missing or wrong.
    """
    return (
        parse_machine_file(*read_machine_content(name))
        if is_toml_path(str(name))
        else _load_built_in(str(name))
    )


@cache
def _load_built_in(name: str) -> MachineFile:
    return parse_machine_file(*read_machine_content(name))


def parse_machine_file(content: Mapping[str, Any], label: str, name: str, folder: Path) -> MachineFile:
    """Return the machine file of a content; paths in it are relative to `folder`.

    Raises:
        CommandError: An entry is unknown, missing or wrong.
    """
    if content.get("kind") != KIND:
        raise CommandError(f'{label} is not a machine file; it lacks kind = "{KIND}".', key="kind")
    table = convert_value(content, machine_struct(), label, folder)
    if COMPONENTS in table.actuators:
        raise CommandError(f"an actuator cannot be called '{COMPONENTS}', as in {label}; rename it.")
    machine = build_machine(table, label, folder)
    joints, seeds = dict[str, JointFile](), set[int | None]()
    for actuator, entry in table.actuators.items():
        joint_file = _adapt_joint(require_joint(actuator, entry.joint, label, folder), machine, label)
        # those of the paper belong to its manipulator
        if not (entry.disturbances if entry.disturbances is not None else is_toml_path(entry.joint)):
            joint_file = msgspec.structs.replace(joint_file, disturbance={})
        joints[actuator] = joint_file = _make_seed_unique(joint_file, seeds)
        seeds.add(joint_file.seed)
    file = MachineFile(
        name,
        label,
        table.description,
        machine,
        joints,
        {actuator: entry.start_error for actuator, entry in table.actuators.items()},
        run=list_given(table.run),
    )
    motion = read_motion_table(table.motion, file.start, label, folder)
    if motion is None:
        _check_start(file)
    else:
        _check_motion(file, motion)
    return replace(file, motion=motion)


def _adapt_joint(joint_file: JointFile, machine: Machine, label: str) -> JointFile:
    """Return a joint whose actuator has the mass and the stroke of the machine."""
    actuator = machine.actuators[joint_file.name]
    m, (low, high) = machine.value(actuator.m), (machine.value(x) for x in actuator.stroke)
    emla = joint_file.emla
    changes = dict[str, str]()
    if m and m != emla.M_BS:
        changes["M_BS"] = f"{m!r} kg"
    if (low, high) != (emla.q_LB, emla.q_UB):
        changes |= {"stroke": f"{high - low!r} m", "q_LB": f"{low!r} m"}
    if not changes:
        return joint_file
    title = f"the actuator of '{joint_file.name}' of {label}"
    # both sheets, as the scenario decides which of them is used
    sheets = {
        name: getattr(joint_file, name).changed({"screw": changes}, title)
        for name in ("actuator", "realistic")
    }
    return msgspec.structs.replace(joint_file, **sheets)


def _make_seed_unique(joint_file: JointFile, seeds: Collection[int | None]) -> JointFile:
    """Return a joint whose random sequences are not those of these seeds: joints can share a file."""
    seed = joint_file.seed
    while seed is not None and seed in seeds:
        # the next number of the generator: joints can share a file, and so a seed
        seed = 16807 * seed % int(MODULUS)
    return joint_file if seed == joint_file.seed else msgspec.structs.replace(joint_file, seed=seed)


def _check_start(file: MachineFile) -> None:
    """Raise CommandError if the assembly pose, in which a machine without motion starts, leaves a stroke."""
    for name, x in file.start.items():
        low, high = (file.machine.value(end) for end in file.machine.actuators[name].stroke)
        if not low - _ROUNDING <= x <= high + _ROUNDING:
            raise CommandError(
                f"{file.label} starts with '{name}' at {x:.6g} m, as assembled, but its stroke is "
                f"{low:.6g} to {high:.6g} m; write 'start' in [actuators.{name}]."
            )


def _check_motion(file: MachineFile, motion: Motion) -> None:
    """Raise CommandError if a motion leaves a stroke, or is faster than an actuator."""
    for name, joint_file in file.joints.items():
        emla = joint_file.emla
        low, high, peak = motion.travel(name, motion.spline.start, motion.spline.end)
        where = f"[motion] of {file.label} moves '{name}'"
        if low < emla.q_LB - _ROUNDING or high > emla.q_UB + _ROUNDING:
            raise CommandError(
                f"{where} from {low:.6g} to {high:.6g} m, but its stroke is {emla.q_LB:.6g} to "
                f"{emla.q_UB:.6g} m."
            )
        if peak > emla.v_max * (1.0 + _ROUNDING):
            raise CommandError(
                f"{where} with {peak:.4g} m/s, but its actuator makes {emla.v_max:.4g} m/s at the most; "
                f"make its times {peak / emla.v_max:.3g} times as long."
            )
