"""What FMUs say through the FMI logger, kept per instance."""

import ctypes
from collections import defaultdict, deque
from typing import Any

import fmpy
from fmpy import fmi2
from fmpy.logging import addLoggerProxy

LINES = 5
"""How many of its last lines are kept of each instance."""


class FmuLog:
    """The last warnings and errors of every instance, by its name.

    One log serves all instances of a process: fmpy's proxy, which formats the messages, knows a
    single logger.
    """

    def __init__(self) -> None:
        self._lines: defaultdict[str, deque[str]] = defaultdict(lambda: deque(maxlen=LINES))
        self.callbacks = fmi2.fmi2CallbackFunctions()
        self.callbacks.logger = fmi2.fmi2CallbackLoggerTYPE(self._log)
        self.callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(fmpy.calloc)
        self.callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.free)
        addLoggerProxy(ctypes.byref(self.callbacks))

    def lines(self, instance: str) -> list[str]:
        """The last lines of an instance, oldest first."""
        return list(self._lines[instance])

    def _log(self, environment: Any, instance: bytes, status: int, category: bytes, message: bytes) -> None:
        if status >= fmi2.fmi2Warning and message:
            self._lines[(instance or b"").decode(errors="replace")].append(
                message.decode(errors="replace").strip()
            )
