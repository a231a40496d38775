"""The variables of a component as rows, with start values and connections."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fmpy.model_description import ModelVariable

from ..base.units import IDENTITY
from ..fmu.interface import Interface
from ..fmu.variables import convert_start_values
from ..system.model import Alias, Component
from ..system.resolution import convert_to_fmu_terms
from .info_parts import VariableInfo

End = tuple[str, str]
"""Component and the FMU's name of a variable, as in connections."""


@dataclass(frozen=True)
class ConnectionIndex:
    """Sources of inputs and targets of outputs."""

    drivers: Mapping[End, End]
    readers: Mapping[End, Sequence[End]]
    names: Mapping[End, str]
    """Names in the system of variables that have another name in their FMU."""

    def name(self, end: End) -> str:
        """Return the full name of a variable."""
        return self.names.get(end, f"{end[0]}.{end[1]}")


def list_variables(
    component: Component, interface: Interface, wires: ConnectionIndex, runnable: bool = True
) -> list[VariableInfo]:
    """Return a row for each variable of a component, in the order of its FMU.

    Args:
        component: The component.
        interface: The model description of its FMU.
        wires: The connections.
        runnable: Whether the FMU can run; no variable of another one can be set.

    Raises:
        CommandError: If a start value cannot be set.
    """
    given = convert_to_fmu_terms(component).parameters
    values = {v.name: x for v, x in convert_start_values(component.name, interface, given)}
    known = component.by_fmu_name
    return [
        _row((component.name, name), variable, interface, wires, known.get(name), values.get(name), runnable)
        for name, variable in interface.variables.items()
    ]


def _row(
    end: End,
    variable: ModelVariable,
    interface: Interface,
    wires: ConnectionIndex,
    known: tuple[str, Alias] | None,
    value: Any,
    runnable: bool,
) -> VariableInfo:
    """Return a row in the names and units of the system; `value` is its start value, in the FMU's unit."""
    component, name = end
    unit, back = interface.unit(name), IDENTITY
    limits = _limit(variable, "min"), _limit(variable, "max")
    if known is not None:
        name, alias = known
        unit, back = alias.unit or unit, alias.transformation.inverse()
        low, high = (None if x is None else back(x) for x in limits)
        limits = (high, low) if back.factor < 0.0 else (low, high)
    literals, driver = interface.signal_type(end[1]).items, wires.drivers.get(end)
    start, default = (
        literals.get(x, x) if literals else back(x) if isinstance(x, float) and back != IDENTITY else x
        for x in (value, _default(variable))
    )
    is_enumeration = variable.type == "Enumeration"
    clocks: Any = variable.clocks or ()  # fmpy replaces value references by variables
    return VariableInfo(
        name=f"{component}.{name}",
        component=component,
        fmu_name=end[1],
        causality=str(variable.causality),
        variability=str(variable.variability),
        type=str(variable.type),
        unit=None if unit is None else unit.name,
        start=default if value is None else start,
        default=default,
        minimum=limits[0],
        maximum=limits[1],
        choices=tuple(literals.values()),
        description=" ".join(str(variable.description or "").split()),
        driven_by=None if driver is None else wires.name(driver),
        read_by=tuple(wires.name(reader) for reader in wires.readers.get(end, ())),
        settable=runnable and driver is None and interface.is_settable(end[1]),
        data_type=str((not is_enumeration and getattr(variable, "data_type", "")) or variable.type),
        dimensions=tuple(variable.shape or ()),
        clocks=tuple(str(clock.name) for clock in clocks),
        interval_variability=str(variable.intervalVariability or ""),
    )


def _default(variable: ModelVariable) -> Any:
    """Return the FMU's own start value as its type, or as text if it is invalid."""
    text = variable.start
    if text is None:
        return None
    try:
        if variable.type in ("Real", "Float64", "Float32"):
            return float(text)
        if variable.type in ("Integer", "Enumeration") or "Int" in str(variable.type):
            return int(text)
    except ValueError:  # for example an array
        return str(text)
    return str(text) in ("true", "1") if variable.type == "Boolean" else str(text)


def _limit(variable: ModelVariable, name: str) -> float | None:
    """Return the lowest or highest value of a number, or None."""
    text = getattr(variable, name)
    if text is None and variable.declaredType is not None:
        text = getattr(variable.declaredType, name, None)
    if text is None or variable.type == "Enumeration":
        return None
    try:
        number = float(text)
    except ValueError:
        return None
    return number if math.isfinite(number) else None
