"""Records of the stepper in C for calls that exchange values of one type."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ...stepper.layout import TRUTH_OF_FMI_2, TYPES
from .typed_values import TypeGroup


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
