"""Structural parameters of the components of a system."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..base.errors import CommandError
from ..fmu.elements import ElementVariable
from ..fmu.interface import Interface, read_interface, read_interfaces
from ..fmu.variables import convert_structure
from .model import Component, System, Value
from .names import Names
from .resolution import convert_to_fmu_terms


def find_changed_sizes(component: Component, interface: Interface) -> dict[str, int]:
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
    return set_structure(system, fmus, read_interfaces(fmus), {})[1]


def set_structure(
    system: System, fmus: Mapping[str, Path], interfaces: Mapping[str, Interface], values: Mapping[str, Value]
) -> tuple[System, dict[str, Interface]]:
    """Set values of structural parameters, on which names and sizes of arrays depend.

    Args:
        system: The system.
        fmus: The FMU files by component.
        interfaces: The model descriptions by component, with their own sizes.
        values: Start values by full name; only those of structural parameters are set.

    Returns:
        The changed system, and the model descriptions with the sizes that follow.

    Raises:
        CommandError: If a structural parameter does not accept its value, or single elements of an array that
            changes its size are connected already.
    """
    names = Names(system, interfaces)
    sizes: dict[str, Any] = {n: v for n, v in values.items() if names.is_structural(n)}
    changed, sized = system.with_parameters(sizes), dict(interfaces)
    for name, interface in interfaces.items():
        before, after = (find_changed_sizes(s.component(name), interface) for s in (system, changed))
        if before != after:
            _refuse_connected_elements(system, name, interface, {*before, *after})
        if after:
            # the elements of arrays are variables, so other sizes make another description
            sized[name] = read_interface(fmus[name], after)
    return changed, sized


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
