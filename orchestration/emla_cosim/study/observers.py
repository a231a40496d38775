"""Describe the observer of a joint by the rule that gives its gains."""

from collections.abc import Callable
from dataclasses import fields
from typing import Any

from emla_fmu import EmlaObserver, observer_gains
from emla_fmu.observer_gains import ObserverGains


def describe_observer(value: Callable[[str], float | int | bool | str | None]) -> str | None:
    """Return the rule of an observer's gains with its poles; None for an observer with other parameters.

    Args:
        value: Returns the start value of a parameter by its name in the FMU; None if there is no such number.
    """
    names = {p.attribute: p.name for p in EmlaObserver.layout().parameters}
    values: dict[str, Any] = {f.name: value(str(names[f.name])) for f in fields(ObserverGains)}
    return None if None in values.values() else observer_gains.describe(ObserverGains(**values))
