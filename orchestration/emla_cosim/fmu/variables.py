"""Start values and structural parameters: finding variables by name, and checking values."""

import difflib
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from fmpy.model_description import ModelVariable

from ..base.errors import CommandError, join_names
from ..base.wording import format_number as in_digits
from .elements import BINARY, CLOCK, ElementVariable, declared_range
from .interface import Interface

TypedValue = tuple[ModelVariable, Any]
"""A variable, and a value of its type."""


def convert_start_values(component: str, interface: Interface, values: Mapping[str, Any]) -> list[TypedValue]:
    """Convert start values by name to the types of their variables.

    Args:
        component: The name of the component, for error messages.
        interface: Its model description.
        values: The start values by variable name.

    Raises:
        CommandError: If a variable does not exist, or does not accept the value.
    """
    converted = []
    for name, value in values.items():
        variable = find_variable(component, interface.variables, name)
        converted.append((variable, convert_start_value(component, interface, variable, value)))
    return converted


def find_variable(component: str, variables: Mapping[str, ModelVariable], name: str) -> ModelVariable:
    """Return a variable by its name.

    Args:
        component: The name of the component, for error messages.
        variables: Its variables by name.
        name: The name to find.

    Raises:
        CommandError: If it does not exist; the message suggests similar names.
    """
    if name in variables:
        return variables[name]
    array = name.partition("[")[0]
    if elements := [n for n in variables if n.startswith(f"{array}[")]:
        raise CommandError(
            f"{component} has no variable '{name}'; "
            f"the elements of {array} are {elements[0]} to {elements[-1]}.",
            component=component,
            variable=name,
            near=elements[:1],
        )
    near = difflib.get_close_matches(name, variables, n=3, cutoff=0.5)
    suggestion = f"; did you mean {' or '.join(near)}?" if near else "."
    raise CommandError(
        f"{component} has no variable '{name}'{suggestion}", component=component, variable=name, near=near
    )


def explain_fixed(interface: Interface, name: str) -> str | None:
    """Return why a variable accepts no start value, such as `it is computed by the FMU`; None if it does.

    Args:
        interface: The model description.
        name: The name of the variable.
    """
    if interface.is_settable(name):
        return None
    variable = interface.variables[name]
    if variable.type in (CLOCK, BINARY):
        return {CLOCK: "it is a clock", BINARY: "it is Binary"}[str(variable.type)]
    if variable.variability == "constant":
        return "it is a constant of the FMU"
    if variable.causality == "independent":
        return "it is the independent variable, the time"
    return "it is computed by the FMU"


def suggest_settable(component: str, interface: Interface, name: str) -> str:
    """Return the end of an error message on a fixed variable: others of that name that can be set, if any."""
    near = [n for n in interface.variables if n.endswith(f".{name}") and interface.is_settable(n)][:3]
    return f"; did you mean {' or '.join(f'{component}.{n}' for n in near)}?" if near else "."


def convert_start_value(component: str, interface: Interface, variable: ModelVariable, value: Any) -> Any:
    """Convert a value to the type of a variable, and check its range.

    Args:
        component: The name of the component, for error messages.
        interface: Its model description.
        variable: The variable.
        value: The value.

    Raises:
        CommandError: If the variable does not accept the value.
    """
    name = f"{component}.{variable.name}"
    if (reason := explain_fixed(interface, str(variable.name))) is not None:
        near = suggest_settable(component, interface, str(variable.name))
        raise CommandError(f"{name} cannot be set: {reason}{near}")
    if variable.type == "String":
        return str(value)
    if variable.type == "Enumeration":
        return _convert_enumeration(name, variable, value)
    if variable.type == "Boolean":
        booleans = {"true": True, "1": True, "false": False, "0": False}
        if str(value).lower() not in booleans:
            raise CommandError(f"{name} = {value} is not a Boolean; write true or false.")
        return booleans[str(value).lower()]
    try:
        if variable.type != "Real" and isinstance(value, float) and not value.is_integer():
            raise ValueError(value)
        number = float(value) if variable.type == "Real" else int(value)
    except (ValueError, OverflowError) as error:
        kind = "number" if variable.type == "Real" else "whole number"
        raise CommandError(f"{name} = {value} is not a {kind}.") from error
    unit = f" {variable.unit}" if variable.unit else ""
    low, high = declared_range(variable)
    if low > high:
        raise CommandError(
            f"{name} cannot be set: the FMU declares the minimum {in_digits(low)}{unit}, above its maximum "
            f"of {in_digits(high)}{unit}.",
            variable=name,
        )
    if not (low <= number <= high and np.isfinite(number)):
        limits = [f"at least {in_digits(low)}"] if low > -np.inf else []
        limits += [f"at most {in_digits(high)}"] if high < np.inf else []
        right = " and ".join(limits) or "a finite number"
        raise CommandError(
            f"{name} = {in_digits(number)}{unit} is out of range: it must be {right}{unit}.",
            variable=name,
            value=number,
            minimum=low,
            maximum=high,
        )
    return number


def format_value(variable: ModelVariable, value: Any) -> Any:
    """Return a value of a variable as users write it: the name of an item of an enumeration."""
    names = {number: name for name, number in _list_items(variable).items()}
    return names.get(value, value) if variable.type == "Enumeration" else value


def _convert_enumeration(name: str, variable: ModelVariable, value: Any) -> int:
    """Return the number of an item from its name or number. Raise CommandError for any other value."""
    items = _list_items(variable)
    if str(value) in items:
        return items[str(value)]
    text = str(int(value)) if isinstance(value, float) and value.is_integer() else str(value)
    if text in {str(v) for v in items.values()}:
        return int(text)
    options = ", ".join(f"{item} ({number})" for item, number in items.items())
    raise CommandError(f"{name} = {value} is not one of {options}.")


def _list_items(variable: ModelVariable) -> dict[str, int]:
    """Return the items of an enumeration by name."""
    declared = variable.declaredType.items if variable.declaredType is not None else []
    return {str(item.name): int(str(item.value)) for item in declared or []}


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
