"""Get and set variables of FMI 3.0: arrays as a whole, with one call for each type."""

import ctypes
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from fmpy.model_description import ModelVariable

from emla_cosim.fmu.elements import ElementVariable, place_in_array
from emla_cosim.fmu.instance import by_type

Arrays = dict[int, list[Any]]
"""Values of arrays by value reference, in the order of their elements."""


class ElementLayout:
    """Where elements of arrays are in the values of one call.

    Attributes:
        references: Value references, each once.
        size: Number of values.
    """

    def __init__(self, variables: Iterable[ModelVariable]) -> None:
        begins: dict[int, int] = {}
        self.size = 0
        self._places: list[int] = []
        for variable in variables:
            if (reference := int(variable.valueReference)) not in begins:
                begins[reference] = self.size
                self.size += getattr(variable, "size", 1)
            self._places.append(begins[reference] + place_in_array(variable))
        self.references = list(begins)

    def pick(self, values: Sequence[Any]) -> list[Any]:
        """Return the values of the elements."""
        return [values[place] for place in self._places]

    def spread(self, values: Iterable[float]) -> list[float]:
        """Return all values, of which those of other elements are 0."""
        found = [0.0] * self.size
        for place, value in zip(self._places, values, strict=True):
            found[place] = value
        return found


class ElementDependency(NamedTuple):
    """A dependency of an element on an element of another variable, counted from 1; 0 means all of them."""

    element: int
    independent: int
    element_of_independent: int

    def has(self, unknown: ModelVariable, known: ModelVariable) -> bool:
        """Return whether it is one of an element on another one."""
        return (
            self.element in (0, place_in_array(unknown) + 1)
            and self.independent == int(known.valueReference)
            and self.element_of_independent in (0, place_in_array(known) + 1)
        )


def get_elements(fmu: Any, variables: Sequence[ModelVariable]) -> list[Any]:
    """Return the values of variables or elements of arrays; raise fmpy's exceptions."""
    found: list[Any] = [None] * len(variables)
    for kind, positions in by_type(variables):
        layout = ElementLayout(variables[i] for i in positions)
        if kind == "String":
            got = _strings(fmu, layout.references)
        elif kind == "Boolean":
            got = _booleans(fmu, layout)
        else:
            got = getattr(fmu, f"get{kind}")(layout.references, layout.size)
        for i, value in zip(positions, layout.pick(got), strict=True):
            found[i] = value
    return found


def _strings(fmu: Any, references: Sequence[int]) -> list[bytes | None]:
    """Return Strings as bytes, which need not be UTF-8; None for a NULL pointer."""
    pointers = (ctypes.c_char_p * len(references))()
    numbers = (ctypes.c_uint * len(references))(*references)
    fmu.fmi3GetString(fmu.component, numbers, len(references), pointers, len(references))
    return list(pointers)


def _booleans(fmu: Any, layout: ElementLayout) -> list[int]:
    """Return Booleans as numbers, which need not be 0 or 1."""
    found = (ctypes.c_uint8 * layout.size)()
    numbers = (ctypes.c_uint * len(layout.references))(*layout.references)
    place = ctypes.cast(found, ctypes.POINTER(ctypes.c_bool))
    fmu.fmi3GetBoolean(fmu.component, numbers, len(numbers), place, layout.size)
    return list(found)


def set_elements(fmu: Any, values: Sequence[tuple[ModelVariable, Any]], arrays: Arrays) -> None:
    """Set variables, of which each can be an element of an array; raise fmpy's exceptions.

    `arrays` has the other elements, and gets what is set. An array that it lacks has its start values.
    """
    for kind, positions in by_type([variable for variable, _ in values]):
        whole: Arrays = {}
        for i in positions:
            variable, value = values[i]
            reference, place = int(variable.valueReference), place_in_array(variable)
            if reference not in whole:
                whole[reference] = list(arrays.get(reference) or _start(variable, kind))
            whole[reference][place] = value
        flat = [value for elements in whole.values() for value in elements]
        getattr(fmu, f"set{kind}")(list(whole), flat)
        arrays.update(whole)


def _start(variable: ModelVariable, kind: str) -> list[Any]:
    """Return the start values of the array of an element."""
    if not isinstance(variable, ElementVariable) or not variable.array_start:
        return [None]
    to = float if kind.startswith("Float") else bool if kind == "Boolean" else int
    return [to(value) for value in variable.array_start]
