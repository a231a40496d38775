"""Slots for the states of FMUs that the stepper in C saves; its tables take longer to import."""

import ctypes
from collections.abc import Sequence

import numpy as np

from ...stepper.layout import SAVED_STATE, Events
from ..instances.fmu_instance import EntryPoints, FmuInstance


class SavedStates:
    """Slots for one state of each instance, with the memory of its events.

    Args:
        points: Addresses of the FMI functions, per instance.

    Attributes:
        records: The records that the functions in C get, one per instance.
        event_memory: The memory of their events.
    """

    def __init__(self, points: Sequence[EntryPoints]) -> None:
        self.records = np.zeros(len(points), SAVED_STATE)
        self._points = points
        self.event_memory = [
            np.zeros(Events.from_address(p.events).memory_size if p.events else 0) for p in points
        ]
        self.records["events"] = [m.ctypes.data for m in self.event_memory]

    def free(self, instances: Sequence[FmuInstance]) -> None:
        """Free the states; never raises."""
        for instance, points, state in zip(instances, self._points, self.records["state"], strict=True):
            if points.calls is not None:
                points.calls.close(instance)
            elif state:
                instance.forget(ctypes.c_void_p(int(state)))
        self.records["state"] = 0
