"""Structural parameters of the components of a system."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..base.errors import CommandError
from ..fmu.elements import ElementVariable
from ..fmu.interface import Interface, may_have_structure, read_interface, read_interfaces
from ..fmu.structure import convert_structure
from .model import Component, System, Value
from .resolution import convert_to_fmu_terms


def structure_of(component: Component, interface: Interface) -> dict[str, int]:
    """Return the values of a component's structural parameters that differ from their start values.

    Raises:
        CommandError: If one does not accept its value.
    """
    return convert_structure(component.name, interface, convert_to_fmu_terms(component).parameters)


def read_sized_interfaces(system: System, fmus: Mapping[str, Path]) -> dict[str, Interface]:
    """Return the model descriptions by component, with the sizes that follow from structural parameters.

    Args:
        system: The system.
        fmus: The FMU files by component.

    Raises:
        CommandError: As for `read_interface`, or if a structural parameter does not accept its value.
    """
    found = read_interfaces(fmus)
    for name, interface in found.items():
        if structure := structure_of(system.component(name), interface):
            found[name] = read_interface(fmus[name], structure)
    return found


def read_structural_interfaces(fmus: Mapping[str, Path]) -> dict[str, Interface]:
    """Return the model descriptions, with their own sizes, of components with structural parameters."""
    able = {file for file in set(fmus.values()) if may_have_structure(file)}
    return read_interfaces({name: file for name, file in fmus.items() if file in able})


def is_structural(system: System, interfaces: Mapping[str, Interface], name: str) -> bool:
    """Return whether a full name is that of a structural parameter in `interfaces`."""
    try:
        component, own = system.split(name)
    except CommandError:
        return False
    interface, variable = interfaces.get(component.name), component.alias(own).variable
    return interface is not None and variable in interface.variables and interface.is_structural(variable)


def set_structure(system: System, interfaces: Mapping[str, Interface], values: Mapping[str, Value]) -> System:
    """Return the system with values of structural parameters.

    Args:
        system: The system.
        interfaces: The model descriptions of the components with structural parameters, with their own sizes.
        values: Start values by full name; only those of structural parameters are set.

    Raises:
        CommandError: If a structural parameter does not accept its value, or single elements of an array that
            changes its size are connected already.
    """
    own: dict[str, Any] = {n: v for n, v in values.items() if is_structural(system, interfaces, n)}
    changed = system.with_parameters(own)
    for name, interface in interfaces.items():
        before, after = (structure_of(s.component(name), interface) for s in (system, changed))
        if before != after:
            _refuse_connected_elements(system, name, interface, {*before, *after})
    return changed


def _refuse_connected_elements(system: System, name: str, interface: Interface, structural: set[str]) -> None:
    """Raise CommandError if arrays that get other sizes are connected element by element.

    Connections of a package were made for the sizes that it has itself; those from texts are made later.
    """
    sized = {
        str(v.name).rpartition("[")[0]
        for v in interface.variables.values()
        if isinstance(v, ElementVariable)
        and any(d.variable is not None and d.variable.name in structural for d in v.dimensions)
    }
    for x in (*system.into(name), *system.out_of(name)):
        for component, variable in x.ends:
            array = variable.rpartition("[")[0]
            if component == name and array in sized and not x.from_text:
                raise CommandError(
                    f"{name}.{min(structural)} cannot change the size of {name}.{array}: "
                    f"its elements are connected one by one, as {x}. Set it where they are connected.",
                    connection=str(x),
                )
