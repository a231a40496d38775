"""Exceptions of Python that FMUs leave set in the interpreter of this process.

A function of an FMU that uses Python can return while an exception is set. In place of its result, ctypes
raises SystemError ("returned a result with an exception set") then, whose cause is that exception. Compiled
loops call many functions before ctypes can see it.
"""

import mmap
import traceback
from collections.abc import Iterable
from pathlib import Path

from ..base.wording import shorten_line

_LONGEST = 300
"""Most letters of an exception in a message."""


REMEDY = (
    "Report it to the exporter of the FMU: a function of an FMU must clear exceptions of Python "
    "before it returns."
)
"""What to do about it, as a message."""


_PENDING = "with an exception set"
"""What Python says, also within an FMU, if an exception from an earlier call is still set."""


def explain_earlier_exception(messages: Iterable[str]) -> str:
    """Return what to do if an FMU failed because an earlier call left an exception; empty if not.

    Args:
        messages: What the FMU said.
    """
    if not any(_PENDING in message for message in messages):
        return ""
    return "An earlier call left an exception of Python; to find it, run with `--isolate`."


def find_left_exception(error: BaseException) -> BaseException | None:
    """Return the exception that an FMU left, if that caused this error."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, SystemError) and cause.__cause__ is not None:
            return cause.__cause__
        cause = cause.__cause__ or cause.__context__
    return None


def describe_left_exception(error: BaseException) -> str:
    """Return the exception that an FMU left in one line, such as `ValueError: no such variable`.

    Args:
        error: What ctypes raised.
    """
    exception = find_left_exception(error) or error
    return shorten_line(traceback.format_exception_only(exception)[-1].rstrip().rstrip("."), _LONGEST)


def uses_python(library: Path) -> bool:
    """Return whether a shared library has names of Python's C functions, as text or as symbols."""
    try:
        with library.open("rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
            return any(content.find(name) >= 0 for name in (b"PyErr_", b"PyObject_", b"Py_Initialize"))
    except (OSError, ValueError):  # ValueError: an empty file
        return False
