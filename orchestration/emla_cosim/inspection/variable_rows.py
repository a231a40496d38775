"""The variables of a component as rows, with start values and connections."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from fmpy.model_description import ModelVariable

from ..base.units import IDENTITY, LinearTransformation
from ..fmu.interface import Interface
from ..fmu.variables import convert_start_values
from ..system.model import Alias, Component
from ..system.resolution import convert_to_fmu_terms
from .info_parts import Start, VariableInfo

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


class FmuVariable:
    """What an FMU says of a variable, the same for all components with that FMU."""

    def __init__(self, interface: Interface, variable: ModelVariable) -> None:
        self.name, self.variable = str(variable.name), variable
        self.literals = interface.signal_type(self.name).items
        self.default = _default(variable)
        self.limits = _limit(variable, "min"), _limit(variable, "max")
        self.unit = interface.unit(self.name)
        self.settable = interface.is_settable(self.name)
        self.data_type = str(getattr(variable, "data_type", "") or variable.type)
        if variable.type == "Enumeration":
            self.data_type = "Enumeration"
        clocks: Any = variable.clocks or ()  # fmpy replaces value references by variables
        self.clocks = tuple(str(clock.name) for clock in clocks)
        self.description = " ".join(str(variable.description or "").split())

    def shown(self, value: Any, back: LinearTransformation) -> Start | None:
        """Convert a value of the FMU to the unit of the system."""
        if self.literals:
            return self.literals.get(value, value)
        return back(value) if isinstance(value, float) and back != IDENTITY else value


def read_fmu_variables(interface: Interface) -> list[FmuVariable]:
    """Return what an FMU says of all its variables, in its order."""
    return [FmuVariable(interface, variable) for variable in interface.variables.values()]


@dataclass(frozen=True)
class VariableRows:
    """The rows of a component. If its FMU is not `runnable`, no variable can be set."""

    component: Component
    interface: Interface
    said: Sequence[FmuVariable]
    wires: ConnectionIndex
    runnable: bool = True

    def all(self) -> list[VariableInfo]:
        """Return a row for each variable, in the order of the FMU.

        Raises:
            CommandError: If a start value cannot be set.
        """
        given = convert_to_fmu_terms(self.component).parameters
        values = {v.name: x for v, x in convert_start_values(self.component.name, self.interface, given)}
        known = self.component.by_fmu_name
        return [self._row(said, known.get(said.name), values.get(said.name)) for said in self.said]

    def _row(self, said: FmuVariable, known: tuple[str, Alias] | None, value: Any) -> VariableInfo:
        end, back, limits = (self.component.name, said.name), IDENTITY, said.limits
        name, unit = said.name, said.unit
        if known is not None:
            name, alias = known
            unit, back = alias.unit or unit, alias.transformation.inverse()
            low, high = (None if x is None else back(x) for x in limits)
            limits = (high, low) if back.factor < 0.0 else (low, high)
        driver = self.wires.drivers.get(end)
        default = said.shown(said.default, back)
        return VariableInfo(
            name=f"{end[0]}.{name}",
            component=end[0],
            fmu_name=said.name,
            causality=str(said.variable.causality),
            variability=str(said.variable.variability),
            type=str(said.variable.type),
            unit=None if unit is None else unit.name,
            start=default if value is None else said.shown(value, back),
            default=default,
            minimum=limits[0],
            maximum=limits[1],
            choices=tuple(said.literals.values()),
            description=said.description,
            driven_by=None if driver is None else self.wires.name(driver),
            read_by=tuple(self.wires.name(reader) for reader in self.wires.readers.get(end, ())),
            settable=self.runnable and driver is None and said.settable,
            data_type=said.data_type,
            dimensions=tuple(said.variable.shape or ()),
            clocks=said.clocks,
            interval_variability=str(said.variable.intervalVariability or ""),
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
