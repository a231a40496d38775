"""Machine files: bodies, actuators, links and loops. Those that come with the study are read by name."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from machine_fmu import (
    GROUND,
    Actuator,
    Body,
    Joint,
    Link,
    Machine,
    MachineError,
    Parameter,
    Payload,
    Point,
    find_closure,
)
from machine_fmu.assembly import locate_outlines
from machine_fmu.description import JointKind
from machine_fmu.naming import name_numbers

from ...base.errors import CommandError, check_choice
from ...base.files import read_text
from ...base.table_entries import unknown_entry
from ...base.toml_structs import describe, dotted, quantity, read_toml
from ...base.values import convert_value
from ..packaged_files import list_packaged_names, read_packaged_text
from .entries import (
    Corners,
    NumberList,
    Numbers,
    Points,
    check_names,
    check_table,
    corner_list,
    joint_values,
    number,
    numbers,
    point_table,
)

_FOLDER = "machines"

KIND = "machine"
"""The value of `kind` in a machine file."""

_EMPTY: Any = msgspec.field(default_factory=dict)


class ParameterTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A number with a name, which can vary between runs; a list has names with [1], [2] and so on."""

    value: Annotated[Numbers, numbers("", "value in the unit", 1.15)]
    unit: Annotated[str, describe("its unit", "m")] = ""
    about: Annotated[str, describe("its meaning")] = ""
    minimum: Annotated[float, quantity("", "lowest value", 0.001)] | None = None
    maximum: Annotated[float, quantity("", "highest value", 1.0)] | None = None
    symbol: Annotated[str, describe("symbol in equations, as LaTeX", "L_0")] | None = None


class GroundTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What does not move."""

    points: Annotated[Points, point_table()] = _EMPTY
    outline: Annotated[Corners, corner_list("base")] = msgspec.field(default=())  # type: ignore[assignment]


class BodyTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A rigid body, whose frame is at its joint."""

    joint: Annotated[JointKind, describe("how it moves relative to its parent", "revolute")]
    on: Annotated[str, describe("parent, or a point of it", "boom.elbow")] = GROUND
    axis: Annotated[NumberList, numbers("", "axis of the joint", [0, 0, 1], (2, 3, 6))] | None = None
    # as URDF has it
    rotation: Annotated[NumberList, numbers("rad", "roll, pitch and yaw at 0", [0, 0, 0], (3,))] = (
        msgspec.field(default=(0.0, 0.0, 0.0))  # type: ignore[assignment]
    )
    assembly: Annotated[Numbers, joint_values("joint coordinates of a pose", "30 deg")] = msgspec.field(
        default=()
    )  # type: ignore[assignment]
    passive: Annotated[bool, describe("whether the joint swings freely")] = False
    damping: Annotated[
        float | str, number("", "damping of a passive joint, N m s/rad or N s/m", 20.0, ge=0.0)
    ] = 0.0
    m: Annotated[float | str, number("kg", "mass", 160.0, ge=0.0)] = 0.0
    c: Annotated[NumberList, numbers("m", "centre of mass", [0.85, 0.0], (2, 3))] = msgspec.field(
        default=()  # type: ignore[assignment]
    )
    J: Annotated[
        Numbers,
        numbers("kg.m2", "inertia about the centre: about z; or xx, yy, zz", 43.2, (1, 3, 6)),
    ] = msgspec.field(default=())  # type: ignore[assignment]
    points: Annotated[Points, point_table()] = _EMPTY
    outline: Annotated[Corners, corner_list("body")] = msgspec.field(default=())  # type: ignore[assignment]


class UrdfLinkTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a URDF file does not have: pins of actuators, and the pose in which the machine is assembled."""

    points: Annotated[Points, point_table()] = _EMPTY
    outline: Annotated[Corners, corner_list("link")] = msgspec.field(default=())  # type: ignore[assignment]
    assembly: Annotated[Numbers, joint_values("joint coordinates of a pose", "30 deg")] = msgspec.field(
        default=()
    )  # type: ignore[assignment]
    passive: Annotated[bool, describe("whether the joint swings freely")] = False


class StrutTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What is between two points."""

    first: Annotated[str, describe("point of the first body", "ground.pin")] = msgspec.field(name="from")
    to: Annotated[str, describe("point of the second body", "boom.pin")]


class LinkTable(StrutTable, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A part of constant length between two points."""

    length: Annotated[float | str, number("m", "length; as in the assembly pose without", 0.6)] | None = None
    m: Annotated[float | str, number("kg", "mass", 30.0, ge=0.0)] = 0.0
    c: Annotated[float | str, number("m", "centre of mass from the first point", 0.3)] = 0.0
    J: Annotated[float | str, number("kg.m2", "inertia across, about the centre", 1.0, ge=0.0)] = 0.0


class ActuatorTable(StrutTable, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """An actuator between two points: housing and motor at the first one, rod at the second one."""

    joint: Annotated[str, describe("name of a built-in joint, or path of a joint file", "lift")] | None = None
    disturbances: (
        Annotated[bool, describe("whether those of the joint act; by default those of a joint file only")]
        | None
    ) = None
    length: Annotated[float | str, number("m", "distance of the points at stroke 0", 0.85)]
    stroke: (
        Annotated[
            Numbers,
            numbers("m", "lowest and highest; without, of the joint", [0.0, 0.5], (1, 2)),
        ]
        | None
    ) = None
    start: (
        Annotated[float, quantity("m", "stroke at the start; that of the assembly pose without")] | None
    ) = None
    start_error: Annotated[float, quantity("m", "distance from the motion at the start", -0.004)] = 0.0
    m: (
        Annotated[float | str, number("kg", "mass without motor; without, of the joint", 156.5, ge=0.0)]
        | None
    ) = None
    motor_m: (
        Annotated[float | str, number("kg", "mass of the motor; without, of the joint", 45.0, ge=0.0)] | None
    ) = None
    rod_share: Annotated[float | str, number("", "fraction of m in the rod", 0.3, ge=0.0, le=1.0)] = 0.3
    housing_c: Annotated[float | str, number("m", "its centre of mass from the first point", 0.3)] = 0.0
    housing_J: Annotated[
        float | str, number("kg.m2", "its inertia across, about its centre", 9.0, ge=0.0)
    ] = 0.0
    rod_c: Annotated[float | str, number("m", "its centre of mass from the second point", 0.3)] = 0.0
    rod_J: Annotated[float | str, number("kg.m2", "its inertia across, about its centre", 3.0, ge=0.0)] = 0.0


class LoopTable(StrutTable, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Two points that are one."""


class PayloadTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the machine carries."""

    at: Annotated[str, describe("point that carries it", "boom.tip")]
    m: Annotated[float, quantity("kg", "mass", 470.0, ge=0.0)]
    J: Annotated[float | str, number("m2", "inertia about the point per mass", 0.06, ge=0.0)] = 0.0
    force: Annotated[bool, describe("whether a process acts on it with the force payload.F")] = False


class MotionTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The motion of the actuators: a file, or strokes at times, at which all of them rest."""

    file: Annotated[Path, describe("file by emla trajectory", "crane.json")] | None = None
    times: Annotated[tuple[float, ...], quantity("s", "times of the strokes", [0.0, 4.0, 8.0])] = ()
    strokes: Annotated[
        dict[str, Annotated[tuple[float, ...], quantity("m", "strokes at the times", [0.1, 0.3, 0.1])]],
        describe("strokes by actuator; the others hold their start"),
    ] = _EMPTY


class MachineTable(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """All data of a machine's mechanics."""

    kind: Literal["machine"]
    description: Annotated[str, describe("line that `emla list` shows")]
    dimensions: Annotated[int, describe("2 in the plane with y up, or 3 with z up", 2, ge=2, le=3)]
    gravity: Annotated[float | str, number("m/s2", "gravitational acceleration", 9.81, ge=0.0)] = 9.81
    parameters: Annotated[
        dict[str, ParameterTable], dotted("numbers with names", lambda table: "value" in table)
    ] = _EMPTY
    ground: GroundTable = GroundTable()
    bodies: Annotated[dict[str, BodyTable], describe("bodies; each parent precedes its children")] = _EMPTY
    urdf: Annotated[Path, describe("file in URDF with the bodies", "crane.urdf")] | None = None
    links_of_urdf: Annotated[dict[str, UrdfLinkTable], describe("more about its links")] = msgspec.field(
        default_factory=dict, name="urdf_links"
    )
    actuators: Annotated[dict[str, ActuatorTable], describe("actuators")] = _EMPTY
    links: Annotated[dict[str, LinkTable], describe("parts of constant length")] = _EMPTY
    loops: Annotated[dict[str, LoopTable], describe("pairs of points that are one")] = _EMPTY
    payload: PayloadTable | None = None
    motion: Annotated[MotionTable, describe("motion; the start is held without")] | None = None
    run: Any = None  # `machine_struct` has its type


MACHINE_KEYS = frozenset({"bodies", "dimensions", "ground", "actuators", "links", "loops", "urdf"})
"""Entries that a scenario file does not support."""


def list_machine_names() -> list[str]:
    """Return the names of all machines that come with the study, sorted."""
    return list_packaged_names(_FOLDER)


def read_machine_text(name: str) -> str:
    """Return the text of a machine file; raise CommandError for an unknown name."""
    check_choice("machine", name, list_machine_names())
    return read_packaged_text(_FOLDER, name)


@cache
def load_machine(name: str) -> Machine:
    """Return a machine by name; raise CommandError for an unknown name or an error in the file."""
    content, label, _, folder = read_machine_content(name)
    return parse_machine(content, label, folder)


def read_machine_content(machine: str | Path) -> tuple[dict[str, Any], str, str, Path]:
    """Read a machine file, or one that comes with the study.

    Args:
        machine: Path of a file that ends in .toml, or the name of a built-in machine.

    Returns:
        The content, the label in error messages, the name of the machine, and the folder of relative paths.

    Raises:
        CommandError: The file or the machine does not exist, or is not TOML.
    """
    label, path = f"the machine '{machine}'", Path(machine)
    if path.suffix.lower() == ".toml":
        return read_toml(read_text(path, "the machine"), label), label, path.stem, path.parent
    return read_toml(read_machine_text(str(machine)), label), label, str(machine), machines_folder()


def machines_folder() -> Path:
    """Return the folder of the machines that come with the study."""
    return Path(str(files("emla_cosim.study") / _FOLDER))


def parse_machine(content: Mapping[str, Any], label: str, folder: Path | None = None) -> Machine:
    """Return the machine of a file's content.

    Args:
        content: The content.
        label: What error messages call the file.
        folder: The folder of relative paths in it.

    Raises:
        CommandError: An entry is unknown, missing or wrong, or the machine cannot be assembled.
    """
    return build_machine(convert_value(content, MachineTable, label, folder), label, folder)


def build_machine(table: MachineTable, label: str, folder: Path | None = None) -> Machine:
    """Return the machine of a table; see `parse_machine`."""
    if bool(table.bodies) == (table.urdf is not None):
        has = "both bodies and urdf" if table.bodies else "neither bodies nor urdf"
        raise CommandError(f"{label} has {has}; write one of them.")
    check_table(table, label)
    bodies, ground = {name: _build_body(body) for name, body in table.bodies.items()}, table.ground.points
    if table.urdf is not None:
        bodies, ground = _read_urdf_bodies(table, table.urdf, label)
        check_names("urdf", bodies, label)
    try:
        machine = _convert_tables(table, bodies, ground, label, folder)
        # raises MachineError for what only all entries together show
        find_closure(machine)
        locate_outlines(machine)
        name_numbers(machine)
    except MachineError as error:
        raise CommandError(f"{label} cannot be used: {error}.") from error
    return machine


def _read_urdf_bodies(
    table: MachineTable, file: Path, label: str
) -> tuple[dict[str, Body], dict[str, Point]]:
    """Return bodies and points of the ground: those of a URDF file with what the machine file adds."""
    from .urdf import read_urdf  # loads NumPy

    bodies, ground = read_urdf(file)
    for name, addition in table.links_of_urdf.items():
        if name not in bodies:
            raise unknown_entry(f"[urdf_links] of {label}", name, list(bodies))
        body = bodies[name]
        joint = replace(body.joint, assembly=tuple(addition.assembly), is_passive=addition.passive)
        points = {**body.points, **addition.points}
        bodies[name] = replace(body, joint=joint, points=points, outline=tuple(addition.outline))
    return bodies, {**ground, **table.ground.points}


def _convert_tables(
    table: MachineTable,
    bodies: Mapping[str, Body],
    ground: Mapping[str, Point],
    label: str,
    folder: Path | None,
) -> Machine:
    """Return the machine of a table with these bodies; what only all entries together show is not checked."""
    payload = table.payload
    return Machine(
        dimensions=3 if table.dimensions == 3 else 2,
        bodies=bodies,
        ground=ground,
        actuators={name: _build_actuator(name, x, label, folder) for name, x in table.actuators.items()},
        links={n: Link((x.first, x.to), x.m, x.c, x.J, x.length) for n, x in table.links.items()},
        loops={name: (entry.first, entry.to) for name, entry in table.loops.items()},
        payload=None if payload is None else Payload(payload.at, payload.m, payload.J, payload.force),
        parameters=dict(_list_parameters(table.parameters)),
        gravity=table.gravity,
        outline=tuple(table.ground.outline),
    )


def _list_parameters(tables: Mapping[str, ParameterTable]) -> Iterator[tuple[str, Parameter]]:
    """Yield parameters with their names; those of a list end with [1], [2] and so on."""
    for name, table in tables.items():
        is_list = len(table.value) > 1
        for i, value in enumerate(table.value, 1):
            parameter = Parameter(
                float(value), table.unit, table.about, table.minimum, table.maximum, table.symbol
            )
            yield f"{name}[{i}]" if is_list else name, parameter


def _build_body(table: BodyTable) -> Body:
    """Return the body of a table, with the default axis of its kind of joint."""
    parent, _, at = table.on.partition(".")
    if table.axis is not None:
        axis = tuple(float(x) for x in table.axis)
        axis = (*axis, 0.0) if len(axis) == 2 else axis
    elif table.joint == "universal":
        axis = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    else:
        axis = (0.0, 0.0, 1.0)
    roll, pitch, yaw = table.rotation
    joint = Joint(
        table.joint, parent, at, axis, (roll, pitch, yaw), tuple(table.assembly), table.passive, table.damping
    )
    return Body(joint, table.m, tuple(table.c), tuple(table.J), table.points, tuple(table.outline))


def _build_actuator(name: str, table: ActuatorTable, label: str, folder: Path | None) -> Actuator:
    """Return an actuator; what its table leaves out is that of its joint.

    Raises:
        CommandError: The joint is wrong, or the stroke is missing or does not fit.
    """
    m, motor_m, stroke = table.m, table.motor_m, table.stroke
    if m is None or motor_m is None or stroke is None:
        from .machine_joints import find_joint  # loads the tables of controllers

        joint = find_joint(name, table.joint, label, folder)
        values = {} if joint is None else joint.actuator.values
        m = (0.0 if joint is None else joint.emla.M_BS) if m is None else m
        motor_m = values.get("motor.m", 0.0) if motor_m is None else motor_m
        if stroke is None and joint is not None:
            stroke = [joint.emla.q_LB, joint.emla.q_UB]
        if stroke is None:
            raise CommandError(
                f"[actuators.{name}] of {label} has neither stroke nor joint; write stroke, or a joint whose "
                "data sheet has it."
            )
    low, high = (0.0, *stroke)[-2:]
    if not isinstance(low, str) and not isinstance(high, str):
        where = f"[actuators.{name}] of {label}"
        if low >= high:
            raise CommandError(f"'stroke' in {where} is {low:g} to {high:g} m; write the lowest first.")
        if table.start is not None and not low <= table.start <= high:
            raise CommandError(
                f"'start' in {where} is {table.start:g} m, outside its stroke of {low:g} to {high:g} m."
            )
    return Actuator(
        ends=(table.first, table.to),
        m=m,
        c=table.housing_c,
        J=table.housing_J,
        L_0=table.length,
        motor_m=motor_m,
        rod_share=table.rod_share,
        rod_c=table.rod_c,
        rod_J=table.rod_J,
        stroke=(low, high),
        start=table.start,
    )
