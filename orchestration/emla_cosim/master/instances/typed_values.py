"""Map variables of several types to one vector: Booleans are 0 or 1, Enumerations their values."""

import ctypes
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from fmpy.model_description import ModelVariable
from numpy.typing import NDArray

from ...base.arrays import Vector
from ...fmu.elements import CLOCK, ElementLayout, ElementVariable, value_type
from ...fmu.instance import by_type
from ...stepper.layout import TRUTH_OF_FMI_2, TYPES


class ValueRangeError(ValueError):
    """A value does not fit into the type of its variable; the message says which."""


@dataclass(frozen=True)
class TypeGroup:
    """Elements of one type: their positions in the vector, and memory in the FMI type.

    `slots` are their positions in that memory, which holds whole arrays. `arguments` are those of the FMI
    function after the component: addresses, made once because that is slow.
    """

    call: str
    elements: NDArray[np.intp]
    references: NDArray[np.uint32]
    values: NDArray[Any]
    slots: NDArray[np.intp] | slice
    boolean: bool
    function: Callable[..., int]
    arguments: tuple[Any, ...]
    integers: Sequence[ModelVariable] = ()
    """The variables, if they are integers."""

    @property
    def limits(self) -> tuple[float, float]:
        """Return the smallest value that fits into the type, and the one after the largest."""
        limits = np.iinfo(self.values.dtype)
        # the largest 64-bit integer is not a double, but the number after it is
        return float(limits.min), float(limits.max) + 1.0

    def check(self, values: Vector) -> None:
        """Raise ValueRangeError if a rounded value does not fit into its type."""
        if self.integers:
            low, limit = self.limits
            is_out_of_range = ~((values >= low) & (values < limit))
            if is_out_of_range.any():
                i = int(np.argmax(is_out_of_range))
                variable = self.integers[i]
                kind = getattr(variable, "data_type", variable.type)
                raise ValueRangeError(f"{variable.name} is {kind} and cannot be {values[i]:.17g}")


class TypedValues:
    """Get or set variables with one FMI call per type, and one per array that is set.

    Args:
        access: `get` or `set`.
        variables: The variables of the vector.
        functions: The FMI functions by their short names.
        arrays: The memory of the arrays that are set, by value reference. All setters of an instance share
            it, because FMI sets whole arrays only.
        elements: The positions of the variables in the vector, by default in their order.
    """

    def __init__(
        self,
        access: str,
        variables: Sequence[ModelVariable],
        functions: Mapping[str, Callable[..., int]],
        arrays: dict[int, NDArray[Any]] | None = None,
        elements: NDArray[np.intp] | None = None,
    ) -> None:
        self.groups = list[TypeGroup]()
        elements = np.arange(len(variables)) if elements is None else elements
        for type_, members in _plan_calls(access, variables):
            first, layout = variables[members[0]], ElementLayout(variables[i] for i in members)
            references = np.array(layout.references, dtype=np.uint32)
            slots = np.array(layout.positions, dtype=np.intp)
            values = np.zeros(layout.size, dtype=value_type(first))
            is_integer = type_ != "Boolean" and values.dtype.kind in "iu"
            counts = (layout.size,) if isinstance(first, ElementVariable) else ()
            if access == "set" and isinstance(first, ElementVariable) and first.size > 1:
                reference, start_array = int(first.valueReference), allocate_array(first)
                values = start_array if arrays is None else arrays.setdefault(reference, start_array)
            self.groups.append(
                TypeGroup(
                    call=f"{access}{type_}",
                    elements=elements[members],
                    references=references,
                    values=values,
                    slots=slice(None) if np.array_equal(slots, np.arange(layout.size)) else slots,
                    boolean=type_ == "Boolean",
                    function=functions[f"{access}{type_}"],
                    arguments=(_get_pointer(references), len(references), _get_pointer(values), *counts),
                    integers=[variables[i] for i in members] if is_integer else (),
                )
            )

    def set(self, component: Any, vector: Vector) -> int:
        """Set all variables, rounded to the nearest value of their type, and return the worst status.

        Raises:
            ValueRangeError: A value does not fit into its type.
        """
        worst = 0
        for group in self.groups:
            values = vector[group.elements]
            if group.values.dtype.kind != "f":
                values = np.rint(values)
                group.check(values)
            group.values[group.slots] = values != 0.0 if group.boolean else values
            worst = max(worst, group.function(component, *group.arguments), key=_rank_status)
        return worst

    def check(self, vector: Vector) -> None:
        """Raise ValueRangeError if a value does not fit into its type."""
        for group in self.groups:
            group.check(np.rint(vector[group.elements]))

    def get(self, component: Any, vector: Vector) -> int:
        """Get all variables and return the worst status."""
        worst = 0
        for group in self.groups:
            worst = max(worst, group.function(component, *group.arguments), key=_rank_status)
            values = group.values[group.slots]
            vector[group.elements] = values != 0 if group.boolean else values
        return worst


def _rank_status(status: int) -> int:
    """Return the order of a status: one that is not in the standard, also -1, is worse than a warning."""
    return status if status >= 0 else 1 - status


def allocate_array(variable: ElementVariable) -> NDArray[Any]:
    """Return the memory of an array, with its start values."""
    return np.array(variable.array_start, dtype=value_type(variable))


def _plan_calls(access: str, variables: Sequence[ModelVariable]) -> Iterator[tuple[str, list[int]]]:
    """Yield the type and the positions for each FMI call: one per type, and one per array that is set.

    There is none for Clocks: they tick in event mode, and have no value between ticks.
    """
    for type_, elements in by_type(variables):
        arrays: dict[int | None, list[int]] = {}
        for i in elements if type_ != CLOCK else ():
            is_array = access == "set" and getattr(variables[i], "size", 1) > 1
            arrays.setdefault(variables[i].valueReference if is_array else None, []).append(i)
        for members in arrays.values():
            yield type_, members


def _get_pointer(array: NDArray[Any]) -> Any:
    return array.ctypes.data_as(ctypes.c_void_p)


def fill_typed_call(
    record: Any, group: TypeGroup, function: int, keep: Callable[[Any], int], first: int = 0
) -> None:
    """Fill in function, arguments and values of a CALL record.

    Args:
        record: The record.
        group: What the call exchanges.
        function: Address of the FMI function; 0 only copies numbers from the memory of the group.
        keep: Keeps an array as long as the record, and returns its address.
        first: Where the vector of the group begins in the one of the call.
    """
    slots = np.arange(len(group.values)) if isinstance(group.slots, slice) else group.slots
    record["function"] = function
    record["references"], record["reference_count"] = keep(group.references), len(group.references)
    record["values"], record["value_count"] = keep(group.values), len(group.values)
    record["items"] = keep((group.elements + first).astype(np.int32))
    record["places"], record["item_count"] = keep(slots.astype(np.int32)), len(group.elements)
    is_truth = group.boolean and group.values.dtype.name != "bool"
    record["type"] = TRUTH_OF_FMI_2 if is_truth else TYPES.index(group.values.dtype.name)
