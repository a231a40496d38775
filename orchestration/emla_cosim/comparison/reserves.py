"""What controllers keep of current and voltage in reserve, and the same reserves for all of them."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ..base.errors import CommandError
from ..base.values import convert_value
from ..sweeps.factors import find_start_number
from ..sweeps.worker_payload import Preparation
from ..system.model import Value

CURRENT, VOLTAGE = "limit.i_reserve", "limit.u_reserve"
"""Parameters of a controller: parts of its limits of current and voltage."""

_TRUTHS = {"false": 0.0, "true": 1.0}


class Reserves(NamedTuple):
    """Parts of the limits of current and voltage that a controller keeps; None where it does not limit."""

    current: float | None
    voltage: float | None

    def __str__(self) -> str:
        return " and ".join("no limit" if part is None else f"{100.0 * part:.3g} %" for part in self)


def parse_reserves(reserves: Sequence[float] | None) -> Reserves | None:
    """Return reserves as parts of current and voltage; CommandError for what is none."""
    if reserves is None:
        return None
    found = convert_value(list(reserves), Sequence[float], "the reserves")
    if len(found) != 2 or not all(0.0 <= part <= 0.9 for part in found):
        raise CommandError(
            f"the reserves are {reserves!r}; they must be parts of current and voltage from 0 to 0.9, "
            "such as 0.02,0.2."
        )
    return Reserves(*found)


def reserve_values(prepared: Preparation, reserves: Reserves) -> dict[str, Value]:
    """Return the start values, by full name, that give all controllers of a system these reserves."""
    both = {CURRENT: reserves.current, VOLTAGE: reserves.voltage}
    return {
        f"{controller}.{name}": float(part)
        for controller in _controllers(prepared)
        for name, part in both.items()
        if name in prepared.interfaces[controller].variables and part is not None
    }


def describe_reserves(prepared: Preparation, values: Mapping[str, Value]) -> str:
    """Say what the controllers of a system keep in reserve; `values` has start values of the run."""
    found = [_of(controller, prepared, values) for controller in _controllers(prepared)]
    return ", ".join(dict.fromkeys("not stated" if one is None else str(one) for one in found))


def _controllers(prepared: Preparation) -> list[str]:
    return [c.name for c in prepared.system.components if c.name.rpartition(".")[2] == "controller"]


def _of(controller: str, prepared: Preparation, values: Mapping[str, Value]) -> Reserves | None:
    variables = prepared.interfaces[controller].variables

    def value(name: str) -> float | None:
        if name not in variables:
            return None
        full, start = f"{controller}.{name}", str(variables[name].start).lower()
        if full in values:
            return float(values[full])
        number = find_start_number(full, prepared.system, prepared.interfaces)
        return _TRUTHS.get(start) if number is None else number

    current, voltage = value(CURRENT), value(VOLTAGE)
    if current is None or voltage is None:
        return None
    limits = value("limit_current") != 0.0  # a switch of RSBA; the others always limit
    counts = "limit_current" not in variables or value("weaken_field") != 0.0
    return Reserves(current if limits else None, voltage if limits and counts else None)
