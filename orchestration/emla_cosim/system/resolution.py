"""Resolution of a system to the names and units of its FMUs."""

import contextlib
import math
import unicodedata
from collections.abc import Mapping
from dataclasses import replace

from ..base.arrays import SignalType
from ..base.errors import CommandError
from ..base.faults import accept_if_lenient, convert_documents_units
from ..base.units import IDENTITY, LinearTransformation
from ..fmu.elements import BINARY, CLOCK, ElementVariable, is_triggered_input
from ..fmu.interface import Interface
from ..fmu.variables import find_variable
from .model import Component, Connection, System, Value

_INVISIBLE = ("Cc", "Cs", "Zl", "Zp")
"""Unicode categories: control characters, surrogates, line and paragraph separators."""


def resolve_system(system: System, interfaces: Mapping[str, Interface]) -> System:
    """Return the system with the FMUs' own start values, and a transformation for each connection.

    Args:
        system: The system.
        interfaces: The model descriptions by component.

    Raises:
        CommandError: If names, types or units do not match.
    """
    names: set[str] = set()
    for name in (c.name for c in system.components):
        if not name or any(unicodedata.category(letter) in _INVISIBLE for letter in name):
            raise CommandError(
                f"the component {name!r} needs another name: one line, without control characters.", name=name
            )
        if name in names:
            raise CommandError(f"there are two components '{name}'; each needs its own name.")
        names.add(name)
    components = tuple(convert_to_fmu_terms(c) for c in system.components)
    driven: dict[tuple[str, str], Connection] = {}
    for x in system.connections:
        if driven.setdefault((x.target, x.input), x) is not x:
            raise CommandError(f"{x.target}.{x.input} is driven by two outputs.")
    for component in components:
        refuse_driven(component, system)
    connections = (
        replace(x, transformation=_find_checked_transformation(x, system, interfaces))
        for x in system.connections
    )
    return replace(system, components=components, connections=tuple(connections))


def refuse_driven(component: Component, system: System) -> None:
    """Raise CommandError if a start value is set for a connected input of a component.

    Raises:
        CommandError: If there is one.
    """
    for x in system.into(component.name):
        if x.input in component.parameters:
            raise CommandError(f"{x.target}.{x.input} cannot be set: it is driven by {x.source}.{x.output}.")


def convert_to_fmu_terms(component: Component) -> Component:
    """Return the component with start values in the names and units of its FMU."""
    values: dict[str, Value] = {}
    for name, value in component.parameters.items():
        alias = component.alias(name)
        if alias.transformation != IDENTITY:
            with contextlib.suppress(ValueError):  # the error is raised when the value is set
                value = alias.transformation(float(value))
        values[alias.variable] = value
    return replace(component, parameters=values, aliases={})


def _find_checked_transformation(
    connection: Connection, system: System, interfaces: Mapping[str, Interface]
) -> LinearTransformation:
    """Return the transformation of a connection after checking types and causalities."""
    source = _find_type(system.component(connection.source), interfaces, connection.output, "output")
    target = _find_type(system.component(connection.target), interfaces, connection.input, "input")
    if (source.kind == CLOCK) != (target.kind == CLOCK):
        raise CommandError(
            f"the connection {connection} joins the types {source.kind} and {target.kind}: only an output "
            "clock can drive a triggered input clock."
        )
    if (reason := _explain_loss(source, target)) is not None:
        message = (
            f"the connection {connection} joins the types {source.kind} and {target.kind}: {reason}. Values "
            "are converted only if nothing is lost: to Real or Integer"
        )
        if (source.kind, target.kind) != ("Integer", "Enumeration"):
            raise CommandError(f"{message}.")
        # FMI 2.0 sets Enumerations with fmi2SetInteger, too
        fault = "an Integer sets an Enumeration by its number, and nothing checks that it has this value"
        accept_if_lenient(str(connection), fault, message)
    _check_mime_types(connection, interfaces)
    transformation = find_transformation(connection, interfaces)
    if transformation != IDENTITY and target.kind != "Real":
        raise CommandError(
            f"the connection {connection} transforms values of the type {target.kind}, and only "
            "those of a Real can be transformed."
        )
    _check_quantities(connection, transformation, interfaces)
    if not (math.isfinite(transformation.factor) and math.isfinite(transformation.offset)):
        raise CommandError(
            f"the connection {connection} has the transformation {transformation}, which is not finite."
        )
    return transformation


def _check_mime_types(connection: Connection, interfaces: Mapping[str, Interface]) -> None:
    """Raise CommandError if the Binary ends of a connection have different `mimeType`s, unless lenient."""
    output, input_ = (interfaces[component].variables[name] for component, name in connection.ends)
    mime_types = [v.mime_type for v in (output, input_) if isinstance(v, ElementVariable)]
    if len(set(mime_types)) > 1:
        accept_if_lenient(
            str(connection),
            f"the mimeType of the output is {mime_types[0]}, that of the input {mime_types[1]}",
            f"the connection {connection} joins Binary variables with the mimeType {mime_types[0]} and "
            f"{mime_types[1]}, which must be the same",
        )


def _check_quantities(
    connection: Connection, transformation: LinearTransformation, interfaces: Mapping[str, Interface]
) -> None:
    """Raise CommandError if a temperature drives a difference of temperatures, or vice versa, unless lenient.

    An offset of the connection, such as an ambient temperature, converts one into the other.
    """
    source, target = (interfaces[component].unit(name) for component, name in connection.ends)
    if source is None or target is None or source.is_difference == target.is_difference:
        return
    # only temperatures have units with an offset
    if source.powers != {"K": 1} or target.powers != {"K": 1} or transformation.offset:
        return
    kinds = ("a difference of temperatures", "a temperature")
    fault = f"{kinds[target.is_difference]} drives {kinds[source.is_difference]}"
    is_scaled = transformation.factor != 1.0
    accept_if_lenient(
        str(connection),
        f"{fault}; its number is {'converted without an offset' if is_scaled else 'not changed'}",
        f"the connection {connection} joins different quantities: {fault} (relativeQuantity). Transform it "
        "by an offset, or correct relativeQuantity in one of the FMUs",
    )


def _explain_loss(source: SignalType, target: SignalType) -> str | None:
    """Return why values of one type cannot become values of another; None if they can.

    SSP 2.0 leaves conversions to implementations. These keep every value: Integer, Boolean (0 or 1) and
    Enumeration (the number of the value) to Real, Boolean and Enumeration to Integer.
    """
    if source.kind == target.kind == "Enumeration":
        missing = [
            f"{number} ({name})" for number, name in source.items.items() if number not in target.items
        ]
        return f"the input has no value {missing[0]}" if missing and target.items else None
    if source.kind == target.kind:
        return None
    for kind in ("String", BINARY):
        if kind in (source.kind, target.kind):
            return f"a {kind} can only become a {kind}"
    if source.kind == "Real":
        return f"a Real can have values that no {target.kind} has"
    if target.kind in ("Real", "Integer"):
        return None
    return f"not every {source.kind} is a value of {_ARTICLES[target.kind]} {target.kind}"


_ARTICLES = {"Boolean": "a", "Enumeration": "an"}


def find_transformation(connection: Connection, interfaces: Mapping[str, Interface]) -> LinearTransformation:
    """Return the transformation of a connection, or the conversion of its units.

    Args:
        connection: The connection.
        interfaces: The model descriptions by component.

    Raises:
        CommandError: If the units measure different things.
    """
    if connection.transformation is not None:
        return connection.transformation
    source, target = (interfaces[component].unit(name) for component, name in connection.ends)
    try:
        return convert_documents_units(f"the connection {connection}", source, target)
    except ValueError as error:
        raise CommandError(
            f"the connection {connection} joins {error}.", connection=str(connection)
        ) from error


def _find_type(
    component: Component, interfaces: Mapping[str, Interface], name: str, causality: str
) -> SignalType:
    """Return the type of a connected variable; raise CommandError if it cannot be connected."""
    interface = interfaces[component.name]
    if name in interface.clocks and name not in interface.variables:
        raise CommandError(
            f"{component.name}.{name} is a clock, which needs an FMU with event mode (hasEventMode)."
        )
    variable = find_variable(component.name, interface.variables, name)
    if variable.causality != causality:
        raise CommandError(
            f"{component.name}.{name} must be an {causality} to be connected, but its causality is "
            f"{variable.causality}."
        )
    if variable.type in ("String", BINARY) and variable.clocks:
        raise CommandError(
            f"{component.name}.{name} is a clocked {variable.type}, which cannot be connected."
        )
    if variable.type == CLOCK and causality == "input" and not is_triggered_input(variable):
        raise CommandError(
            f"{component.name}.{name} cannot be connected: it is a {variable.intervalVariability} clock, "
            "which ticks at its own times. Only triggered clocks can be driven."
        )
    return interface.signal_type(name)
