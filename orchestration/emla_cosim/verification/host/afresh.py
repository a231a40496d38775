"""A part of a check in a process that has not loaded the FMU yet: nothing is left of what was before."""

import multiprocessing
import os
from collections.abc import Callable
from typing import Any

from ...sandbox.processes import how_it_ended
from ..apart import end_with_parent, noted
from ..subject import Subject

_CONTEXT: Any = multiprocessing.get_context("fork" if hasattr(os, "fork") else "spawn")


class EndedError(Exception):
    """The process ended, as a sentence; `call` is what it was doing, `how` the way it ended."""

    def __init__(self, call: str, how: str) -> None:
        super().__init__(call, how)
        self.call, self.how = call, how

    def __str__(self) -> str:
        return f"It ended the process in {self.call} ({self.how})."


def afresh(do: Callable[..., Any], *arguments: Any) -> Any:
    """What `do` returns, or raises, in another process, which belongs to the check as this one does.

    Raises EndedError where it ends without either.
    """
    mine, theirs = _CONTEXT.Pipe(duplex=False)
    process = _CONTEXT.Process(target=_answer, args=(do, arguments, theirs), daemon=False)
    process.start()
    theirs.close()
    try:
        done, found = mine.recv()
    except (EOFError, OSError):
        process.join()
        raise EndedError(noted(), how_it_ended(process.exitcode)) from None
    finally:
        mine.close()
    process.join()
    if not done:
        raise found
    return found


def separately(do: Callable[..., Any], subject: Subject, *arguments: Any) -> Any:
    """What `do` returns, called here; in another process where only one instance may be made in each."""
    return afresh(do, subject, *arguments) if only_once(subject) else do(subject, *arguments)


def only_once(subject: Subject) -> bool:
    """Whether a process can have but one instance."""
    return subject.can("canBeInstantiatedOnlyOncePerProcess")


def _answer(do: Callable[..., Any], arguments: tuple[Any, ...], answers: Any) -> None:
    end_with_parent()
    try:
        answer: Any = (True, do(*arguments))
    except Exception as error:
        answer = (False, error)
    answers.send(answer)
    answers.close()
    os._exit(0)  # libraries of the FMU have no say in how this process ends
