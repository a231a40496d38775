"""Structural parameters of FMI 3.0: their values, and the start values of arrays that change their size."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

from ..base.errors import CommandError, join_names
from .elements import ElementVariable
from .interface import Interface
from .variables import TypedValue, convert_start_value


def convert_structure(component: str, interface: Interface, values: Mapping[str, Any]) -> dict[str, int]:
    """Return the values of structural parameters that differ from their start values.

    Args:
        component: The name of the component, for error messages.
        interface: Its model description, with any sizes.
        values: Start values by variable name, also those of other variables.

    Raises:
        CommandError: If a structural parameter does not accept its value.
    """
    changed = {}
    for name, value in values.items():
        if name not in interface.variables or not interface.is_structural(name):
            continue
        variable = interface.variables[name]
        number = convert_start_value(component, interface, variable, value)
        if name in interface.sizes and number == 0:
            raise CommandError(
                f"{component}.{name} = 0 is not supported: it is the size of an array, "
                "and arrays need at least one element.",
                variable=name,
            )
        if number != convert_start_value(component, interface, variable, variable.start):
            changed[name] = number
    return changed


def complete_start_values(
    component: str, interface: Interface, values: Sequence[TypedValue], driven: Collection[str]
) -> list[TypedValue]:
    """Return start values with those that resized arrays need.

    A change of its size invalidates the start value of an array in the FMU (FMI 3.0, 2.4.7.2). A single start
    value in the model description is set again for all elements; a list does not fit any more.

    Args:
        component: The name of the component, for error messages.
        interface: Its model description.
        values: The start values that are set.
        driven: The names of its connected inputs.

    Raises:
        CommandError: If an element of a resized array has no value.
    """
    present = {*driven, *(str(variable.name) for variable, _ in values)}
    arrays: dict[int, list[ElementVariable]] = {}
    for name, variable in interface.variables.items():
        if isinstance(variable, ElementVariable) and variable.is_resized and interface.is_settable(name):
            arrays.setdefault(int(variable.valueReference), []).append(variable)
    completed = list(values)
    for elements in arrays.values():
        first, missing = elements[0], [v for v in elements if v.name not in present]
        if missing and first.start is None:
            sizes = join_names([f"{name} = {value}" for name, value in interface.structure.items()])
            raise CommandError(
                f"{component}.{missing[0].name} has no value: with {sizes}, the start values in the FMU do "
                f"not fit. Set or connect all elements, {first.name} to {elements[-1].name}.",
                variable=missing[0].name,
            )
        if len(missing) == len(elements):  # one element sets the array, the others have the same start value
            completed.append((first, convert_start_value(component, interface, first, first.start)))
    return completed
