"""A part of a check in a process that has not loaded the FMU yet: nothing is left of what was before."""

from collections.abc import Callable
from typing import Any

from ...sandbox.child import Child
from ..subject import Subject
from ..subprocess_run import last_note


class EndedError(Exception):
    """The process ended, as a sentence; `call` is what it was doing, `how` the way it ended."""

    def __init__(self, call: str, how: str) -> None:
        super().__init__(call, how)
        self.call, self.how = call, how

    def __str__(self) -> str:
        return f"It ended the process in {self.call} ({self.how})."


def in_fresh_process(do: Callable[..., Any], *arguments: Any) -> Any:
    """What `do` returns, or raises, in another process, which belongs to the check as this one does.

    Raises EndedError where it ends without either.
    """
    child = Child(_answer, do, arguments)
    try:
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
    """What `do` returns, called here; in another process where only one instance may be made in each."""
    return (
        in_fresh_process(do, subject, *arguments) if is_single_instance(subject) else do(subject, *arguments)
    )


def is_single_instance(subject: Subject) -> bool:
    """Whether a process can have but one instance."""
    return subject.has_capability("canBeInstantiatedOnlyOncePerProcess")


def _answer(send: Callable[[Any], None], do: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    try:
        answer: Any = (True, do(*arguments))
    except Exception as error:
        answer = (False, error)
    send(answer)
