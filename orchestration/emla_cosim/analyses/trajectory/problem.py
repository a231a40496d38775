"""Read the problem of a user: a file, a table, or single values."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal, get_type_hints

import msgspec
import numpy as np

from machine_fmu import Machine, MachineError
from machine_fmu.model import MachineModel
from machine_fmu.naming import group_parameters, name_numbers
from machine_fmu.optimisation.obstacles import Obstacle
from machine_fmu.optimisation.problem import CAN_BE_OFF, STROKES, MotionProblem, Via
from machine_fmu.spline import TrajectoryError

from ...base.errors import CommandError, join_names, suggest_names
from ...base.files import read_text
from ...base.table_entries import Location
from ...base.toml_structs import describe, extend_struct, list_given, read_toml
from ...base.values import convert_value
from ...study.joints.schema import JointFile
from ...study.machines.machine_joints import find_joint
from ...study.machines.motion import FORMER_NAMES
from ...study.machines.schema import (
    KIND,
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


_MACHINE = "machine"
_OFF = "off"
"""Value of what does not limit the motion."""

_ITEM = re.compile(r"(?P<list>via|obstacles)\[(?P<number>[1-9][0-9]?)\]\.(?P<field>\w+)", re.ASCII)
_ELEMENT = re.compile(r"(?P<name>[\w.]+)(\[(?P<element>[1-9][0-9]?)\])?", re.ASCII)
_SYMMETRIC = {"v_LB": "v_UB", "f_LB": "f_UB"}
"""Lower bounds that are the negative upper ones by default."""

_TABLE_II = {
    "q_S": (0.244, 0.389, 0.499),
    "q_E": (0.270, 0.442, 0.348),
    "v_S": (0.0016, 0.0, -0.0024),
    "v_E": (0.0607, -0.0808, -0.5477),
    "v_LB": (-0.136, -0.100, -0.210),
    "v_UB": (0.136, 0.100, 0.210),
    "f_LB": (-89.8e3, -68.6e3, -6.1e3),
    "f_UB": (89.8e3, 68.6e3, 6.1e3),
    "t_M": 37.7,
    "ground_clearance": 0.2,  # assumed
    "body_clearance": 0.2,  # assumed
}
"""The problem of the paper."""


def paper_problem(**changes: Any) -> MotionProblem:
    """Return the problem of the paper, Table II, with other values of some fields."""
    return load_problem({_MACHINE: PAPER, **changes})


def load_problem(
    source: MotionProblem | Mapping[str, Any] | str | Path | None, texts: Mapping[str, str] | None = None
) -> MotionProblem:
    """Return the problem of an object, a table or a file.

    Args:
        source: The problem; a machine by name or by its file is the problem with that machine. None is the
            problem of the paper.
        texts: Other values by name (q_E, q_E[3], machine.lift.a, via[1].tip): a number, or several with
            commas.

    Raises:
        CommandError: A name does not exist, or a value is missing or invalid.
    """
    if isinstance(source, MotionProblem):
        return source
    label, folder, table = _read_table(source)
    values = list_given(convert_value(table, PROBLEM, label, folder))
    machine = values.get(_MACHINE) or read_machine(PAPER, Location(label, label), folder)
    if not texts:
        return _build_problem(_list_defaults(machine) | values, machine, label)
    label = "the problem"
    machine_texts = {name: text for name, text in texts.items() if name.partition(".")[0] == _MACHINE}
    if machine_texts:
        changes = {
            name.partition(".")[2] or FILE: _parse_override(name, text)
            for name, text in machine_texts.items()
        }
        numbers = machine.record if FILE not in changes else {}
        machine = read_machine(numbers | changes, Location(label, label).entry(_MACHINE), folder)
    entries = _list_defaults(machine) | {name: x for name, x in table.items() if name != _MACHINE}
    for name, text in texts.items():
        if name not in machine_texts:
            _override_entry(entries, name, text)
    return _build_problem(list_given(convert_value(entries, PROBLEM, label, folder)), machine, label)


def describe_problem(problem: MotionProblem) -> dict[str, Any]:
    """Return the table of a problem, with all numbers of its machine."""
    values = {part.name: getattr(problem, part.name) for part in fields(problem)}
    del values["machine_name"]
    items = {name: [asdict(x) for x in values[name]] for name in ("via", "obstacles")}
    return values | items | {_MACHINE: ProblemMachine(problem.machine_name, problem.machine).record}


def _read_table(source: Mapping[str, Any] | str | Path | None) -> tuple[str, Path | None, Mapping[str, Any]]:
    """Return label, folder of relative paths, and content of a problem."""
    if source is None or isinstance(source, Mapping):
        return "the problem", None, source or {}
    if names_machine(source):
        return "the problem", None, {_MACHINE: str(source)}
    path = Path(source)
    label = f"the problem '{path}'"
    table = read_toml(read_text(path, "the problem"), label)
    if table.get("kind") == KIND:
        return "the problem", None, {_MACHINE: str(path)}
    return label, path.parent, table


def _list_defaults(machine: ProblemMachine) -> dict[str, Any]:
    """Return the values that a problem with a machine need not have."""
    if machine.name == PAPER:
        return {**_TABLE_II, "payload": machine.model.payload}
    rest = (0.0,) * len(machine.model.names)
    values = {"q_S": machine.model.start, "v_S": rest, "v_E": rest, "payload": machine.model.payload}
    return values | {
        name: limits
        for name, limits in (("v_UB", machine.speeds), ("f_UB", machine.forces))
        if limits is not None
    }


def _override_entry(entries: dict[str, Any], name: str, text: str) -> None:
    """Change a value, an element of one, or an entry of a way-point or an obstacle."""
    if item := _ITEM.fullmatch(name):
        key = item["list"]
        entries[key] = _change_item(
            entries.get(key, ()), item["number"], item["field"], _parse_override(name, text), key
        )
        return
    match = _ELEMENT.fullmatch(name)
    names = [field for field in PROBLEM.__struct_fields__ if field not in (_MACHINE, "via", "obstacles")]
    if match is None or match["name"] not in names:
        if match is not None:
            raise CommandError(f"a problem has no '{name}'; {suggest_names(match['name'], names)}")
        raise CommandError(f"a problem has no '{name}'; write q_E, q_E[3], machine.lift.a or via[1].tip.")
    field, value = match["name"], _parse_override(name, text)
    if match["element"] is None:
        entries[field] = value
        return
    before = entries.get(field)
    if before is None:
        raise CommandError(f"'{name}' = {text}; {field} has no values yet: write all of them, {field}=1,1,1.")
    if not isinstance(before, (list, tuple)) or isinstance(value, list):
        raise CommandError(f"'{name}' = {text}; an element must be one of several numbers.")
    i = int(match["element"]) - 1
    if i >= len(before):
        raise CommandError(f"'{name}' = {text}; the index is too large: {field} has {len(before)} numbers.")
    entries[field] = [*before[:i], value, *before[i + 1 :]]


def _change_item(before: Sequence[Any], number: str, field: str, value: Any, name: str) -> list[Any]:
    """Return tables with another value in one of them, counted from 1, or with a further one."""
    i = int(number) - 1
    if i > len(before):
        following = f"{name}[{len(before) + 1}]"
        kind = "way-point" if name == "via" else "obstacle"
        raise CommandError(f"{name}[{number}] has no predecessor; the next {kind} is {following}.")
    old = before[i] if i < len(before) else {}
    table = old if isinstance(old, Mapping) else asdict(old)
    return [*before[:i], {**table, field: value}, *before[i + 1 :]]


def _parse_override(name: str, text: str) -> Any:
    """Return a number or list of numbers; "off", names and files as text."""
    if text == _OFF or name in (_MACHINE, f"{_MACHINE}.{FILE}") or name.endswith("].name"):
        return text
    try:
        values = [float(x) for x in text.split(",")]
    except ValueError as error:
        raise CommandError(
            f"'{name}' = {text}; it must be a number in SI units, or several with commas."
        ) from error
    return values[0] if len(values) == 1 else values


def _read_plain(value: Any, _at: Location, _folder: Path | None) -> Any:
    """Return lists as tuples, and NumPy numbers as Python numbers; `MotionProblem` checks them."""
    plain = value.tolist() if hasattr(value, "tolist") else value
    return tuple(plain) if isinstance(plain, list) else plain


def _type_in_file(name: str, hint: Any) -> Any:
    """Return the type of a field of `MotionProblem` in a file."""
    if name == "via":
        return Annotated[Sequence[Via], describe("positions that the tip passes, in order")]
    if name == "obstacles":
        return Annotated[Sequence[Obstacle], describe("what the machine keeps clear of")]
    if name == _MACHINE:
        about = "name or file of a machine, or a table with `file` and numbers by name"
        return Annotated[str | dict[str, Any], describe(about, "crane.toml", read=read_machine)]
    if name in STROKES:
        hint = hint | float  # of a single actuator
    return Annotated[hint | Literal["off"] if name in CAN_BE_OFF else hint, describe(read=_read_plain)]


PROBLEM = extend_struct(
    msgspec.Struct,
    "Problem",
    [
        (name, _type_in_file(name, hint), msgspec.UNSET)
        for name, hint in get_type_hints(MotionProblem).items()
        if name != "machine_name"
    ],
    "Conditions on the motion of a machine, by actuator.",
)
"""The struct of a file with a problem; entries that a file of the paper's machine lacks are the paper's."""


def _build_problem(values: Mapping[str, Any], machine: ProblemMachine, label: str) -> MotionProblem:
    """Return a problem with these values, and others that follow from them."""
    joints = machine.model.names
    entries = {name: value for name, value in values.items() if name != _MACHINE}
    entries |= {name: None for name in CAN_BE_OFF if entries.get(name) == _OFF}
    entries |= {name: tuple(entries[name]) for name in ("via", "obstacles") if name in entries}
    if len(joints) == 1:
        scalars = {name: entries[name] for name in STROKES if isinstance(entries.get(name), (int, float))}
        entries |= {name: (value,) for name, value in scalars.items()}
    for low, high in _SYMMETRIC.items():
        if low not in entries and isinstance(entries.get(high), tuple):
            entries[low] = tuple(-x for x in entries[high])
    if entries.get("tip_E") is not None:  # the optimisation then chooses the strokes at the end
        entries.setdefault("q_E", entries["q_S"])
    missing = [name for name in ("v_UB", "f_UB", "t_M") if name not in entries]
    missing += [] if "q_E" in entries else ["q_E or tip_E"]
    if missing:
        raise CommandError(
            f"{label} of the machine '{machine.name}' lacks {join_names(missing)}; lists have a number for "
            f"each of {', '.join(joints)}."
        )
    try:
        return MotionProblem(machine=machine.model, machine_name=machine.name, **entries)
    except TrajectoryError as error:
        raise CommandError(f"{label}: {error}") from error
