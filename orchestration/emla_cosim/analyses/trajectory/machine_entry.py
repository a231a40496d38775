"""The machine of a problem: its file, and numbers that replace those of the file."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from machine_fmu import Machine, MachineError
from machine_fmu.model import MachineModel
from machine_fmu.naming import group_parameters, name_numbers

from ...base.errors import CommandError, suggest_names
from ...base.files import read_text
from ...base.table_entries import Location
from ...base.toml_structs import read_toml
from ...base.values import convert_value
from ...study.joints.schema import JointFile
from ...study.machines.machine_joints import find_joint
from ...study.machines.motion import FORMER_NAMES
from ...study.machines.schema import (
    MachineTable,
    build_machine,
    machines_folder,
    read_machine_text,
)
from ..variants.kinds import is_number

PAPER = "hdrm"
"""The machine of the paper, which is the default."""

FILE = "file"
"""The entry of [machine] with the name or the file of the machine."""


@dataclass(frozen=True)
class ProblemMachine:
    """The machine of a problem.

    Attributes:
        name: Its name or file.
        model: The machine.
        speeds: Largest speeds of the actuators by their data sheets, m/s; None if one has none.
        forces: Forces that they hold continuously, N.
    """

    name: str
    model: MachineModel
    speeds: tuple[float, ...] | None = None
    forces: tuple[float, ...] | None = None

    @property
    def record(self) -> dict[str, Any]:
        """The entry of a problem with this machine: the file, and all numbers by name."""
        groups = group_parameters(self.model.machine.parameters)
        values = {
            group.name: [x.value for x in group.parameters] if group.is_vector else group.parameters[0].value
            for group in groups
        }
        return {FILE: self.name, **values}


def read_machine(value: Any, at: Location, folder: Path | None) -> ProblemMachine:
    """Return the machine of an entry: a name, a file, or a table with `file` and numbers by name.

    Raises:
        CommandError: There is no such machine or number, or the machine cannot be used.
    """
    if isinstance(value, ProblemMachine):
        return value
    if isinstance(value, str | Path):
        value = {FILE: str(value)}
    if not isinstance(value, Mapping):
        raise CommandError(
            f"{at.label} is {value!r}; it must be the name or file of a machine, or a table of lengths and "
            "masses by name."
        )
    entries = _flatten(value)
    name = entries.pop(FILE, PAPER)
    table, label, folder = _load_table(str(name), folder)
    machine = name_numbers(build_machine(table, label, folder))
    numbers = dict[str, float]()
    for key, number in entries.items():
        numbers |= _read_numbers(machine, key, number, at)
    try:
        model = MachineModel(machine, numbers)
    except MachineError as error:
        raise CommandError(f"{at.table}: {error}.") from error
    _check_triangles(model, at)
    joints = [find_joint(actuator, x.joint, label, folder) for actuator, x in table.actuators.items()]
    emlas = [joint for joint in joints if joint is not None]
    if len(emlas) < len(joints):
        return ProblemMachine(str(name), model)
    speeds, forces = zip(*((joint.emla.v_max, _find_continuous_force(joint)) for joint in emlas), strict=True)
    return ProblemMachine(str(name), model, speeds, forces)


def names_machine(name: str | Path) -> bool:
    """Return whether this is the name of a machine that comes with the study, not the path of a file."""
    path = Path(name)
    return not path.suffix and path.parent == Path() and not path.exists()


def _check_triangles(machine: MachineModel, at: Location) -> None:
    """Raise CommandError if a triangle cannot close at an end of a stroke, with the others at the start."""
    if machine.closure.iterated:
        return  # its closed loops have no formula whose root could be missing
    for ends, bounds in (("lower", machine.q_LB), ("upper", machine.q_UB)):
        rows = np.tile(machine.start, (len(bounds), 1))
        np.fill_diagonal(rows, bounds)
        positions = np.hstack([*machine.points(rows).values()])
        for joint, row in zip(machine.names, positions, strict=True):
            if not np.isfinite(row).all():
                raise CommandError(
                    f"{at.table}: the machine cannot close at the {ends} end of '{joint}', the others "
                    f"at the start; write a shorter stroke into [actuators.{joint}] of its file."
                )


def _load_table(name: str, folder: Path | None) -> tuple[MachineTable, str, Path]:
    """Return the table of a machine file, what messages call it, and the folder of its relative paths."""
    if name.lower().endswith(".toml"):
        path = (folder or Path()) / name
        label, folder, text = f"the machine '{path}'", path.parent, read_text(path, "the machine")
    else:
        label, folder, text = f"the machine '{name}'", machines_folder(), read_machine_text(name)
    return convert_value(read_toml(text, label), MachineTable, label, folder), label, folder


def _find_continuous_force(joint: JointFile) -> float:
    """Return the force in N that an actuator holds: continuously, if its data sheet has such a current."""
    emla, sheet = joint.emla, joint.actuator
    torque = 1.5 * emla.N_p * emla.Phi_PM * sheet.i_N if sheet.i_N else emla.tau_max
    return min(torque / abs(emla.D_eq), sheet.values.get("screw.F_max", np.inf))


def _read_numbers(machine: Machine, key: str, value: Any, at: Location) -> dict[str, float]:
    """Return the numbers of an entry by name; the elements of a list have names with [1] and so on."""
    name, bracket, rest = key.partition("[")
    full_name = f"{FORMER_NAMES.get(name, name)}{bracket}{rest}"
    elements = [n for n in machine.parameters if n.partition("[")[0] == full_name]
    names = [full_name] if full_name in machine.parameters else elements
    if not names:
        existing = [f"machine.{n}" for n in machine.parameters]
        raise CommandError(f"a problem has no 'machine.{key}'; {suggest_names(f'machine.{key}', existing)}")
    values = value.tolist() if hasattr(value, "tolist") else value
    numbers: Sequence[Any] = values if isinstance(values, (list, tuple)) else [values]
    if len(numbers) != len(names) or not all(is_number(x) for x in numbers):
        expected = f"a list of {len(names)} numbers" if len(names) > 1 else "a number"
        raise CommandError(f"{at.entry(key).label} is {value!r}; it must be {expected}.")
    for n, x in zip(names, numbers, strict=True):
        low, high = machine.parameters[n].minimum, machine.parameters[n].maximum
        if (low is not None and x < low) or (high is not None and x > high):
            bounds = " to ".join(
                f"{b:.9g}" if b is not None else end for b, end in ((low, "-inf"), (high, "inf"))
            )
            raise CommandError(f"{at.table}: {n} = {x:.9g} is outside its range, {bounds}.")
    return dict(zip(names, map(float, numbers), strict=True))


def _flatten(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return entries by their full name, which TOML nests at each dot."""
    entries = dict[str, Any]()
    for key, value in table.items():
        if isinstance(value, Mapping):
            entries |= {f"{key}.{inner}": x for inner, x in _flatten(value).items()}
        else:
            entries[key] = value
    return entries
