"""Elements of arrays of FMI 3.0: set as a whole, with one call for each type; dependencies of them."""

from collections.abc import Sequence
from typing import Any, NamedTuple

from fmpy.model_description import ModelVariable

from emla_cosim.fmu.elements import ElementVariable, position_in_array
from emla_cosim.fmu.instance import by_type

Arrays = dict[int, list[Any]]
"""Values of arrays by value reference, in the order of their elements."""


class ElementDependency(NamedTuple):
    """A dependency of an element on an element of another variable, counted from 1; 0 means all of them."""

    element: int
    independent: int
    element_of_independent: int

    def has(self, unknown: ModelVariable, known: ModelVariable) -> bool:
        """Return whether it is a dependency of `unknown` on `known`."""
        return (
            self.element in (0, position_in_array(unknown) + 1)
            and self.independent == int(known.valueReference)
            and self.element_of_independent in (0, position_in_array(known) + 1)
        )


def set_elements(fmu: Any, values: Sequence[tuple[ModelVariable, Any]], arrays: Arrays) -> None:
    """Set variables, of which each can be an element of an array; raise fmpy's exceptions.

    `arrays` has the other elements, and gets what is set. An array that it lacks has its start values.
    """
    for kind, positions in by_type([variable for variable, _ in values]):
        arrays_by_reference: Arrays = {}
        for i in positions:
            variable, value = values[i]
            reference, position = int(variable.valueReference), position_in_array(variable)
            if reference not in arrays_by_reference:
                arrays_by_reference[reference] = list(
                    arrays.get(reference) or _read_array_start(variable, kind)
                )
            arrays_by_reference[reference][position] = value
        flat = [value for elements in arrays_by_reference.values() for value in elements]
        getattr(fmu, f"set{kind}")(list(arrays_by_reference), flat)
        arrays.update(arrays_by_reference)


def _read_array_start(variable: ModelVariable, kind: str) -> list[Any]:
    """Return the start values of the array of an element; [None] for a scalar, or if there are none."""
    if not isinstance(variable, ElementVariable) or not variable.array_start:
        return [None]
    to = float if kind.startswith("Float") else bool if kind == "Boolean" else int
    return [to(value) for value in variable.array_start]
