"""Map variables of several types to one vector: Booleans are 0 or 1, Enumerations their values."""

import ctypes
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from fmpy.model_description import ModelVariable
from numpy.typing import NDArray

from ...base.arrays import Vector
from ...fmu.instance import by_type


@dataclass(frozen=True)
class TypeGroup:
    """Elements of one type: their positions in the vector, and memory in the FMI type.

    `arguments` are those of the FMI function after the component: addresses, made once because that is slow.
    """

    call: str
    elements: NDArray[np.intp]
    references: NDArray[np.uint32]
    values: NDArray[Any]
    boolean: bool
    function: Callable[..., int]
    arguments: tuple[Any, ...]


class TypedValues:
    """Get or set variables with one FMI call per type; `access` is `get` or `set`."""

    def __init__(
        self, access: str, variables: Sequence[ModelVariable], functions: Mapping[str, Callable[..., int]]
    ) -> None:
        self.groups = list[TypeGroup]()
        for type_, elements in by_type(variables):
            references = np.array([variables[i].valueReference for i in elements], dtype=np.uint32)
            values = np.zeros(len(elements), dtype=np.float64 if type_ == "Real" else np.int32)
            self.groups.append(
                TypeGroup(
                    call=f"{access}{type_}",
                    elements=np.array(elements, dtype=np.intp),
                    references=references,
                    values=values,
                    boolean=type_ == "Boolean",
                    function=functions[f"{access}{type_}"],
                    arguments=(_pointer(references), len(references), _pointer(values)),
                )
            )

    def set(self, component: Any, vector: Vector) -> int:
        """Set all variables, rounded to the nearest value of their type, and return the worst status."""
        worst = 0
        for group in self.groups:
            values = vector[group.elements]
            exact = group.values.dtype == np.float64
            group.values[:] = (
                values if exact else np.rint(values) != 0.0 if group.boolean else np.rint(values)
            )
            worst = max(worst, group.function(component, *group.arguments), key=abs)
        return worst

    def get(self, component: Any, vector: Vector) -> int:
        """Get all variables and return the worst status."""
        worst = 0
        for group in self.groups:
            worst = max(worst, group.function(component, *group.arguments), key=abs)
            vector[group.elements] = group.values != 0 if group.boolean else group.values
        return worst


def _pointer(array: NDArray[Any]) -> Any:
    return array.ctypes.data_as(ctypes.c_void_p)
