"""Information on a machine: bodies, actuators with their forces; the machine of a run."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from machine_fmu import MachineError, read_definition
from machine_fmu.description import Machine
from machine_fmu.exact import plain
from machine_fmu.model import MachineModel
from machine_fmu.naming import name_numbers

from ...base.errors import CommandError
from ...pages.text import to_plain
from ...system.model import System
from ..roles import find_machine_roles
from .force_map import ForceLimits, find_extremes, find_levers, read_limits

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..sketch.workspace import Workspace
from ...run.result import Result
from .schema import load_machine

COMPONENTS = ("machine.manipulator", "machine.plant")
"""Components that may be the machine."""

_DEFAULT_MACHINE = "hdrm"
"""The machine of records that have no definition."""


def find_component(result: Result) -> str | None:
    """Return the component of a run that is its machine; None without."""
    return next((name for name in COMPONENTS if name in result.record["components"]), None)


def find_machine(result: Result) -> MachineModel | None:
    """Return the machine of a run, with the values of its parameters; None if it has none.

    It has none if its component is not one of our blocks, or if its parameters make no machine.
    """
    component = find_component(result)
    if component is None:
        return None
    stored = result.record.get("machine")
    try:
        machine = (
            load_machine(_DEFAULT_MACHINE)
            if stored is None
            else read_definition(json.dumps(stored["definition"]))
        )
        names = name_numbers(machine).parameters
        values = {name: result.parameters[f"{component}.{name}"] for name in names}
        return MachineModel(machine, values)
    # a replaced FMU has other parameters
    except (MachineError, KeyError):
        return None


_ROUNDING = 1e-6
"""Force in N that is a rounding error."""

SLIDE, TRIANGLE, NEWTON = "slide", "triangle", "Newton's method"
"""How a length determines coordinates."""


@dataclass(frozen=True)
class BodyInfo:
    """Body of a machine.

    Attributes:
        name: its name.
        joint: kind of its joint, such as revolute.
        on: its parent, or a point of it.
        m: mass in kg.
        passive: whether it swings freely.
    """

    name: str
    joint: str
    on: str
    m: float
    passive: bool


@dataclass(frozen=True)
class ActuatorInfo:
    """Actuator of a machine. Forces hold the machine at rest with its payload, positive against extension.

    Attributes:
        name: its name.
        ends: points that it connects, each BODY.POINT.
        length: distance of these points at stroke 0, m.
        stroke: lowest and highest stroke, m.
        start: stroke at the start, m.
        start_force: force at the start, N.
        lowest_force: lowest force over all strokes, N.
        highest_force: highest force over all strokes, N.
        worst_strokes: strokes of all actuators in m at which the force is largest.
        lever: how far the tip moves per stroke at the start, m/m.
        continuous_force: force that the motor holds continuously, N; None if unknown.
        largest_force: force at the largest motor torque, N; None if unknown.
    """

    name: str
    ends: tuple[str, str]
    length: float
    stroke: tuple[float, float]
    start: float
    start_force: float
    lowest_force: float
    highest_force: float
    worst_strokes: tuple[float, ...]
    lever: float
    continuous_force: float | None = None
    largest_force: float | None = None


@dataclass(frozen=True)
class ClosureInfo:
    """How some coordinates of a pose are found.

    Attributes:
        coordinates: coordinates of joints.
        lengths: actuators, links and loops that determine them.
        method: `slide`, `triangle`, or `Newton's method`.
    """

    coordinates: tuple[str, ...]
    lengths: tuple[str, ...]
    method: str


@dataclass(frozen=True)
class MachineInfo:
    """Content of a machine.

    Attributes:
        dimensions: 2 in the plane, 3 in space.
        bodies: all bodies.
        actuators: all actuators.
        closures: how poses are found, in this order.
        passive: coordinates that swing freely.
        degrees_of_freedom: number of actuators and passive coordinates.
        payload: mass of the payload in kg; None without one.
        payload_at: point that carries it.
        unreachable: share of the poses within all strokes that do not close.
        parameters: values of all numbers that can be set, by name.
    """

    dimensions: int
    bodies: tuple[BodyInfo, ...]
    actuators: tuple[ActuatorInfo, ...]
    closures: tuple[ClosureInfo, ...]
    passive: tuple[str, ...]
    degrees_of_freedom: int
    payload: float | None
    payload_at: str
    unreachable: float
    parameters: Mapping[str, float]
    _model: MachineModel = field(repr=False, compare=False)
    _workspace: "Workspace" = field(repr=False, compare=False)

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain data."""
        rows = {
            name: [asdict(x) for x in getattr(self, name)] for name in ("bodies", "actuators", "closures")
        }
        return to_plain({n: x for n, x in vars(self).items() if not n.startswith("_")} | rows)

    def draw(self) -> "dict[str, Figure]":
        """Return pictures by name: `machine` with its workspace, `forces` and `levers` over the strokes."""
        from ..sketch.machine_maps import draw_machine_pictures

        limits = {x.name: ForceLimits(x.continuous_force, x.largest_force) for x in self.actuators}
        return draw_machine_pictures(self._model, self._workspace, limits)


def collect_machine(
    machine: Machine,
    values: Mapping[str, float] | None = None,
    payload: float | None = None,
    limits: Mapping[str, ForceLimits] | None = None,
) -> MachineInfo:
    """Return information on a machine.

    Args:
        machine: The machine.
        values: Numbers by name that replace those of the description.
        payload: Mass of the payload in kg, which replaces that of the description.
        limits: Limits of the actuators' forces by name.

    Raises:
        MachineError: These numbers make no machine.
    """
    from ..sketch.workspace import find_workspace

    if payload is not None and machine.payload is not None:
        machine = replace(machine, payload=replace(machine.payload, m=payload))
    model = MachineModel(machine, values)
    workspace, start = find_workspace(model), np.array([model.start])
    forces, extremes = model.holding_forces(start)[0], find_extremes(model, workspace.strokes)
    known_limits = limits or {}
    actuators = tuple(
        ActuatorInfo(
            name=bar.name,
            ends=machine.actuators[bar.name].ends,
            length=float(plain(bar.length)),
            stroke=(model.q_LB[i], model.q_UB[i]),
            start=float(model.start[i]),
            start_force=_drop_rounding(float(forces[i])),
            lowest_force=_drop_rounding(extremes[i].lowest),
            highest_force=_drop_rounding(extremes[i].highest),
            worst_strokes=tuple(map(float, extremes[i].strokes)),
            lever=float(find_levers(model, start, i)[0]),
            continuous_force=known_limits.get(bar.name, ForceLimits()).continuous,
            largest_force=known_limits.get(bar.name, ForceLimits()).largest,
        )
        for i, bar in enumerate(model.mechanism.actuators)
    )
    passive = _name_coordinates(model, model.mechanism.passive)
    return MachineInfo(
        dimensions=model.dimensions,
        bodies=tuple(_build_body_info(model, name) for name in model.machine.bodies),
        actuators=actuators,
        closures=tuple(_list_closure_steps(model)),
        passive=passive,
        degrees_of_freedom=len(actuators) + len(passive),
        payload=None if machine.payload is None else model.payload,
        payload_at="" if machine.payload is None else machine.payload.at,
        unreachable=workspace.unreachable,
        parameters={name: parameter.value for name, parameter in model.machine.parameters.items()},
        _model=model,
        _workspace=workspace,
    )


def find_machine_info(system: System, starts: Mapping[str, Any]) -> MachineInfo | None:
    """Return information on the machine of a system; None without one, or if its FMU is another one's.

    Args:
        system: The system.
        starts: Start values by full name.

    Raises:
        CommandError: The start values make no machine.
    """
    stored = system.record.get("machine")
    components = {component.name for component in system.components}
    component = next((name for name in COMPONENTS if name in components), None)
    if stored is None or component is None:
        return None
    starts = {name: x for name, x in starts.items() if x is not None}
    machine = read_definition(json.dumps(stored["definition"]))
    names = name_numbers(machine).parameters
    if not all(f"{component}.{name}" in starts for name in names):
        return None
    # overrides change the machine
    values = {name: starts[f"{component}.{name}"] for name in names}
    roles = find_machine_roles(map(str, system.connections))
    limits = {joint: read_limits(joint, starts, roles) for joint in machine.actuators}
    try:
        return collect_machine(machine, values, starts.get(f"{component}.payload.m"), limits)
    except MachineError as error:
        raise CommandError(f"the machine '{stored['name']}' cannot take its pose: {error}.") from error


def _drop_rounding(force: float) -> float:
    """Return a force in N; 0 for the rounding errors of an actuator that holds nothing."""
    return 0.0 if abs(force) < _ROUNDING else force


def _build_body_info(model: MachineModel, name: str) -> BodyInfo:
    body = model.machine.bodies[name]
    joint = body.joint
    on = f"{joint.parent}.{joint.at}" if joint.at else joint.parent
    return BodyInfo(name, joint.kind, on, model.machine.value(body.m), joint.is_passive)


def _list_closure_steps(model: MachineModel) -> list[ClosureInfo]:
    """Return the steps in which poses are found: their coordinates, lengths and methods."""
    mechanism, closure, closures = model.mechanism, model.closure, []
    loops = list(model.machine.loops)
    for step in closure.steps:
        rows = [closure.rows[e] for e in step.equations]
        lengths = [mechanism.bars[row.bar].name if row.bar >= 0 else loops[row.loop] for row in rows]
        slides = mechanism.frames[mechanism.frame_of(step.unknowns[0])].slides
        method = NEWTON if step.unknowns[0] not in closure.sides else SLIDE if slides else TRIANGLE
        names = _name_coordinates(model, step.unknowns)
        closures.append(ClosureInfo(names, tuple(dict.fromkeys(lengths)), method))
    return closures


def _name_coordinates(model: MachineModel, coordinates: "tuple[int, ...] | list[int]") -> tuple[str, ...]:
    """Return the names of the frames that these coordinates move."""
    frames = model.mechanism.frames
    return tuple(frames[model.mechanism.frame_of(i)].name for i in coordinates)
