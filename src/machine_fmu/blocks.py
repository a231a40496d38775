"""Blocks of a machine: as a load, motion in and forces out, and merged with the mechanics of its actuators.

Elements of vectors are the actuators in the order of the description. What Newton's method finds is also a
state, `pose`: it moves with the strokes, so that each evaluation begins close to the solution.
"""

from collections.abc import Mapping, Sequence
from hashlib import sha256
from typing import Any, ClassVar

from fmublock import Block, DefaultExperiment, Input, Output, Parameter, State
from fmublock.variables import Variable

from .actuators import actuator_parameters, screw_forces
from .assembly import assemble
from .closure import ITERATIONS, Closure, find_closure
from .definition import write_definition
from .description import Machine, MachineError
from .dynamics import Dynamics
from .exact import ZERO, plain
from .linear import solve_symmetric
from .naming import Group, group_parameters, name_numbers

_CORRECTION = 50.0
"""Rate in 1/s at which the state `pose` returns to the solution."""

_CLOSE = 1e-6
"""Largest change in m or rad by the last iteration of a pose that is found."""

_AXES = "xyz"


class MachineBlock(Block):
    """Base of the blocks of a machine.

    Attributes:
        machine: The description, all of whose numbers are parameters.
        closure: How lengths determine the pose.
        places: Attribute and index of each parameter by its name.
        initial_strokes: Name of the initial strokes in messages.
        iterations: Number of Newton's iterations in an evaluation.
    """

    machine: ClassVar[Machine]
    closure: ClassVar[Closure]
    places: ClassVar[Mapping[str, tuple[str, int | None]]]
    initial_strokes: ClassVar[str] = "x_L"
    iterations: ClassVar[int] = ITERATIONS
    default_experiment = DefaultExperiment(stop_time=1.0, step_size=1e-3)

    internal_step = Parameter(
        1e-3,
        unit="s",
        minimum=1e-9,
        name="solver.internal_step",
        description="Longest internal integration step (classical Runge-Kutta)",
    )

    def conditions(self, v: Any) -> dict[str, Any]:
        """Require a payload that is not negative, strokes that are not empty, and triangles that close."""
        conditions = {}
        if self.machine.payload is not None:
            conditions["payload.m must not be negative"] = v.payload >= 0.0
        start = self.initial_strokes.replace("start.x_L", "x_L_start")
        conditions |= self._closing(v, getattr(v, start), f"{self.initial_strokes}[{{}}]", with_all=True)
        if "screw_q_LB" in vars(type(self)):
            for i, (low, high) in enumerate(zip(v.screw_q_LB, v.screw_q_UB, strict=True), 1):
                conditions[f"the stroke is empty: screw.q_UB[{i}] must be above screw.q_LB[{i}]"] = high > low
            if not self.closure.iterated:
                conditions |= self._closing(v, v.screw_q_LB, "screw.q_LB[{}]")
                conditions |= self._closing(v, v.screw_q_UB, "screw.q_UB[{}]")
        return conditions

    def _closing(self, v: Any, strokes: Sequence[Any], name: str, with_all: bool = False) -> dict[str, Any]:
        """Return conditions that triangles close; `with_all` those whose pins other joints move."""
        dynamics, conditions = self.dynamics(v, strokes), dict[str, Any]()
        frames = dynamics.mechanism.frames
        for coordinate, change in dynamics.pose.changes.items():
            coordinate_name = frames[dynamics.mechanism.frame_of(coordinate)].name
            conditions[f"start.pose of '{coordinate_name}' must be near the one of the strokes"] = (
                abs(change) < _CLOSE
            )
        for i, bar in enumerate(dynamics.mechanism.actuators, 1):
            lever = dynamics.pose.levers.get(bar.name)
            parents = {frames[bar.start.frame].parent, frames[bar.end.frame].parent}
            if lever is None or not (with_all or parents & {bar.start.frame, bar.end.frame}):
                continue
            slope = plain(lever.slope) * float(self.closure.sides[lever.coordinate])
            stroke = name.format(i)
            conditions[f"the triangle of '{bar.name}' cannot close at the stroke {stroke}"] = slope > 0.0
        return conditions

    def dynamics(self, v: Any, strokes: Sequence[Any]) -> Dynamics:
        """Return the machine's dynamics at strokes in m."""

        def value(name: str) -> Any:
            attribute, index = self.places[name]
            found = getattr(v, attribute)
            return found if index is None else found[index]

        mechanism = assemble(self.machine, value, None if self.machine.payload is None else v.payload)
        iterated = self.closure.iterated
        guess = dict(zip(iterated, v.pose, strict=True)) if iterated else None
        passive = v.passive_q if mechanism.passive else ()
        return Dynamics(mechanism, self.closure, strokes, passive, guess, self.iterations)

    def pose_rates(self, v: Any, dynamics: Dynamics, speeds: Sequence[Any]) -> dict[str, Any]:
        """Return the derivatives of the pose: its speeds, and a return to the solution."""
        iterated = self.closure.iterated
        if not iterated:
            return {}
        rates, solution = dynamics.speeds(speeds), dynamics.pose.numbers
        pairs = zip(iterated, v.pose, strict=True)
        return {"pose": [plain(rates[i]) + _CORRECTION * (solution[i] - guess) for i, guess in pairs]}

    def tip(self, dynamics: Dynamics) -> dict[str, Any]:
        """Return the position of the payload in m."""
        end = dynamics.mechanism.payload
        if end is None:
            return {}
        position = dynamics.pose.point(end)[: self.machine.dimensions]
        return {f"tip_{axis}": plain(x) for axis, x in zip(_AXES, position, strict=False)}


class MachineLoad(MachineBlock):
    """Load forces of a machine for the motion of its actuators."""

    def accelerations(self, v: Any, dynamics: Dynamics) -> tuple[list[Any], list[Any]]:
        """Return speeds and accelerations of strokes and passive coordinates."""
        count = len(v.x_L)
        if not dynamics.mechanism.passive:
            return v.v_L, v.a_L
        speeds = [*v.v_L, *v.passive_v]
        M, h = dynamics.mass_matrix(), dynamics.bias(speeds)
        right = []
        for row, weight in zip(M[count:], h[count:], strict=True):
            total = -weight
            for m, a in zip(row, v.a_L, strict=False):
                total = total - m * a
            right.append(total)
        return speeds, [*v.a_L, *solve_symmetric([row[count:] for row in M[count:]], right)]

    def derivatives(self, v: Any) -> dict[str, Any]:
        """Return the derivatives of the pose and of passive coordinates."""
        if not self.layout().states:
            return {}
        dynamics = self.dynamics(v, v.x_L)
        speeds, accelerations = self.accelerations(v, dynamics)
        return self.pose_rates(v, dynamics, speeds) | _passive(v, dynamics, accelerations)

    def outputs(self, v: Any) -> dict[str, Any]:
        """Return the forces for the motion, and the position of the payload."""
        dynamics = self.dynamics(v, v.x_L)
        forces = dynamics.inverse(*self.accelerations(v, dynamics))
        return {"F_L": forces[: len(v.x_L)], **self.tip(dynamics)}


class MachinePlant(MachineBlock):
    """A machine with the mechanics of its actuators: motor torques in, motion out."""

    initial_strokes = "start.x_L"
    iterations = 2  # strokes and pose are states of the same integration, so that the guess is close

    def motion(self, v: Any) -> tuple[Dynamics, list[Any], list[Any], list[Any], list[Any]]:
        """Return dynamics, speeds and accelerations of all variables, forces, and reflected inertias."""
        dynamics = self.dynamics(v, v.x_L)
        forces, inertias = screw_forces(v, dynamics.mechanism.actuator_masses)
        free = [ZERO] * len(dynamics.mechanism.passive)
        speeds = [*v.v_L, *(v.passive_v if free else ())]
        forces, inertias = [*forces, *free], [*inertias, *free]
        return dynamics, speeds, dynamics.forward(speeds, forces, inertias), forces, inertias

    def derivatives(self, v: Any) -> dict[str, Any]:
        """Return speeds and accelerations of the screws, and the motion of the rest."""
        dynamics, speeds, accelerations, _, _ = self.motion(v)
        rest = self.pose_rates(v, dynamics, speeds) | _passive(v, dynamics, accelerations)
        return {"x_L": v.v_L, "v_L": accelerations[: len(v.x_L)], **rest}

    def outputs(self, v: Any) -> dict[str, Any]:
        """Return accelerations, the forces between actuators and machine, the payload's place, and energy."""
        dynamics, speeds, accelerations, forces, inertias = self.motion(v)
        count = len(v.x_L)
        triples = zip(forces[:count], inertias, accelerations, strict=False)
        return {
            "a_L": accelerations[:count],
            "F_L": [force - inertia * a for force, inertia, a in triples],
            **self.tip(dynamics),
            "energy": dynamics.energy(speeds, inertias),
        }


def load_block(machine: Machine, name: str = "", about: str = "") -> type[MachineLoad]:
    """Return the block of a machine as a load.

    Args:
        machine: The description.
        name: Name of the class and of the FMU; empty for the base of a class in a file.
        about: Its docstring.

    Raises:
        MachineError: Lengths do not determine the machine's pose.
    """
    made = _Declared(machine)
    n = made.count
    variables: dict[str, Variable] = {
        "x_L": Input(made.strokes, shape=n, unit="m", nominal=0.1, symbol="q_i", description="Stroke"),
        "v_L": Input(shape=n, unit="m/s", nominal=0.1, symbol=r"\dot{q}_i", description="Speed of a stroke"),
        "a_L": Input(shape=n, unit="m/s2", symbol=r"\ddot{q}_i", description="Acceleration of a stroke"),
        **made.states(),
        "F_L": _force(n),
        **made.tip(),
    }
    return made.block(MachineLoad, name, about, variables)


def plant_block(
    machine: Machine,
    name: str = "",
    about: str = "",
    actuators: Mapping[str, Sequence[float]] | None = None,
) -> type[MachinePlant]:
    """Return the block of a machine with the mechanics of its actuators.

    Args:
        machine: The description.
        name: As in `load_block`.
        about: Its docstring.
        actuators: Start values of the actuators' parameters by attribute.

    Raises:
        MachineError: Lengths do not determine the machine's pose.
    """
    made = _Declared(machine)
    n = made.count
    parameters = actuator_parameters(n, actuators or {})
    x_L_start = Parameter(
        made.strokes, shape=n, unit="m", name="start.x_L", description="Initial screw position"
    )
    v_L_start = Parameter(0.0, shape=n, unit="m/s", name="start.v_L", description="Initial screw speed")
    variables: dict[str, Variable] = {
        "tau_m": Input(shape=n, unit="N.m", nominal=10.0, description="Motor torque that drives the screw"),
        "d_2": Input(shape=n, unit="m/s2", description="Disturbance of the screw's acceleration"),
        **parameters,
        "x_L_start": x_L_start,
        "v_L_start": v_L_start,
        "x_L": State(
            x_L_start,
            shape=n,
            unit="m",
            nominal=0.1,
            limits=made.stroke_limits,
            symbol="q_i",
            description="Screw position",
        ),
        "v_L": State(
            v_L_start,
            shape=n,
            unit="m/s",
            nominal=0.1,
            limits=parameters["v_max"],
            symbol=r"\dot{q}_i",
            description="Screw speed",
        ),
        **made.states(),
        "a_L": Output(shape=n, unit="m/s2", symbol=r"\ddot{q}_i", description="Screw acceleration"),
        "F_L": _force(n),
        **made.tip(),
        "energy": Output(
            unit="J",
            nominal=1e4,
            description="Energy of machine and actuators; potential energy relative to 0",
        ),
    }
    return made.block(MachinePlant, name, about, variables)


def _force(count: int) -> Output:
    return Output(shape=count, unit="N", nominal=1e4, description="Load force, positive against extension")


def _passive(v: Any, dynamics: Dynamics, accelerations: Sequence[Any]) -> dict[str, Any]:
    """Return the derivatives of passive coordinates."""
    if not dynamics.mechanism.passive:
        return {}
    return {"passive_q": v.passive_v, "passive_v": accelerations[len(v.x_L) :]}


class _Declared:
    """What the blocks of a machine declare."""

    def __init__(self, machine: Machine) -> None:
        if not machine.actuators:
            raise MachineError("the machine has no actuators; add one")
        self.machine = name_numbers(machine)
        self.closure = find_closure(self.machine)
        self.count = len(machine.actuators)
        self.mechanism = assemble(self.machine)
        self._groups = {group.name: group for group in group_parameters(self.machine.parameters)}
        self._parameters = {_attribute(name): _declare(group) for name, group in self._groups.items()}

    @property
    def strokes(self) -> list[float]:
        """The strokes at the start in m."""
        found = []
        for bar in self.mechanism.actuators:
            start = self.machine.actuators[bar.name].start
            found.append(
                self.closure.lengths[bar.name] - float(plain(bar.length)) if start is None else start
            )
        return found

    @property
    def stroke_limits(self) -> tuple[Parameter, Parameter] | None:
        """The parameters of the ends of the strokes, if they are vectors."""
        low, high = (self._parameters.get(_attribute(f"screw.{name}")) for name in ("q_LB", "q_UB"))
        return None if low is None or high is None else (low, high)

    def states(self) -> dict[str, Variable]:
        """Return the states of what strokes alone do not determine."""
        found = dict[str, Variable]()
        iterated, passive = self.closure.iterated, self.mechanism.passive
        for attribute, coordinates, about in (
            ("pose", iterated, "Coordinates that Newton's method finds"),
            ("passive_q", passive, "Passive coordinates"),
        ):
            if coordinates:
                at = [self.closure.assembly[i] for i in coordinates]
                name = attribute.replace("_", ".")
                start = Parameter(at, shape=len(at), name=f"start.{name}", description=f"Initial {name}")
                found[f"{attribute}_start"] = start
                found[attribute] = State(start, shape=len(at), name=name, description=about)
        if passive:
            found["passive_v"] = State(
                shape=len(passive), name="passive.v", description="Speeds of passive coordinates"
            )
        return found

    def tip(self) -> dict[str, Variable]:
        """Return the outputs with the position of the payload."""
        if self.machine.payload is None:
            return {}
        about = ("Horizontal position of the payload", "Height of the payload")
        if self.machine.dimensions == 3:
            about = tuple(f"Position of the payload, {axis}" for axis in _AXES)
        return {
            f"tip_{axis}": Output(unit="m", name=f"tip.{axis}", description=text)
            for axis, text in zip(_AXES, about, strict=False)
        }

    def block(self, base: Any, name: str, about: str, variables: Mapping[str, Variable]) -> Any:
        """Return a block with the machine's parameters and these variables."""
        declared = dict[str, Any](self._parameters)
        if self.machine.payload is not None:
            payload = Input(
                self.machine.payload.m,
                unit="kg",
                nominal=100.0,
                minimum=0.0,
                name="payload.m",
                symbol="m",
                description="Mass of the payload",
            )
            declared = {"payload": payload, **declared}
        for attribute, variable in {**declared, **variables}.items():
            variable.attribute = attribute
            if variable.name is None:
                variable.name = attribute
        places = {
            element: (_attribute(group.name), i if group.is_vector else None)
            for group in self._groups.values()
            for i, element in enumerate(group.names())
        }
        texts = {
            "__doc__": about or base.__doc__,
            "__module__": base.__module__,
            "machine": self.machine,
            "closure": self.closure,
            "places": places,
        }
        if not name:  # as the text of the base, so that the class in a file can be gathered for an FMU
            digest = sha256(write_definition(self.machine).encode()).hexdigest()
            name, texts["__doc__"] = base.__name__, f"{texts['__doc__']}\n\nDefinition: {digest}"
            texts["__qualname__"] = base.__qualname__
        return type(name, (base,), {**declared, **variables, **texts})


def _attribute(name: str) -> str:
    return name.replace(".", "_")


def _declare(group: Group) -> Parameter:
    first = group.parameters[0]
    values = [parameter.value for parameter in group.parameters]
    return Parameter(
        values if group.is_vector else values[0],
        shape=len(values) if group.is_vector else (),
        unit=first.unit or None,
        minimum=first.minimum,
        maximum=first.maximum,
        name=group.name,
        symbol=first.symbol,
        description=first.about,
    )
