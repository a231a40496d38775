"""Update the discrete states of an FMU in event mode, for both kinds and both versions."""

import math

from ...fmu.elements import is_version_3
from .event_stepping import DiscreteUpdate
from .fmu_instance import InstanceError
from .in_process_instance import InProcessInstance


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
