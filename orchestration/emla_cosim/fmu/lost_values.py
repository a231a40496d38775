"""Start values that an FMU did not take: what was set, compared with what is read afterwards."""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from fmpy.fmi1 import FMICallException
from fmpy.model_description import ModelVariable

from .instance import by_type
from .variables import TypedValue

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


def find_lost_values(
    values: Sequence[TypedValue], read: Callable[[Sequence[ModelVariable]], list[Any]]
) -> list[LostValue]:
    """Return the start values that an FMU does not have.

    Only inputs, and variables that are `exact`, must keep their start values.

    Args:
        values: The start values that were set. No connection drives these variables.
        read: Returns the values of variables of one type; raises fmpy's exceptions.
    """
    kept = {v.name: (v, x) for v, x in values if v.causality == "input" or v.initial == "exact"}
    found, pairs = list[LostValue](), list(kept.values())
    for _, positions in by_type([variable for variable, _ in pairs]):
        variables = [pairs[i][0] for i in positions]
        try:
            presents = [_convert(v, x) for v, x in zip(variables, read(variables), strict=True)]
        except FMICallException:
            presents = [None] * len(variables)
        for i, present in zip(positions, presents, strict=True):
            variable, wanted = pairs[i]
            if not _is_equal(wanted, present):
                found.append(LostValue(str(variable.name), wanted, present))
    return found


def _convert(variable: ModelVariable, present: Any) -> Any:
    """Return a value that an FMU returned in the type of its variable; no text is an empty one."""
    if variable.type == "String":
        return (present or b"").decode(errors="replace")
    return bool(present) if variable.type == "Boolean" else present


def _is_equal(wanted: Any, present: Any) -> bool:
    if isinstance(present, float):
        return math.isclose(wanted, present, rel_tol=ROUNDING)
    return present == wanted
