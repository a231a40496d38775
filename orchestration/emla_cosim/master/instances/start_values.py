"""Start values of an instance: set them, and find those that the FMU did not take."""

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np
from fmpy.model_description import ModelVariable

from ...fmu.instance import FINE
from ...fmu.variables import TypedValue
from .typed_values import TypedValues

ROUNDING = 1e-14
"""Relative difference of two Reals that are equal, such as after a conversion of units within the FMU."""


class LostValue(NamedTuple):
    """A start value that the FMU does not have.

    Attributes:
        variable: The name of the variable.
        wanted: The value that was set.
        present: The value of the FMU; None if the FMU does not tell it.
    """

    variable: str
    wanted: Any
    present: Any


class StartValues:
    """Start values, of which numbers are set and read with one call per type.

    Args:
        functions: The FMI functions by their short names, such as `setReal`.
    """

    def __init__(self, functions: Mapping[str, Callable[..., int]]) -> None:
        self._functions = functions
        self._variables: list[ModelVariable] | None = None
        self.update([])

    def update(self, values: Iterable[TypedValue]) -> None:
        """Replace the values. No connection drives their variables."""
        self.all = list(values)
        variables = [variable for variable, _ in self.all]
        if variables != self._variables:  # most runs differ in values alone
            self._variables = variables
            self._order(variables)
        self._numbers = np.array([self.all[i][1] for i in self._numeric], dtype=np.float64)

    def _order(self, variables: list[ModelVariable]) -> None:
        texts = {i for i, v in enumerate(variables) if v.type == "String"}
        self._numeric = [i for i in range(len(variables)) if i not in texts]
        last = {v.name: i for i, v in enumerate(variables) if v.causality == "input" or v.initial == "exact"}
        self._kept_texts = [i for i in last.values() if i in texts]
        self._kept = [i for i in last.values() if i not in texts]
        place = {i: n for n, i in enumerate(self._numeric)}
        self._kept_numbers = np.array([place[i] for i in self._kept], dtype=np.intp)
        self._setters = TypedValues("set", [variables[i] for i in self._numeric], self._functions)
        self._getters = TypedValues("get", [variables[i] for i in self._kept], self._functions)

    def set_numbers(self, component: Any) -> int:
        """Set all values but Strings, and return the worst status."""
        return self._setters.set(component, self._numbers)

    def find_lost(self, component: Any, read: Callable[[ModelVariable], Any]) -> list[LostValue]:
        """Return the values that the FMU does not have.

        Only inputs, and variables that are `exact`, must keep their start values.

        Args:
            component: The fmi2Component.
            read: Returns the present value of one variable; None if the FMU does not tell it.
        """
        wanted, present = self._numbers[self._kept_numbers], np.empty(len(self._kept))
        if self._getters.get(component, present) in FINE:
            doubtful = [self._kept[k] for k in np.flatnonzero(wanted != present)]
        else:
            doubtful = self._kept
        values = [(*self.all[i], read(self.all[i][0])) for i in sorted([*doubtful, *self._kept_texts])]
        return [LostValue(str(v.name), *pair) for v, *pair in values if not _is_equal(*pair)]


def _is_equal(wanted: Any, present: Any) -> bool:
    if isinstance(present, float):
        return math.isclose(wanted, present, rel_tol=ROUNDING)
    return present == wanted
