"""Start values of a built-in system as they will be, with those that are given beside the scenario."""

from collections.abc import Mapping

from ...base.errors import CommandError
from ...base.patterns import matches_pattern
from ...base.quantities import parse_quantity
from ...run.options import Options
from ...system.model import System, Value


def get_number(system: System, options: Options, component: str, variable: str) -> float | None:
    """The start value of a variable in the unit of its model; None where it is not known before the run."""
    found = next((c for c in system.components if c.name == component), None)
    if found is None or not is_own(component, options):
        return None
    return value_of(f"{component}.{variable}", found.parameters.get(variable), options.set)


def value_of(name: str, value: Value | None, overrides: Mapping[str, Value]) -> float | None:
    """Return a start value as a number in the unit of its model; None where nobody knows it before the run.

    `value` is what the system has: a number, a text with a unit, or None. `overrides` are values by name or
    pattern: a name wins over patterns, a later pattern over earlier ones.
    """
    for pattern, given in overrides.items():
        if matches_pattern(name, pattern):
            value = given
    value = overrides.get(name, value)
    if isinstance(value, str):
        try:
            read = parse_quantity(value, name)
        except CommandError:
            return None  # of an enumeration, or told later
        return read.in_unit(None if read.unit is None else read.unit.si, name)
    return None if value is None else float(value)


def is_own(component: str, options: Options) -> bool:
    """Whether a component gives what its values say: no other FMU is in its place, and no data may be.

    Data without names of signals drive those that their columns are called after.
    """
    from_data = any(
        not source.signals or any(name.startswith(f"{component}.") for name in source.signals)
        for source in options.input
    )
    return component not in options.replace and not from_data
