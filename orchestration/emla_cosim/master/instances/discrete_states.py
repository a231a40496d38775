"""Update the discrete states of an FMU in event mode, for both kinds and both versions."""

import math
from typing import NamedTuple

from ...fmu.elements import is_version_3
from .fmu_instance import InstanceError
from .in_process_instance import InProcessInstance


class DiscreteUpdate(NamedTuple):
    """What an FMU says about one update of its discrete states.

    Attributes:
        needs_more: whether it needs another update.
        ends: whether it wants the run to end.
        has_new_nominals: whether the nominal values of its states have changed.
        next_event: time of its next time event in s; infinite without one.
    """

    needs_more: bool
    ends: bool
    has_new_nominals: bool
    next_event: float


def update_discrete_states(instance: InProcessInstance, time: float) -> DiscreteUpdate:
    """Update the discrete states once, at a time in s.

    Raises:
        InstanceError: The FMU fails, or its next event is at no number, which would compare as never.
    """
    at = f"{name_update(instance)} at t = {time:.9g} s"
    with instance.calling(at):
        needs_more, ends, has_new_nominals, _, has_next, following = instance.fmu.newDiscreteStates()
    update = DiscreteUpdate(needs_more, ends, has_new_nominals, following if has_next else math.inf)
    if math.isnan(update.next_event):
        raise InstanceError(instance.name, at, "nextEventTime = NaN", instance.messages())
    return update


def name_update(instance: InProcessInstance) -> str:
    """Return the name of the function that updates the discrete states of an FMU."""
    return "updateDiscreteStates" if is_version_3(instance.file.description) else "newDiscreteStates"
