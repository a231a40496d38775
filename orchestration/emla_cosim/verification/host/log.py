"""Everything that instances say through the FMI logger."""

import ctypes
from typing import Any, NamedTuple

import fmpy
from fmpy import fmi2
from fmpy.logging import addLoggerProxy


class Line(NamedTuple):
    """One message: of which instance, with which status, in which category."""

    instance: str
    status: int
    category: str
    text: str


def whole(text: str) -> str:
    """What an FMU says, as the end of a sentence."""
    line = " ".join(text.split())
    return line if line.endswith((".", "!", "?")) else f"{line}."


class Log:
    """All messages of all instances of this process, oldest first.

    There is one: fmpy's proxy, which formats the messages, knows a single logger.
    """

    def __init__(self) -> None:
        self.lines: list[Line] = []
        self.callbacks = fmi2.fmi2CallbackFunctions()
        self._kept = fmi2.fmi2CallbackLoggerTYPE(self._hear)
        self.callbacks.logger = self._kept
        self.callbacks.allocateMemory = fmi2.fmi2CallbackAllocateMemoryTYPE(fmpy.calloc)
        self.callbacks.freeMemory = fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.free)
        addLoggerProxy(ctypes.byref(self.callbacks))

    def of(self, instance: str, status: int = 0) -> list[Line]:
        """Messages of an instance, with this status or a worse one."""
        return [line for line in self.lines if line.instance == instance and line.status >= status]

    def _hear(self, environment: Any, instance: bytes, status: int, category: bytes, message: bytes) -> None:
        name, kind, text = (
            (x or b"").decode(errors="replace").strip() for x in (instance, category, message)
        )
        self.lines.append(Line(name, status, kind, text))


LOG = Log()
"""That of this process, which every check has to itself."""
