"""FMI 3.0: the types in the names of its functions, and what a step says. This needs no fmpy."""

from collections.abc import Callable
from typing import Any

import numpy as np

from ..base.arrays import Vector

FLOATS = ("Float64", "Float32")
INTEGERS = ("Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64")
NUMBER_TYPES = (*FLOATS, *INTEGERS)

DISCARD, ERROR = 2, 3


def judge_step(status: int, needs_event: bool, terminates: bool, is_early: bool) -> int:
    """Return the status of a step with what else it says.

    A status other than OK and warning stays. Otherwise it is DISCARD if the FMU wants the run to end, and
    ERROR if the FMU needs event mode or returned early.

    Compiled code uses it, too.
    """
    if status > 1 or status < 0:
        return status
    if terminates:
        return DISCARD
    return ERROR if needs_event or is_early else status


class StepEnd:
    """What `fmi3DoStep` says beside its status about the last step: three flags and a time.

    `address` is that of the flags; the time is `TIME` bytes later.
    """

    TIME = 8

    def __init__(self) -> None:
        self.use(np.zeros(2))

    def use(self, buffer: Vector) -> int:
        """Use this memory of two doubles, and return its address."""
        self._flags, self._time = buffer.view(np.bool_)[:3], buffer[1:]
        self.address = address = buffer.ctypes.data
        self._arguments = (address, address + 1, address + 2, address + self.TIME)
        return address

    @property
    def terminates(self) -> bool:
        """Whether the FMU wants the run to end."""
        return bool(self._flags[1])

    def call(self, function: Callable[..., int], component: Any, *step: Any) -> int:
        """Do a step and return its status as `judge_step` does."""
        self._flags[:] = False
        return judge_step(function(component, *step, *self._arguments), *self._flags.tolist())

    @property
    def complaint(self) -> str:
        """What an instance without event mode and early return did although it must not; empty if nothing."""
        if self._flags[2]:
            return f"fmi3DoStep returned early at t = {self._time[0]:.9g} s, which was not allowed."
        return "fmi3DoStep asked for event mode, which is not used." if self._flags[0] else ""
