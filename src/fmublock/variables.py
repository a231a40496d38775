"""The variables of a block, declared as class attributes beside the equations."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from .units import per_second


class Variable:
    """What every variable of a block has.

    `start` is the value before anybody sets another; for a state it may be a `Parameter` of
    the same block, whose value is then taken when initialization ends. Its type is the
    variable's: float is Real, int Integer, bool Boolean, an `IntEnum` member Enumeration.
    `unit` is written as in Modelica ("N.m/rad", "m/s2"). `name` is the FMI name, the
    attribute's own unless given. `size` makes an array: start may then be a sequence, the
    equations see a list, and the FMI names are name[1] to name[size]. `terminal` bundles inputs
    and outputs that are connected together ("drive"); where the partner has another name for the
    variable, that follows after a dot ("sensor.x_measured").
    """

    def __init__(
        self,
        start: Any = 0.0,
        *,
        unit: str | None = None,
        description: str = "",
        name: str | None = None,
        size: int | None = None,
        minimum: float | None = None,
        maximum: float | None = None,
        nominal: float | None = None,
        terminal: str | None = None,
    ) -> None:
        self.start = start
        self.unit = unit
        self.description = description
        self.name = name
        self.size = size
        self.minimum = minimum
        self.maximum = maximum
        self.nominal = nominal
        self.terminal = terminal
        self.attribute = ""
        if isinstance(start, IntEnum):
            self.minimum, self.maximum = min(type(start)), max(type(start))
        if unit is not None and self.fmi_type != "Real":
            raise TypeError(
                f"a variable with the unit '{unit}' is Real: write its start value {start!r} as a float"
            )

    def __set_name__(self, owner: type, attribute: str) -> None:
        self.attribute = attribute
        if self.name is None:
            self.name = attribute

    @property
    def start_parameter(self) -> "Parameter | None":
        """The parameter that the start value is taken from, if it is not a value itself."""
        return self.start if isinstance(self.start, Parameter) else None

    @property
    def range(self) -> tuple[float, float]:
        """Lowest and highest value allowed, infinite where none is declared."""
        low = -math.inf if self.minimum is None else self.minimum
        return low, math.inf if self.maximum is None else self.maximum

    @property
    def fmi_type(self) -> str:
        """Real, Integer, Boolean or Enumeration, by the start value's type."""
        sample = self.start
        if isinstance(sample, Parameter):
            return "Real"
        if isinstance(sample, Sequence):
            sample = sample[0]
        if isinstance(sample, bool):
            return "Boolean"
        if isinstance(sample, IntEnum):
            return "Enumeration"
        return "Integer" if isinstance(sample, int) else "Real"

    @property
    def enumeration(self) -> type[IntEnum] | None:
        """The enumeration class of an Enumeration variable."""
        return type(self.start) if isinstance(self.start, IntEnum) else None

    def scalars(self) -> "list[ScalarVariable]":
        """The variable itself, or the elements of an array, in order."""
        assert self.name is not None
        if self.size is None:
            return [ScalarVariable(self, None, self.name, self._scalar_start(None))]
        return [
            ScalarVariable(self, i, f"{self.name}[{i + 1}]", self._scalar_start(i)) for i in range(self.size)
        ]

    def _scalar_start(self, index: int | None) -> float:
        parameter = self.start_parameter
        start = parameter.start if parameter is not None else self.start
        if index is not None and isinstance(start, Sequence):
            start = start[index]
        return float(start)


class Input(Variable):
    """A quantity that the block's surroundings set; held over a communication step."""


class Parameter(Variable):
    """A quantity fixed during a run, settable before initialization ends."""


class State(Variable):
    """A continuous state, integrated inside the communication step; also an output."""


class Derivative(Variable):
    """The time derivative of a continuous state; declared by nobody, offered by native FMUs."""

    @classmethod
    def of(cls, state: "ScalarVariable") -> "ScalarVariable":
        """The derivative of one scalar state, named der(...) with the unit per second."""
        unit = state.variable.unit
        name = f"der({state.name})"
        description = f"Time derivative of {state.name}"
        variable = cls(unit=None if unit is None else per_second(unit), description=description, name=name)
        return ScalarVariable(variable, None, name, 0.0)


class DiscreteState(Variable):
    """A state that changes once per communication step, at its end (noise, sample and hold)."""


class Output(Variable):
    """A quantity computed by `Block.outputs`, frozen between communication points."""


@dataclass(frozen=True)
class ScalarVariable:
    """One scalar FMI variable: a variable of a block, or one element of an array variable.

    `index` counts from 0, `name` is the FMI name (elements count from 1), `start` is the value
    as a float (Booleans 0 or 1, enumerations their number).
    """

    variable: Variable
    index: int | None
    name: str
    start: float
