"""Start values of an instance: set them, and find those that the FMU changed."""

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from fmpy.model_description import ModelVariable
from numpy.typing import NDArray

from ...base.arrays import Vector
from ...fmu.instance import FINE
from ...fmu.variables import TypedValue
from .typed_values import TypedValues

ROUNDING = 1e-14
"""Relative difference of two Reals that are equal, such as after a conversion of units within the FMU."""


class RejectedValue(NamedTuple):
    """A start value that the FMU does not have.

    Attributes:
        variable: The name of the variable.
        expected: The value that was set.
        present: The value of the FMU; None if it cannot be read.
    """

    variable: str
    expected: Any
    present: Any


class StartValues:
    """The start values of an instance.

    Only inputs, and variables that are `exact`, must keep them. Numbers are set one by one, because after an
    error no further call shows which one was rejected. They are read back with one call per type, except for
    clocked ones, which cannot be read then.

    Args:
        functions: The FMI functions by their short names, such as `setReal`.
        arrays: The memory of the arrays that are set; see `TypedValues`.
    """

    def __init__(
        self, functions: Mapping[str, Callable[..., int]], arrays: dict[int, NDArray[Any]] | None = None
    ) -> None:
        self._functions, self._arrays = functions, arrays
        self._variables: list[ModelVariable] | None = None
        self.update([])

    def update(self, values: Iterable[TypedValue]) -> None:
        """Replace the values. No connection drives their variables."""
        self.all = list(values)
        variables = [variable for variable, _ in self.all]
        if variables == self._variables:  # most runs differ in values alone
            return
        self._variables = variables
        self.texts = [i for i, v in enumerate(variables) if v.type == "String"]
        """Positions of the Strings."""
        self._setters = [
            (i, TypedValues("set", [v], self._functions, self._arrays).groups[0])
            for i, v in enumerate(variables)
            if v.type != "String"
        ]
        last = {
            v.name: i
            for i, v in enumerate(variables)
            if (v.causality == "input" or v.initial == "exact") and not v.clocks
        }
        self._exact_texts = [i for i in last.values() if variables[i].type == "String"]
        self._numbers = [i for i in last.values() if variables[i].type != "String"]
        self._getters = TypedValues("get", [variables[i] for i in self._numbers], self._functions)

    def set_numbers(self, component: Any) -> tuple[TypedValue, int] | None:
        """Set all values but Strings; return the first one that the FMU rejects, with its status."""
        for i, setter in self._setters:
            if getattr(self.all[i][0], "is_resized", False):  # its other elements have no start values
                setter.values[setter.slots] = self.all[i][1]
        for i, setter in self._setters:
            setter.values[setter.slots] = self.all[i][1]
            if (status := setter.function(component, *setter.arguments)) not in FINE:
                return self.all[i], status
        return None

    def read_numbers(self, component: Any) -> tuple[int, Vector]:
        """Return the worst status, and the present numbers."""
        present = np.empty(len(self._numbers))
        return self._getters.get(component, present), present

    def find_rejected(
        self, present: Vector | None, read: Callable[[ModelVariable], Any]
    ) -> list[RejectedValue]:
        """Return the values that the FMU does not have.

        Args:
            present: The numbers from `read_numbers`; None if they could not be read.
            read: Returns the present value of one variable; None if it cannot be read.
        """
        candidates = self._numbers
        if present is not None:
            expected = np.array([self.all[i][1] for i in self._numbers], dtype=np.float64)
            candidates = [self._numbers[k] for k in np.flatnonzero(expected != present)]
        values = [(*self.all[i], read(self.all[i][0])) for i in sorted([*candidates, *self._exact_texts])]
        return [RejectedValue(str(v.name), *pair) for v, *pair in values if not _is_equal(*pair)]


def _is_equal(expected: Any, present: Any) -> bool:
    if isinstance(present, float):
        return math.isclose(expected, present, rel_tol=ROUNDING)
    return present == expected
