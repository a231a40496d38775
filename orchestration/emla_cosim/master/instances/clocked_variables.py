"""Clocked variables of an FMU: they can be set and read only while one of their clocks ticks."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from fmpy.model_description import ModelVariable
from numpy.typing import NDArray

from ...base.arrays import Vector
from ...fmu.clocks import CLOCK, clocks_of
from ...fmu.elements import BINARY
from .typed_values import TypedValues


def is_clocked(variable: ModelVariable) -> bool:
    """Return whether a variable belongs to clocks."""
    return bool(variable.clocks)


class ClockedVariables:
    """The numeric clocked variables of an FMU that are no inputs, with their values at the last tick.

    Args:
        variables: All variables of the FMU.
        functions: The FMI functions by their short names.
    """

    def __init__(
        self, variables: Mapping[str, ModelVariable], functions: Mapping[str, Callable[..., int]]
    ) -> None:
        self.variables = [
            v
            for v in variables.values()
            if is_clocked(v)
            and v.causality in ("output", "local")
            and v.type not in ("String", BINARY, CLOCK)
        ]
        self.values = np.full(len(self.variables), math.nan)
        self._places = {v.name: i for i, v in enumerate(self.variables)}
        self._functions = functions
        self._getters: dict[tuple[int, ...], tuple[NDArray[np.intp], TypedValues]] = {}

    def use_memory(self, memory: Vector) -> None:
        """Keep the values in this memory, shape (variables,)."""
        self.values = memory

    def places(self, variables: Sequence[ModelVariable]) -> NDArray[np.intp]:
        """Return the positions of variables among these; -1 for others."""
        return np.array([self._places.get(v.name, -1) for v in variables], dtype=np.intp)

    def read(self, component: Any, clocks: Sequence[int] | None) -> int:
        """Read the variables of ticking clocks, of all by default; return the worst status.

        Args:
            component: The instance.
            clocks: Value references of the clocks; None for all of them.
        """
        key = (-1,) if clocks is None else tuple(clocks)
        if key not in self._getters:
            places = [i for i, v in enumerate(self.variables) if clocks is None or belongs(v, clocks)]
            getter = TypedValues("get", [self.variables[i] for i in places], self._functions)
            self._getters[key] = np.array(places, dtype=np.intp), getter
        places, getter = self._getters[key]
        found = self.values[places]
        status = getter.get(component, found)
        self.values[places] = found
        return status


def belongs(variable: ModelVariable, clocks: Sequence[int]) -> bool:
    """Return whether a variable belongs to one of these clocks, by value reference."""
    return any(clock in clocks for clock in clocks_of(variable))
