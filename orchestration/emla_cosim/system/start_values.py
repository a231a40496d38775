"""Start values as users write them: with patterns and units."""

import difflib
from collections.abc import Iterator, Mapping

from ..base.errors import CommandError, join_names
from ..base.patterns import has_wildcard, matches_pattern
from ..base.quantities import has_unit, read_quantity
from ..fmu.interface import Interface
from .model import Component, System, Value

_MOST = 20_000
"""The largest number of names in which to search for similar ones, which is slow."""

_NAMED = 3
"""The number of matching variables that a message lists."""


def needs_interfaces(values: Mapping[str, Value]) -> bool:
    """Return whether the FMUs' variables are needed to resolve these start values."""
    return any(has_wildcard(name) or has_unit(value) for name, value in values.items())


def select_plain_names(values: Mapping[str, Value]) -> dict[str, Value]:
    """Return the values whose names are not patterns."""
    return {name: value for name, value in values.items() if not has_wildcard(name)}


def resolve_start_values(
    system: System, interfaces: Mapping[str, Interface], values: Mapping[str, Value]
) -> dict[str, Value]:
    """Return start values by full name, in the units of the system's variables.

    A pattern matches all variables that accept a start value, except connected inputs. Names take precedence
    over patterns, and later patterns over earlier ones.

    Args:
        system: The system.
        interfaces: The model descriptions by component.
        values: Start values by name or pattern.

    Raises:
        CommandError: If a pattern has no match, or a unit does not fit the variable.
    """
    if not needs_interfaces(values):
        return dict(values)
    settable = list(_settable(system, interfaces))
    known = set(settable)
    found: dict[str, Value] = {}
    for pattern, value in values.items():
        if has_wildcard(pattern) and pattern not in known:
            found |= dict.fromkeys(_match_pattern(pattern, settable, system, interfaces), value)
    found |= {name: v for name, v in values.items() if not has_wildcard(name) or name in known}
    return {name: _convert_to_unit(system, interfaces, name, value) for name, value in found.items()}


def has_quantities(system: System) -> bool:
    """Return whether start values of the system have units that must be converted."""
    return any(has_unit(value) for c in system.components for value in c.parameters.values())


def resolve_quantities(system: System, interfaces: Mapping[str, Interface]) -> System:
    """Return the system with the start values that have units as numbers in the units of their variables.

    Raises:
        CommandError: If a unit does not fit the variable.
    """
    values = {
        f"{c.name}.{name}": _convert_to_unit(system, interfaces, f"{c.name}.{name}", value)
        for c in system.components
        for name, value in c.parameters.items()
        if has_unit(value)
    }
    return system.with_parameters(values) if values else system


def _settable(system: System, interfaces: Mapping[str, Interface]) -> Iterator[str]:
    """Yield the full names of all variables that accept a start value; patterns set no sizes of arrays."""
    driven = {x.ends[1] for x in system.connections}
    for component in system.components:
        interface = interfaces[component.name]
        for name in _names(component, interface):
            variable = component.alias(name).variable
            free = interface.is_settable(variable) and not interface.is_structural(variable)
            if free and (component.name, variable) not in driven:
                yield f"{component.name}.{name}"


def _names(component: Component, interface: Interface) -> list[str]:
    """Return the variables of a component by their names in the system."""
    others = {alias.variable for alias in component.aliases.values()}
    return [*component.aliases, *(n for n in interface.variables if n not in others)]


def _match_pattern(
    pattern: str, settable: list[str], system: System, interfaces: Mapping[str, Interface]
) -> list[str]:
    """Return the variables that match a pattern; raise CommandError if there are none."""
    found = [name for name in settable if matches_pattern(name, pattern)]
    if found:
        return found
    names = (f"{c.name}.{n}" for c in system.components for n in _names(c, interfaces[c.name]))
    fixed = [name for name in names if matches_pattern(name, pattern)]
    if fixed:
        named = [*fixed[:_NAMED], *([f"{len(fixed) - _NAMED} more"] if len(fixed) > _NAMED else [])]
        raise CommandError(
            f"'{pattern}' matches {join_names(named)}, which cannot be set: they are computed or driven.",
            name=pattern,
        )
    near = _suggest_names(pattern, settable)
    meant = f"did you mean {' or '.join(near)}?" if near else "* matches any text, ? one character."
    raise CommandError(f"no variable that can be set matches '{pattern}'; {meant}", name=pattern, near=near)


def _suggest_names(pattern: str, names: list[str]) -> list[str]:
    """Return names whose ends are similar to a pattern."""
    if len(names) > _MOST:
        return []
    said = pattern.replace("*", "").replace("?", "").strip(".")
    ends = {".".join(name.split(".")[-said.count(".") - 1 :]): name for name in names}
    return [ends[end] for end in difflib.get_close_matches(said, ends, n=3, cutoff=0.6)]


def _convert_to_unit(system: System, interfaces: Mapping[str, Interface], name: str, value: Value) -> Value:
    """Return a value in the unit of its variable; raise CommandError for a unit that does not fit."""
    if not (isinstance(value, str) and has_unit(value)):
        return value
    component, own = system.split(name)
    alias, interface = component.aliases.get(own), interfaces[component.name]
    variable = interface.variables.get(alias.variable if alias is not None else own)
    if variable is None or variable.type != "Real":
        return value  # a text, or an error that is raised when it is set
    unit = alias.unit if alias is not None else interface.unit(own)
    return read_quantity(value, f"{name} = {value}", unit)
