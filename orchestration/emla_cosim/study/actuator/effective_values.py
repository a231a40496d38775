"""Effective start values of a built-in system, with the overrides of the options."""

from collections.abc import Mapping

from ...base.errors import CommandError
from ...base.patterns import matches_pattern
from ...base.quantities import parse_quantity
from ...run.options import Options
from ...system.model import System, Value


def get_number(system: System, options: Options, component: str, variable: str) -> float | None:
    """Return a start value in the unit of its model; None if it is unknown before the run."""
    found = next((c for c in system.components if c.name == component), None)
    if found is None or not is_own(component, options):
        return None
    return value_of(f"{component}.{variable}", found.parameters.get(variable), options.set)


def value_of(name: str, value: Value | None, overrides: Mapping[str, Value]) -> float | None:
    """Return a start value as a number in the unit of its model; None if it is unknown before the run.

    Args:
        name: The full name of the variable.
        value: The value in the system: a number, a text with a unit, or None.
        overrides: Values by name or pattern. Names win over patterns, later patterns over earlier ones.
    """
    for pattern, given in overrides.items():
        if matches_pattern(name, pattern):
            value = given
    value = overrides.get(name, value)
    if isinstance(value, str):
        try:
            return parse_quantity(value, name).si_number
        except CommandError:
            return None  # a name of an enumeration, or a unit known only with the FMU
    return None if value is None else float(value)


def is_own(component: str, options: Options) -> bool:
    """Return whether a component's outputs follow from its start values: no FMU and no data replaces it.

    Data without names of signals drive the signals that their columns name.
    """
    from_data = any(
        not source.signals or any(name.startswith(f"{component}.") for name in source.signals)
        for source in options.input
    )
    return component not in options.replace and not from_data
