"""A system in the terms of its FMUs: their names, their units, nothing left to convert."""

import contextlib
from collections.abc import Mapping
from dataclasses import replace

from ..errors import CommandError
from ..fmu.interface import Interface
from ..fmu.variables import find_variable
from ..units import IDENTITY, LinearTransformation, Unit, conversion
from .model import Component, Connection, System, Value


def resolved(system: System, interfaces: Mapping[str, Interface]) -> System:
    """The system with the FMUs' own names and values, and a transformation for every connection.

    `interfaces` has that of every component. Raises CommandError for whatever does not fit.
    """
    return System(
        tuple(replace(c, parameters=_parameters(c), aliases={}) for c in system.components),
        tuple(_connections(system, interfaces)),
    )


def _parameters(component: Component) -> dict[str, Value]:
    values = {}
    for name, value in component.parameters.items():
        alias = component.alias(name)
        if alias.transformation != IDENTITY:
            with contextlib.suppress(ValueError):  # who sets it says what is wrong
                value = alias.transformation(float(value))
        values[alias.variable] = value
    return values


def _connections(system: System, interfaces: Mapping[str, Interface]) -> list[Connection]:
    driven: dict[tuple[str, str], Connection] = {}
    connections = []
    for x in system.connections:
        source = _End(system.component(x.source), interfaces[x.source], x.output, "output")
        target = _End(system.component(x.target), interfaces[x.target], x.input, "input")
        if source.type != target.type and (source.type, target.type) != ("Integer", "Real"):
            raise CommandError(f"the connection {x} joins the types {source.type} and {target.type}.")
        transformation = _between(x, source, target)
        if transformation != IDENTITY and target.type != "Real":
            raise CommandError(f"the connection {x} transforms values of the type {target.type}.")
        if driven.setdefault((x.target, target.variable), x) is not x:
            raise CommandError(f"{x.target}.{x.input} is driven by two outputs.")
        if x.input in target.component.parameters:
            raise CommandError(f"{x.target}.{x.input} cannot be set: it is driven by {x.source}.{x.output}.")
        connections.append(Connection(x.source, source.variable, x.target, target.variable, transformation))
    return connections


class _End:
    """One end of a connection, in the system's terms and in the FMU's."""

    def __init__(self, component: Component, interface: Interface, name: str, causality: str) -> None:
        self.component, self._interface, self._name = component, interface, name
        self.alias = component.alias(name)
        self.variable = self.alias.variable
        variable = find_variable(component.name, interface.variables, self.variable)
        if variable.causality != causality:
            raise CommandError(
                f"{component.name}.{name} must be an {causality} to be connected, but its causality is "
                f"{variable.causality}."
            )
        if variable.type == "String":
            raise CommandError(f"{component.name}.{name} is a String, which cannot be connected.")
        self.type = str(variable.type)

    @property
    def unit(self) -> Unit | None:
        """The unit that the system sees."""
        known = self._name in self.component.aliases
        return self.alias.unit if known else self._interface.unit(self.variable)


def _between(connection: Connection, source: _End, target: _End) -> LinearTransformation:
    """What makes the FMU's input of the FMU's output."""
    transformation = connection.transformation
    if transformation is None:
        try:
            transformation = conversion(source.unit, target.unit)
        except ValueError as error:
            raise CommandError(f"the connection {connection} joins {error}.") from error
    seen = source.alias.transformation.inverse()
    return target.alias.transformation.after(transformation.after(seen))
