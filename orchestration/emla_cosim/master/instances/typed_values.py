"""Map variables of several types to one vector: Booleans are 0 or 1, Enumerations their values."""

import ctypes
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from fmpy.model_description import ModelVariable
from numpy.typing import NDArray

from ...base.arrays import Vector
from ...fmu.elements import ElementVariable, value_type
from ...fmu.instance import by_type


@dataclass(frozen=True)
class TypeGroup:
    """Elements of one type: their positions in the vector, and memory in the FMI type.

    `places` are their positions in that memory, which holds whole arrays. `arguments` are those of the FMI
    function after the component: addresses, made once because that is slow.
    """

    call: str
    elements: NDArray[np.intp]
    references: NDArray[np.uint32]
    values: NDArray[Any]
    places: NDArray[np.intp] | slice
    boolean: bool
    function: Callable[..., int]
    arguments: tuple[Any, ...]


class TypedValues:
    """Get or set variables with one FMI call per type, and one per array that is set.

    Args:
        access: `get` or `set`.
        variables: The variables of the vector.
        functions: The FMI functions by their short names.
        arrays: The memory of the arrays that are set, by value reference. All setters of an instance share
            it, because FMI sets whole arrays only.
    """

    def __init__(
        self,
        access: str,
        variables: Sequence[ModelVariable],
        functions: Mapping[str, Callable[..., int]],
        arrays: dict[int, NDArray[Any]] | None = None,
    ) -> None:
        self.groups = list[TypeGroup]()
        for type_, elements in by_type(variables):
            for members in _by_call(access, variables, elements):
                first = variables[members[0]]
                references, places, size = _memory_of([variables[i] for i in members])
                values = np.zeros(size, dtype=value_type(first))
                counts = (size,) if isinstance(first, ElementVariable) else ()
                if access == "set" and isinstance(first, ElementVariable) and first.size > 1:
                    reference, memory = int(first.valueReference), start_memory(first)
                    values = memory if arrays is None else arrays.setdefault(reference, memory)
                self.groups.append(
                    TypeGroup(
                        call=f"{access}{type_}",
                        elements=np.array(members, dtype=np.intp),
                        references=references,
                        values=values,
                        places=slice(None) if np.array_equal(places, np.arange(size)) else places,
                        boolean=type_ == "Boolean",
                        function=functions[f"{access}{type_}"],
                        arguments=(_pointer(references), len(references), _pointer(values), *counts),
                    )
                )

    def set(self, component: Any, vector: Vector) -> int:
        """Set all variables, rounded to the nearest value of their type, and return the worst status."""
        worst = 0
        for group in self.groups:
            values = vector[group.elements]
            exact = group.values.dtype.kind == "f"
            group.values[group.places] = (
                values if exact else np.rint(values) != 0.0 if group.boolean else np.rint(values)
            )
            worst = max(worst, group.function(component, *group.arguments), key=abs)
        return worst

    def get(self, component: Any, vector: Vector) -> int:
        """Get all variables and return the worst status."""
        worst = 0
        for group in self.groups:
            worst = max(worst, group.function(component, *group.arguments), key=abs)
            values = group.values[group.places]
            vector[group.elements] = values != 0 if group.boolean else values
        return worst


def start_memory(variable: ElementVariable) -> NDArray[Any]:
    """Return the memory of an array, with its start values."""
    return np.array(variable.array_start, dtype=value_type(variable))


def _by_call(access: str, variables: Sequence[ModelVariable], elements: list[int]) -> list[list[int]]:
    """Return the positions for each FMI call: arrays are set one by one."""
    if access == "get":
        return [elements]
    arrays: dict[int | None, list[int]] = {}
    for i in elements:
        v = variables[i]
        arrays.setdefault(v.valueReference if getattr(v, "size", 1) > 1 else None, []).append(i)
    return list(arrays.values())


def _memory_of(
    variables: Sequence[ModelVariable],
) -> tuple[NDArray[np.uint32], NDArray[np.intp], int]:
    """Return value references, positions in the memory of a call, and the size of that memory."""
    begins, references, places, size = dict[int, int](), list[int](), list[int](), 0
    for v in variables:
        reference, whole = int(v.valueReference), isinstance(v, ElementVariable) and v.size > 1
        begin = begins.get(reference) if whole else None
        if begin is None:
            begin = begins[reference] = size
            references.append(reference)
            size += v.size if isinstance(v, ElementVariable) else 1
        places.append(begin + (v.place if isinstance(v, ElementVariable) else 0))
    return np.array(references, dtype=np.uint32), np.array(places, dtype=np.intp), size


def _pointer(array: NDArray[Any]) -> Any:
    return array.ctypes.data_as(ctypes.c_void_p)
