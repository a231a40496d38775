"""The observers of compared joints, and sets of gains with which they are equal."""

from collections.abc import Mapping, Sequence
from typing import Any

from ...base.errors import CommandError
from ...study.controllers import choose_controller
from ...study.loading import load
from ...study.observers import describe_observer
from ...system.model import System, Value
from ..execution.worker_payload import Preparation
from .controller_variants import Choice, ControllerVariant
from .reserves import read_start_values


def list_observers(
    prepared: Preparation, joints: Sequence[str], values: Mapping[str, Value]
) -> dict[str, str]:
    """Return the observer of each joint as text; `values` has start values of the run by full name.

    The text is the rule of its gains with its poles, the name of its FMU if it has no such gains, or "none".
    """
    components = {c.name: c for c in prepared.system.components}
    observers = dict.fromkeys(joints, "none")
    for joint in joints:
        if component := components.get(f"{joint}.observer"):
            rule = describe_observer(read_start_values(component.name, prepared, values))
            observers[joint] = rule or str(component.fmu or component.model)
    return observers


def find_equal_gains(
    scenario: str, controllers: Sequence[Choice], options: Mapping[str, Any]
) -> list[ControllerVariant]:
    """Return a set of gains for each controller such that all use the same observers; empty if none exist."""
    by_observers: list[dict[tuple[str | None, ...], ControllerVariant]] = []
    for controller in controllers:
        sets = dict[tuple[str | None, ...], ControllerVariant]()
        for gains in choose_controller(controller, None).controller.gains:
            try:
                overrides: dict[str, Any] = {**options, "controller": controller, "gains": gains}
                system = load(scenario, **overrides).system
            except CommandError:
                continue  # a joint lacks this set
            sets.setdefault(_observers_of(system), ControllerVariant(controller, gains))
        by_observers.append(sets)
    first, *others = by_observers
    shared = next((key for key in first if all(key in sets for sets in others)), None)
    return [] if shared is None else [sets[shared] for sets in by_observers]


def _observers_of(system: System) -> tuple[str | None, ...]:
    """Return the rules of all observers of a system that is not prepared."""
    observers = [c.parameters for c in system.components if c.name.endswith(".observer")]
    return tuple(describe_observer(parameters.get) for parameters in observers)
