"""The reserves of current and voltage that controllers keep, and how to set the same for all."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from ...base.errors import CommandError
from ...base.values import convert_value
from ...system.model import Value
from ...system.names import Names
from ..execution.worker_payload import Preparation

CURRENT, VOLTAGE = "limit.i_reserve", "limit.u_reserve"
"""Parameters of a controller: reserves as parts of its limits of current and voltage."""

_TRUTHS = {"false": 0.0, "true": 1.0}


class Reserves(NamedTuple):
    """Reserves as parts of the limits of current and voltage; None for a quantity that is not limited."""

    current: float | None
    voltage: float | None

    def __str__(self) -> str:
        return " and ".join("no limit" if part is None else f"{100.0 * part:.3g} %" for part in self)


def parse_reserves(reserves: Sequence[float] | None) -> Reserves | None:
    """Return reserves of current and voltage; raise CommandError for invalid ones."""
    if reserves is None:
        return None
    found = convert_value(list(reserves), Sequence[float], "the reserves")
    if len(found) != 2 or not all(0.0 <= part <= 0.9 for part in found):
        raise CommandError(
            f"the reserves are {reserves!r}; they must be two parts from 0 to 0.9, of current and voltage, "
            "such as 0.02,0.2."
        )
    return Reserves(*found)


def reserve_values(prepared: Preparation, reserves: Reserves) -> dict[str, Value]:
    """Return the start values, by full name, that set these reserves in all controllers of a system."""
    both = {CURRENT: reserves.current, VOLTAGE: reserves.voltage}
    return {
        f"{controller}.{name}": float(part)
        for controller in _controllers(prepared)
        for name, part in both.items()
        if name in prepared.interfaces[controller].variables and part is not None
    }


def describe_reserves(prepared: Preparation, values: Mapping[str, Value]) -> str:
    """Return the reserves of the controllers of a system as text; `values` has start values of the run."""
    found = [_of(controller, prepared, values) for controller in _controllers(prepared)]
    return ", ".join(dict.fromkeys("not stated" if one is None else str(one) for one in found))


def _controllers(prepared: Preparation) -> list[str]:
    return [c.name for c in prepared.system.components if c.name.rpartition(".")[2] == "controller"]


def read_start_values(
    component: str, prepared: Preparation, values: Mapping[str, Value]
) -> Callable[[str], float | None]:
    """Return a function that returns a start value of a component by name; None if it is not a number.

    Args:
        component: The name of the component.
        prepared: The system.
        values: Start values of the run by full name; they override those of the system.
    """
    variables, names = prepared.interfaces[component].variables, Names(prepared.system, prepared.interfaces)

    def value(name: str) -> float | None:
        if name not in variables:
            return None
        full, start = f"{component}.{name}", str(variables[name].start).lower()
        if full in values:
            return float(values[full])
        number = names.find(full).start_number
        return _TRUTHS.get(start) if number is None else number

    return value


def _of(controller: str, prepared: Preparation, values: Mapping[str, Value]) -> Reserves | None:
    variables = prepared.interfaces[controller].variables
    value = read_start_values(controller, prepared, values)
    current, voltage = value(CURRENT), value(VOLTAGE)
    if current is None or voltage is None:
        return None
    limits = value("limit_current") != 0.0  # only RSBA has this switch; the other controllers always limit
    counts = "limit_current" not in variables or value("weaken_field") != 0.0
    return Reserves(current if limits else None, voltage if limits and counts else None)
