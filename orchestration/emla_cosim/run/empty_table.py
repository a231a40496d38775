"""Describe a run that records no signal."""

from collections.abc import Iterable

from ..base.errors import join_names
from ..master.observer import ObservedVariable

_NAMED = 3
"""Most variables that the remark names."""

_ORDER = ("output", "local", "calculatedParameter", "input", "parameter")
"""Causalities of variables, the most useful to record first."""


def describe_empty_table(others: Iterable[ObservedVariable]) -> list[str]:
    """Return a remark on a table with `time` alone.

    Args:
        others: Variables that the option `signals` can name.
    """
    said = "No signal was recorded, only `time`, because no FMU has an output of a number"
    found = sorted(others, key=_rank)[:_NAMED]
    if not found:
        return [f"{said} or any other variable."]
    return [
        f"{said}. Set --signals to record other variables, such as {join_names([x.name for x in found])}."
    ]


def _rank(one: ObservedVariable) -> tuple[int, bool]:
    """Return the place of a variable among examples: derivatives come last within their causality."""
    causality = str(one.variable.causality)
    place = _ORDER.index(causality) if causality in _ORDER else len(_ORDER)
    return place, one.name.partition(".")[2].startswith("der(")
