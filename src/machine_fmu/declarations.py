"""Declare the blocks of a machine: their variables, from its description."""

from collections.abc import Mapping, Sequence
from hashlib import sha256
from typing import Any

from fmublock import Input, Output, Parameter, State
from fmublock.variables import Variable

from .actuators import actuator_parameters
from .assembly import assemble
from .blocks import AXES_NAMES, MachineLoad, MachinePlant, attribute_of
from .closure import find_closure, start_strokes
from .definition import write_definition
from .description import Machine, MachineError
from .guards import Guards
from .naming import Group, group_parameters, name_numbers


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
        "x_L": Input(
            start_strokes(machine), shape=n, unit="m", nominal=0.1, symbol="q_i", description="Stroke"
        ),
        "v_L": Input(shape=n, unit="m/s", nominal=0.1, symbol=r"\dot{q}_i", description="Speed of a stroke"),
        "a_L": Input(shape=n, unit="m/s2", symbol=r"\ddot{q}_i", description="Acceleration of a stroke"),
        **made.states(),
        "F_L": _force(n),
        **made.tip(),
        **made.observed(),
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
        start_strokes(machine), shape=n, unit="m", name="start.x_L", description="Initial screw position"
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
        **made.observed(),
    }
    return made.block(MachinePlant, name, about, variables)


def _force(count: int) -> Output:
    return Output(shape=count, unit="N", nominal=1e4, description="Load force, positive against extension")


class _Declared:
    """What the blocks of a machine declare."""

    def __init__(self, machine: Machine) -> None:
        if not machine.actuators:
            raise MachineError("the machine has no actuators; add one")
        self.machine = name_numbers(machine)
        self.closure = find_closure(self.machine)
        self.guards = Guards.of(self.machine, self.closure)
        self.count = len(machine.actuators)
        self.mechanism = assemble(self.machine)
        self._groups = {group.name: group for group in group_parameters(self.machine.parameters)}
        self._parameters = {attribute_of(name): _declare(group) for name, group in self._groups.items()}

    @property
    def stroke_limits(self) -> tuple[Parameter, Parameter] | None:
        """The parameters of the ends of the strokes, if they are vectors."""
        low, high = (self._parameters.get(attribute_of(f"screw.{name}")) for name in ("q_LB", "q_UB"))
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
            about = tuple(f"Position of the payload, {axis}" for axis in AXES_NAMES)
        return {
            f"tip_{axis}": Output(unit="m", name=f"tip.{axis}", description=text)
            for axis, text in zip(AXES_NAMES, about, strict=False)
        }

    def observed(self) -> dict[str, Variable]:
        """Return outputs that tell when the machine leaves the poses that it can follow, and their limits."""
        limits = self.guards.parameters()
        return limits | self.guards.outputs(limits)

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
            if self.machine.payload.has_force:
                axes = ", ".join(AXES_NAMES[: self.machine.dimensions])
                declared["payload_F"] = Input(
                    shape=self.machine.dimensions,
                    unit="N",
                    nominal=1e4,
                    name="payload.F",
                    description=f"Force of a process on the payload along {axes}",
                )
        for attribute, variable in {**declared, **variables}.items():
            variable.attribute = attribute
            if variable.name is None:
                variable.name = attribute
        places = {
            element: (attribute_of(group.name), i if group.is_vector else None)
            for group in self._groups.values()
            for i, element in enumerate(group.names())
        }
        texts = {
            "__doc__": about or base.__doc__,
            "__module__": base.__module__,
            "machine": self.machine,
            "closure": self.closure,
            "guards": self.guards,
            "places": places,
        }
        if not name:  # as the text of the base, so that the class in a file can be gathered for an FMU
            digest = sha256(write_definition(self.machine).encode()).hexdigest()
            name, texts["__doc__"] = base.__name__, f"{texts['__doc__']}\n\nDefinition: {digest}"
            texts["__qualname__"] = base.__qualname__
        return type(name, (base,), {**declared, **variables, **texts})


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
