"""Messages of FMUs from the FMI logger, by instance."""

import ctypes
from collections import defaultdict, deque
from typing import Any, NamedTuple

import fmpy
from fmpy import fmi2
from fmpy.logging import addLoggerProxy

LINES = 5
"""The number of messages kept per instance."""


class LogLine(NamedTuple):
    """One message with its instance, status and category."""

    instance: str
    status: int
    category: str
    text: str


class FmuLog:
    """The last warnings and errors of each instance, by its name.

    One log serves all instances of a process, because fmpy's proxy that formats the messages knows one logger
    only. The log that listens receives the messages: the newest, or the last one whose `listen` was called.
    """

    least = fmi2.fmi2Warning
    """Messages of lower status are ignored."""

    _listening: "FmuLog | None" = None

    def __init__(self) -> None:
        self._last: defaultdict[str, deque[str]] = defaultdict(lambda: deque(maxlen=LINES))
        self.callbacks = _CALLBACKS
        self.callbacks.logger = _LOGGER  # the proxy replaces the logger and calls this one
        addLoggerProxy(ctypes.byref(self.callbacks))
        self.listen()

    def listen(self) -> None:
        """Receive all messages from now on, instead of the log that did so before."""
        FmuLog._listening = self

    def last(self, instance: str) -> list[str]:
        """Return the last warnings and errors of an instance, oldest first."""
        return list(self._last[instance])

    def store(self, line: LogLine) -> None:
        """Store a message."""
        if line.text:
            self._last[line.instance].append(line.text)

    @classmethod
    def hear(cls, environment: Any, instance: bytes, status: int, category: bytes, message: bytes) -> None:
        """Pass a message to the log that listens; called by FMUs."""
        if cls._listening is not None and status >= cls._listening.least:
            name, kind, text = (
                (x or b"").decode(errors="replace").strip() for x in (instance, category, message)
            )
            cls._listening.store(LogLine(name, status, kind, text))


# never freed: fmpy's proxy keeps its last callbacks, even after another log is created
_LOGGER = fmi2.fmi2CallbackLoggerTYPE(FmuLog.hear)
_CALLBACKS = fmi2.fmi2CallbackFunctions()
_CALLBACKS.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(fmpy.calloc)
_CALLBACKS.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.free)
