"""The variables of a block, declared as class attributes."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum, IntEnum
from itertools import product
from typing import Any

from .symbols import symbol_of


class Access(Enum):
    """What the user of an FMU can do with a parameter; the values are the letters of the C shim."""

    SETTABLE = "S"
    FIXED = "F"
    HIDDEN = "H"

    @property
    def word(self) -> str:
        """The participle: fixed, hidden."""
        return self.name.lower()


class Variable:
    """Base class of the variables of a block.

    Args:
        start: start value; its type is that of the variable: float is Real, int Integer, bool Boolean, a
            member of an `IntEnum` Enumeration. A state can start from a `Parameter` of the block, whose value
            is used when initialization ends. For an array, one value for all elements, or a list of its
            shape.
        unit: unit as in Modelica, such as "N.m/rad" or "m/s2".
        description: one line on its meaning.
        symbol: symbol in equations, as LaTeX. Default: derived from the attribute.
        name: FMI name. Default: the name of the attribute. Elements are x[1], x[2], ... or M[1,1], M[1,2],
            ...
        shape: number of elements of a vector, or (rows, columns) of a matrix.
        minimum: smallest value allowed, in the unit.
        maximum: largest value allowed, in the unit.
        nominal: typical size, in the unit; positive.
        is_difference: whether it is a difference, such as a rise of temperature; then 180 degF are 100 K.
        terminal: name of the terminal that bundles inputs and outputs, such as "drive". If the partner has
            another name for the variable, it follows after a dot, such as "sensor.x_measured".
        limits: parameters with the lowest and the highest value of a state or an output, or one for both
            directions. An instance reports the first value beyond them, and continues.

    Raises:
        TypeError: the start value, the shape or the limits do not fit.
    """

    def __init__(
        self,
        start: Any = 0.0,
        *,
        unit: str | None = None,
        description: str = "",
        symbol: str | None = None,
        name: str | None = None,
        shape: int | tuple[int, ...] = (),
        minimum: float | None = None,
        maximum: float | None = None,
        nominal: float | None = None,
        is_difference: bool = False,
        terminal: str | None = None,
        limits: "Parameter | tuple[Parameter, Parameter] | None" = None,
    ) -> None:
        self.start = start.tolist() if hasattr(start, "tolist") else start  # an array of NumPy
        self.unit = unit
        self.description = description
        self._symbol = symbol
        self.name = name
        self.shape = shape if isinstance(shape, tuple) else (shape,)
        self.minimum = minimum
        self.maximum = maximum
        self.nominal = nominal
        self.is_difference = is_difference
        self.terminal = terminal
        self.limits = limits
        self.attribute = ""
        if isinstance(start, IntEnum):
            self.minimum, self.maximum = min(type(start)), max(type(start))
        if not all(isinstance(n, int) and n > 0 for n in self.shape):
            raise TypeError(f"the shape {shape!r} is neither a number of elements nor a tuple of them")
        if not all(math.isfinite(x) for x in self._starts()):
            raise TypeError(f"the start value {start!r} is not finite")
        if unit is not None and self.fmi_type != "Real":
            raise TypeError(
                f"a variable with the unit '{unit}' is Real: write its start value {start!r} as a float"
            )
        if isinstance(self, (Input, Parameter)) and limits is not None:
            raise TypeError("an input or a parameter has no limits, but a minimum and a maximum")
        shapes = (), self.shape
        if any(not isinstance(p, Parameter) or p.shape not in shapes for p in self.limit_parameters or ()):
            raise TypeError(
                f"the limits {limits!r} are neither one nor two scalar parameters, nor of its shape"
            )

    def __set_name__(self, owner: type, attribute: str) -> None:
        self.attribute = attribute
        if self.name is None:
            self.name = attribute

    @property
    def symbol(self) -> str:
        """LaTeX symbol in equations: as declared, or derived from the attribute; empty for a word."""
        return symbol_of(self.attribute, len(self.shape)) if self._symbol is None else self._symbol

    @property
    def has_computed_start(self) -> bool:
        """Whether a parameter or the start time determines the start value, so that it cannot be set."""
        return self.start_parameter is not None

    @property
    def start_parameter(self) -> "Parameter | None":
        """The parameter that gives the start value, if it is not a value itself."""
        return self.start if isinstance(self.start, Parameter) else None

    @property
    def limit_parameters(self) -> "tuple[Parameter, Parameter] | None":
        """The lower and the upper limit; the same parameter twice for plus and minus its value."""
        if self.limits is None:
            return None
        low, high = self.limits if isinstance(self.limits, tuple) else (self.limits, self.limits)
        return low, high

    @property
    def range(self) -> tuple[float, float]:
        """Lowest and highest value allowed; infinite if none is declared."""
        low = -math.inf if self.minimum is None else self.minimum
        return low, math.inf if self.maximum is None else self.maximum

    @property
    def fmi_type(self) -> str:
        """Real, Integer, Boolean or Enumeration, by the start value's type."""
        sample = self.start
        if isinstance(sample, Parameter):
            return "Real"
        while isinstance(sample, Sequence):
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
        """Return the variable itself, or the elements of an array, row by row."""
        assert self.name is not None
        places = list(product(*(range(n) for n in self.shape)))
        return [
            ScalarVariable(self, place, self._element_name(place), start)
            for place, start in zip(places, self._starts(), strict=True)
        ]

    def flat(self, value: Any) -> list[Any]:
        """Return the elements of a value, row by row. Raises ValueError for another shape."""
        return _flat(value, self.shape)

    def nested(self, elements: Sequence[Any]) -> Any:
        """Return the value that has these elements: the inverse of `flat`."""
        return _nested(list(elements), self.shape)

    def _element_name(self, place: tuple[int, ...]) -> str:
        return f"{self.name}[{','.join(str(i + 1) for i in place)}]" if place else str(self.name)

    def _starts(self) -> list[float]:
        """Return the start values of all elements."""
        parameter = self.start_parameter
        if parameter is not None:
            if parameter.shape not in ((), self.shape):
                given, own = _count(parameter.shape), _count(self.shape)
                raise TypeError(f"a start parameter of {given} does not fit a variable of {own}")
            starts = parameter._starts()
            return starts if parameter.shape else starts * math.prod(self.shape)
        try:
            many = isinstance(self.start, Sequence)
            starts = self.flat(self.start) if many else [self.start] * math.prod(self.shape)
        except ValueError:
            starts = [self.start]
        if not all(isinstance(x, (float, int)) for x in starts):
            raise TypeError(f"the start value {self.start!r} is not {_count(self.shape)}")
        return [float(x) for x in starts]


def _flat(value: Any, shape: tuple[int, ...]) -> list[Any]:
    """See `Variable.flat`."""
    length = len(value) if hasattr(value, "__len__") and not isinstance(value, str) else None
    if length != (shape[0] if shape else None):
        given = "one value" if length is None else f"a list of {length}"
        raise ValueError(f"{given} is not {_count(shape)}")
    return [x for part in value for x in _flat(part, shape[1:])] if shape else [value]


def _nested(elements: list[Any], shape: tuple[int, ...]) -> Any:
    """See `Variable.nested`."""
    if not shape:
        return elements[0]
    part = len(elements) // shape[0]
    return [_nested(elements[i * part : (i + 1) * part], shape[1:]) for i in range(shape[0])]


def _count(shape: tuple[int, ...]) -> str:
    """Return a shape in words: one value, 3 values, 3 x 3 values."""
    return f"{' x '.join(str(n) for n in shape)} values" if shape else "one value"


class Input(Variable):
    """A quantity that other components set; held over a communication step."""


class Parameter(Variable):
    """A quantity that is fixed during a run and can be set before initialization ends.

    `access` says what the user of an FMU can do with it; `Disclosure` restricts it.
    """

    access = Access.SETTABLE


class State(Variable):
    """A continuous state, integrated inside the communication step; also an output."""


class Derivative(Variable):
    """The time derivative of a continuous state; made for native FMUs, not declared in blocks."""

    @classmethod
    def of(cls, state: "ScalarVariable") -> "ScalarVariable":
        """Make the derivative of one scalar state, named der(...) with the unit per second."""
        unit = state.variable.unit
        name = f"der({state.name})"
        description = f"Time derivative of {state.name}"
        variable = cls(unit=None if unit is None else per_second(unit), description=description, name=name)
        return ScalarVariable(variable, (), name, 0.0)


class DiscreteState(Variable):
    """A state that changes once per communication step, at its end (noise, sample and hold)."""


class StartTime(DiscreteState):
    """A discrete state in s that starts at the time at which the run starts."""

    @property
    def has_computed_start(self) -> bool:
        """True."""
        return True


class Output(Variable):
    """A quantity computed by `Block.outputs`, frozen between communication points."""


@dataclass(frozen=True)
class ScalarVariable:
    """One scalar FMI variable: a variable of a block, or one element of an array variable.

    `index` is the element's place, counted from 0 in each dimension, and empty for a scalar. `name` is
    the FMI name, in which elements count from 1. `start` is the value as a float: Booleans are 0 or 1,
    enumerations their number.
    """

    variable: Variable
    index: tuple[int, ...]
    name: str
    start: float

    @property
    def range_fault(self) -> str | None:
        """What is wrong with its range, its nominal or its start value, as a predicate; None if nothing."""
        low, high = self.variable.range
        unit = f" {self.variable.unit}" if self.variable.unit else ""
        if not low <= high:
            return f"has the minimum {low:.12g}{unit}, above its maximum of {high:.12g}{unit}"
        if self.variable.nominal is not None and not 0.0 < self.variable.nominal < math.inf:
            return f"has the nominal value {self.variable.nominal:.12g}{unit}; it must be positive and finite"
        if isinstance(self.variable, Output):  # computed from the start on
            return None
        if self.start < low:
            return f"starts at {self.start:.12g}{unit}, below its minimum of {low:.12g}{unit}"
        if self.start > high:
            return f"starts at {self.start:.12g}{unit}, above its maximum of {high:.12g}{unit}"
        return None

    @property
    def access(self) -> Access:
        """What the user of an FMU can do with a parameter; `SETTABLE` for other variables."""
        return self.variable.access if isinstance(self.variable, Parameter) else Access.SETTABLE


def per_second(name: str) -> str:
    """Return the unit of a time derivative: "m/s" for "m", "m/s2" for "m/s", "V/s" for "V"."""
    numerator, _, denominator = name.partition("/")
    terms = denominator.strip("()").split(".") if denominator else []
    powers = {term.rstrip("0123456789"): int(re.sub(r"\D", "", term) or 1) for term in terms}
    powers["s"] = powers.get("s", 0) + 1
    divisor = ".".join(term if power == 1 else f"{term}{power}" for term, power in powers.items())
    return f"{numerator}/{divisor}" if len(powers) == 1 else f"{numerator}/({divisor})"
