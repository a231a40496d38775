"""Names for the numbers of a description, so that each can vary: `boom.m`, `boom.pin.x`, `lift.length`.

A number that is 0 gets no name: what is zero stays zero, which keeps the equations short. Declare a parameter
with the value 0 for one that varies.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from .description import (
    GROUND,
    Actuator,
    Body,
    Link,
    Machine,
    MachineError,
    Number,
    Parameter,
    Payload,
    Point,
)

_ELEMENT = re.compile(r"(?P<name>.+)\[(?P<index>[0-9]+)\]")
_AXES = "xyz"


def name_numbers(machine: Machine) -> Machine:
    """Return the machine with a parameter for each number that is not zero and has no name.

    Raises:
        MachineError: Two numbers would have the same name.
    """
    return _Naming(machine).finish()


@dataclass(frozen=True)
class Group:
    """Parameters that are one variable: a number, or the elements of a vector.

    Attributes:
        name: Name of the variable.
        is_vector: Whether its elements have names with [1], [2] and so on.
        parameters: All elements.
    """

    name: str
    is_vector: bool
    parameters: tuple[Parameter, ...]

    def names(self) -> Iterator[str]:
        """Yield the names of the elements, as the description has them."""
        for i in range(1, len(self.parameters) + 1):
            yield f"{self.name}[{i}]" if self.is_vector else self.name


def group_parameters(parameters: Mapping[str, Parameter]) -> list[Group]:
    """Return the parameters as variables, in their order.

    Raises:
        MachineError: A vector lacks an element, or has them in another order.
    """
    groups = dict[str, list[Parameter]]()
    vectors = set[str]()
    for name, parameter in parameters.items():
        match = _ELEMENT.fullmatch(name)
        group = groups.setdefault(match["name"] if match else name, [])
        group.append(parameter)
        if match:
            vectors.add(match["name"])
            if int(match["index"]) != len(group):
                raise MachineError(f"the parameter '{name}' must come after {match['name']}[{len(group)}]")
    return [Group(name, name in vectors, tuple(found)) for name, found in groups.items()]


class _Naming:
    """A machine that gets names."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._parameters = dict(machine.parameters)

    def finish(self) -> Machine:
        """Return the machine."""
        machine = self._machine
        bodies = {name: self._body(name, body) for name, body in machine.bodies.items()}
        ground = {name: self._point(f"{GROUND}.{name}", point) for name, point in machine.ground.items()}
        actuators = self._actuators() if machine.actuators else {}
        links = {name: self._link(name, x) for name, x in machine.links.items()}
        payload: Payload | None = machine.payload
        if payload is not None:
            J = self._name("payload.J", payload.J, "m2", "Inertia about its point per mass")
            payload = replace(payload, J=J)
        gravity = self._name("gravity", machine.gravity, "m/s2", "Gravitational acceleration")
        return replace(
            machine,
            bodies=bodies,
            ground=ground,
            actuators=actuators,
            links=links,
            payload=payload,
            gravity=gravity,
            parameters=self._parameters,
        )

    def _name(self, name: str, number: Number, unit: str, about: str) -> Number:
        if isinstance(number, str) or number == 0.0:
            return number
        lowest = 0.0 if unit in ("kg", "m2") or name.endswith(".J") else None
        if name in self._parameters:
            raise MachineError(f"two numbers have the name '{name}'; rename a body, link, point or parameter")
        self._parameters[name] = Parameter(float(number), unit, about, lowest)
        return name

    def _names(self, name: str, numbers: Any, unit: str, about: str) -> tuple[Number, ...]:
        return tuple(
            self._name(f"{name}.{axis}", x, unit, f"{about}, {axis}")
            for axis, x in zip(_AXES, numbers, strict=False)
        )

    def _body(self, name: str, body: Body) -> Body:
        J = body.J
        if self._machine.dimensions == 2:
            J = tuple(self._name(f"{name}.J", x, "kg.m2", "Inertia about the centre of mass") for x in J)
        else:
            ends = ("xx", "yy", "zz", "xy", "xz", "yz")
            J = tuple(
                self._name(f"{name}.J.{end}", x, "kg.m2", f"Inertia about the centre of mass, {end}")
                for end, x in zip(ends, J, strict=False)
            )
        damping = self._name(
            f"{name}.damping", body.joint.damping, "", "Damping of its joint, N.m.s/rad or N.s/m"
        )
        return replace(
            body,
            joint=replace(body.joint, damping=damping),
            m=self._name(f"{name}.m", body.m, "kg", "Mass"),
            c=self._names(f"{name}.c", body.c, "m", "Centre of mass"),
            J=J,
            points={end: self._point(f"{name}.{end}", point) for end, point in body.points.items()},
        )

    def _point(self, name: str, point: Point) -> Point:
        polar = point.polar
        if polar is not None:
            polar = (
                self._name(f"{name}.radius", polar[0], "m", "Distance from its origin"),
                self._name(f"{name}.angle", polar[1], "rad", "Direction from its origin"),
            )
        return replace(point, position=self._names(name, point.position, "m", "Position"), polar=polar)

    def _link(self, name: str, link: Link) -> Link:
        length = link.length
        if length is not None:
            length = self._name(f"{name}.length", length, "m", "Length")
        return replace(
            link,
            m=self._name(f"{name}.m", link.m, "kg", "Mass"),
            c=self._name(f"{name}.c", link.c, "m", "Centre of mass from the first point"),
            J=self._name(f"{name}.J", link.J, "kg.m2", "Inertia across, about the centre of mass"),
            length=length,
        )

    def _actuators(self) -> dict[str, Actuator]:
        """Return the actuators, whose numbers are elements of vectors."""
        actuators = dict(self._machine.actuators)
        for attribute, name, unit, about in _ACTUATOR:
            numbers = [getattr(actuator, attribute) for actuator in actuators.values()]
            named = self._vector(name, numbers, unit, about)
            for key, number in zip(list(actuators), named, strict=True):
                actuators[key] = replace(actuators[key], **{attribute: number})
        ends = zip(*(actuator.stroke for actuator in actuators.values()), strict=True)
        lows, highs = (
            self._vector(name, list(numbers), "m", about, keep=True)
            for numbers, (name, about) in zip(ends, _STROKE, strict=True)
        )
        strokes = zip(lows, highs, strict=True)
        return {
            key: replace(actuator, stroke=stroke)
            for (key, actuator), stroke in zip(actuators.items(), strokes, strict=True)
        }

    def _vector(
        self, name: str, numbers: list[Number], unit: str, about: str, keep: bool = False
    ) -> list[Number]:
        """Return names of the elements of a vector; numbers as they are if all have names or are zero."""
        has_numbers = any(not isinstance(x, str) for x in numbers)
        if not has_numbers or not (keep or any(numbers)):
            return numbers
        found = list[Number]()
        for i, x in enumerate(numbers, 1):
            if isinstance(x, str):
                raise MachineError(f"{name} of the actuators mixes numbers and the parameter '{x}'")
            lowest = 0.0 if unit in ("kg", "kg.m2") else None
            self._parameters[f"{name}[{i}]"] = Parameter(float(x), unit, about, lowest)
            found.append(f"{name}[{i}]")
        return found


_ACTUATOR = (
    ("L_0", "screw.L_0", "m", "Distance of the pins at stroke 0"),
    ("m", "screw.M_BS", "kg", "Mass of an actuator without its motor"),
    ("rod_share", "tube.share", "", "Fraction of M_BS in the tube, which moves with the screw"),
    ("motor_m", "motor.m", "kg", "Mass, which is fixed to the housing"),
    ("c", "housing.c", "m", "Centre of mass of housing and motor from the fixed pin"),
    ("J", "housing.J", "kg.m2", "Inertia of housing and motor about their centre of mass"),
    ("rod_c", "tube.c", "m", "Centre of mass of the tube behind its pin"),
    ("rod_J", "tube.J", "kg.m2", "Inertia of the tube about its centre of mass"),
)
"""Attributes of actuators, and names, units and meanings of their parameters."""

_STROKE = (("screw.q_LB", "Lower end of a stroke"), ("screw.q_UB", "Upper end of a stroke"))
