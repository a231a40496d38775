"""Run a part of a check in a process that has not loaded the FMU yet."""

from collections.abc import Callable
from contextlib import closing
from typing import Any

from emla_cosim.base.channel import Channel
from emla_cosim.base.crash_page import read_note
from emla_cosim.base.process import Child, ChildEndedError, describe_exit

from ..subject import Subject


class EndedError(Exception):
    """The process ended. `call` is its last call, `how` the signal or exit code."""

    def __init__(self, call: str, how: str) -> None:
        super().__init__(call, how)
        self.call, self.how = call, how

    def __str__(self) -> str:
        return f"It ended the process in {self.call} ({self.how})."


def in_fresh_process(do: Callable[..., Any], *arguments: Any, timeout: float | None = None) -> Any:
    """Call `do` in a new process that belongs to the same check. Return its result or raise its exception.

    After `timeout` s the process is ended. Default: wait until the check is ended.

    Raises:
        EndedError: The process ended during the call.
    """
    with closing(Child(_call_and_send, do, arguments, fork=True)) as child:
        try:
            is_done, answer = child.receive(timeout)
        except TimeoutError:
            child.kill()
            raise EndedError(read_note(), describe_exit(child.wait())) from None
        except ChildEndedError as error:
            raise EndedError(read_note(), str(error)) from None
    if not is_done:
        raise answer
    return answer


def in_separate_process(do: Callable[..., Any], subject: Subject, *arguments: Any) -> Any:
    """Call `do` here, or in a new process if the FMU allows only one instance per process."""
    if is_single_instance(subject):
        return in_fresh_process(do, subject, *arguments)
    return do(subject, *arguments)


def is_single_instance(subject: Subject) -> bool:
    """Return whether the FMU allows only one instance per process."""
    return subject.has_capability("canBeInstantiatedOnlyOncePerProcess")


def _call_and_send(channel: Channel, do: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    try:
        answer: Any = (True, do(*arguments))
    except Exception as error:
        answer = (False, error)
    channel.send(answer)
