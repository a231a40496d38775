"""What FMUs say through the FMI logger, kept per instance."""

import ctypes
from collections import defaultdict, deque
from typing import Any, NamedTuple

import fmpy
from fmpy import fmi2
from fmpy.logging import addLoggerProxy

LINES = 5
"""How many of its last lines are kept of each instance."""


class LogLine(NamedTuple):
    """One message: of which instance, with which status, in which category."""

    instance: str
    status: int
    category: str
    text: str


class FmuLog:
    """The last warnings and errors of every instance, by its name.

    One log serves all instances of a process: fmpy's proxy, which formats the messages, knows a
    single logger. The log made last is the one that hears them.
    """

    _listening: "FmuLog | None" = None

    def __init__(self) -> None:
        self._last: defaultdict[str, deque[str]] = defaultdict(lambda: deque(maxlen=LINES))
        self.callbacks = _CALLBACKS
        self.callbacks.logger = _LOGGER  # the proxy puts itself in here and calls what was here before
        addLoggerProxy(ctypes.byref(self.callbacks))
        FmuLog._listening = self

    def last(self, instance: str) -> list[str]:
        """The last warnings and errors of an instance, oldest first."""
        return list(self._last[instance])

    def take(self, line: LogLine) -> None:
        """Take a message."""
        if line.status >= fmi2.fmi2Warning and line.text:
            self._last[line.instance].append(line.text)

    @classmethod
    def hear(cls, environment: Any, instance: bytes, status: int, category: bytes, message: bytes) -> None:
        """Hand a message to the log that listens; called through the FMI."""
        if cls._listening is not None:
            name, kind, text = (
                (x or b"").decode(errors="replace").strip() for x in (instance, category, message)
            )
            cls._listening.take(LogLine(name, status, kind, text))


# kept for ever: fmpy's proxy does not let go of what it was given last, whoever logs next
_LOGGER = fmi2.fmi2CallbackLoggerTYPE(FmuLog.hear)
_CALLBACKS = fmi2.fmi2CallbackFunctions()
_CALLBACKS.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(fmpy.calloc)
_CALLBACKS.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.free)
