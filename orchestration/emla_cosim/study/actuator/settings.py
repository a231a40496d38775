"""Start values of a built-in system as they will be, with those that are given beside the scenario."""

from ...errors import CommandError
from ...options import Options
from ...patterns import fits
from ...quantities import quantity
from ...system.model import System


def number(system: System, options: Options, component: str, variable: str) -> float | None:
    """The start value of a variable in the unit of its model; None where it is not known before the run."""
    found = next((c for c in system.components if c.name == component), None)
    if found is None or not is_own(component, options):
        return None
    value = found.parameters.get(variable)
    for pattern, given in options.set.items():
        if fits(f"{component}.{variable}", pattern):
            value = given
    if isinstance(value, str):
        try:
            read = quantity(value, component)
        except CommandError:
            return None  # of an enumeration, or told later
        return read.number * (read.unit.factor if read.unit else 1.0)
    return None if value is None else float(value)


def numbers(system: System, options: Options, component: str, variable: str) -> list[float]:
    """The elements of an array, those that are known."""
    found = (number(system, options, component, f"{variable}[{i}]") for i in range(1, 33))
    return [value for value in found if value is not None]


def is_own(component: str, options: Options) -> bool:
    """Whether a component gives what its values say: no other FMU is in its place, and no data may be.

    Data without names of signals drive those that their columns are called after.
    """
    from_data = any(
        not source.signals or any(name.startswith(f"{component}.") for name in source.signals)
        for source in options.input
    )
    return component not in options.replace and not from_data
