"""Run a part of a check in a process that has not loaded the FMU yet."""

import math
import time
from collections.abc import Callable
from typing import Any

from ...sandbox.child import Child
from ..subject import Subject
from ..subprocess_run import last_note

_POLL = 0.05
"""Seconds between two looks whether the process runs."""


class EndedError(Exception):
    """The process ended. `call` is its last call, `how` the signal or exit code."""

    def __init__(self, call: str, how: str) -> None:
        super().__init__(call, how)
        self.call, self.how = call, how

    def __str__(self) -> str:
        return f"It ended the process in {self.call} ({self.how})."


def in_fresh_process(do: Callable[..., Any], *arguments: Any, patience: float | None = None) -> Any:
    """Call `do` in a new process that belongs to the same check. Return its result or raise its exception.

    Args:
        do: The function.
        *arguments: Its arguments.
        patience: Seconds after which the process is ended. Default: wait until the check is ended.

    Raises:
        EndedError: The process ended during the call.
    """
    child = Child(_answer, do, arguments)
    try:
        until = math.inf if patience is None else time.monotonic() + patience
        while not child.answers.poll(_POLL):  # a process that the FMU started may keep the pipe open
            if time.monotonic() > until:
                child.kill()
            if not child.is_alive() and not child.answers.poll(0):
                raise EOFError
        done, found = child.answers.recv()
    except (EOFError, OSError):
        how = child.wait()
        raise EndedError(last_note(), how) from None
    finally:
        child.answers.close()
    child.wait()
    if not done:
        raise found
    return found


def in_separate_process(do: Callable[..., Any], subject: Subject, *arguments: Any) -> Any:
    """Call `do` here, or in a new process if the FMU allows only one instance per process."""
    return (
        in_fresh_process(do, subject, *arguments) if is_single_instance(subject) else do(subject, *arguments)
    )


def is_single_instance(subject: Subject) -> bool:
    """Return whether the FMU allows only one instance per process."""
    return subject.has_capability("canBeInstantiatedOnlyOncePerProcess")


def _answer(send: Callable[[Any], None], do: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    try:
        answer: Any = (True, do(*arguments))
    except Exception as error:
        answer = (False, error)
    send(answer)
