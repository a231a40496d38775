"""Run a check, or a part of it, in a subprocess, which it may crash, fill or never leave."""

import dataclasses
import json
import time
from collections.abc import Callable, Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import Any, get_origin

import msgspec
import numpy as np

from emla_cosim.base import crash_page
from emla_cosim.base.channel import POLL_INTERVAL, Channel, GarbledError
from emla_cosim.base.crash_page import CrashPageFile, read_note
from emla_cosim.base.errors import find_machine_fault
from emla_cosim.base.process import Child, ChildEndedError, describe_exit, limit_memory, silence
from emla_cosim.fmu.python_exceptions import REMEDY, find_left_exception

from .check import LEAVES_EXCEPTION, RETURNS, CheckOutcome, blocked, describe_exception, failed, quote
from .confinement import confine
from .subject import Subject

_FIRST = "its first call"
"""The note before the first call."""


ERROR_OF_CHECK = "The check itself has an error:"
"""How the message begins if a check raises an exception."""

_TIMEOUT_AT_END = 1.0
"""Seconds that a process may take to end after its answer."""


_is_used = False
"""Whether this process may have loaded an FMU."""


def note(doing: str, is_reading: bool = False) -> None:
    """Note the next action, as messages name it: `fmi2DoStep at t = 1 s`.

    No other check runs in this process then, unless the action only reads files (`is_reading`).
    """
    global _is_used
    _is_used = _is_used or not is_reading
    crash_page.write_note(doing)


class CheckProcess:
    """A copy of this process that calls `do`, again and again as long as no call loads an FMU.

    Args:
        do: Function to call.
        arguments: Its first arguments, as they are now.
        memory: Memory limit in bytes, in addition to what this process uses now.
        writable: Folders that the process may write to, if the system can confine it. Default: all.
    """

    def __init__(
        self,
        do: Callable[..., CheckOutcome],
        arguments: tuple[Any, ...],
        memory: int,
        writable: Sequence[Path] | None = None,
    ) -> None:
        self._notes = CrashPageFile()
        try:
            self._child = Child(_serve, do, arguments, self._notes.path, memory, writable, fork=True)
        except BaseException:
            self._notes.close()
            raise
        self.memory, self.can_continue = memory, True

    def call(self, arguments: tuple[Any, ...], seconds: float) -> CheckOutcome:
        """Call `do` with further arguments, for at most `seconds`. `can_continue` is then up to date.

        The outcome is failed or blocked, with the last note, if the process ends, exceeds a limit, or `do`
        raises.
        """
        with suppress(ChildEndedError):  # `receive` reports it
            self._child.send(arguments)
        outcome, self.can_continue, has_ended = _receive_outcome(self._child, self._notes, seconds)
        if not (self.can_continue or has_ended) and (code := self._child.wait(_TIMEOUT_AT_END) or 0) < 0:
            doing = self._notes.note() or _FIRST
            return failed(f"It ended the process in {doing} ({describe_exit(code)}).")
        return outcome

    def close(self) -> None:
        """End the process."""
        self._child.close()
        self._notes.close()


def _receive_outcome(child: Child, notes: CrashPageFile, seconds: float) -> tuple[CheckOutcome, bool, bool]:
    """Return the next outcome, whether the process takes another call, and whether it was lost."""
    start = last_change = now = time.monotonic()
    doing = notes.note() or _FIRST
    while True:
        try:
            answer = child.receive_bytes(min(POLL_INTERVAL, start + seconds - now))
            return decode_outcome(answer[1:]), answer[:1] == _CAN_CONTINUE, False
        except TimeoutError:
            now = time.monotonic()
        except (ChildEndedError, ValueError) as error:
            doing = notes.note() or doing
            if isinstance(error, ValueError) or isinstance(error.__cause__, GarbledError):
                return failed(f"It wrote into a file of this program, in {doing}."), False, True
            return failed(f"It ended the process in {doing} ({error}).", clause=RETURNS), False, True
        if doing != (doing := notes.note() or doing):  # none while the next one is being written
            last_change = now
        if now > start + seconds:
            return _describe_timeout(doing, seconds, now - last_change), False, True


# what an answer begins with: whether its process takes another call
_CAN_CONTINUE, _ENDS = b"+", b"-"

_FAULT = "The machine has too little space or memory, or a limit is too low (`ulimit -a`)."
_SLOW = "The FMU may only be slow. Increase the time limit (--seconds)."


def _describe_timeout(doing: str, seconds: float, still: float) -> CheckOutcome:
    """Return the outcome of a check that takes too long and has been in the same call for `still` s."""
    if doing == _FIRST:
        message = f"It did not finish within {seconds:g} s, before it called the FMU."
        return blocked(message, hint=_SLOW, gaps=(message,))
    if still > 0.5 * seconds:
        return failed(f"It did not return from {doing} within {seconds:g} s.", clause=RETURNS)
    message = f"It did not finish within {seconds:g} s; it was at {doing} and still made progress."
    return blocked(message, hint=_SLOW, gaps=(message,))


def _serve(
    channel: Channel,
    do: Callable[..., CheckOutcome],
    first: tuple[Any, ...],
    notes: Path,
    memory: int,
    writable: Sequence[Path] | None,
) -> None:
    """Call `do` in the child process and send the outcomes."""
    silence()  # discard what an FMU prints
    crash_page.share_file(notes)
    if writable is not None:
        confine(writable)
    limit_memory(memory)
    for arguments in channel.requests():
        note(_FIRST, is_reading=True)
        outcome = encode_outcome(_call_limited(do, (*first, *arguments), memory))
        channel.send_bytes((_ENDS if _is_used else _CAN_CONTINUE) + outcome)
        # an FMU may have changed the process, so that no other check runs in it
        if _is_used:
            return


def _call_limited(do: Callable[..., CheckOutcome], arguments: tuple[Any, ...], memory: int) -> CheckOutcome:
    """Return the outcome of `do`; exceptions become outcomes, too."""
    try:
        return do(*arguments)
    except MemoryError:
        return failed(
            f"It needs more than {memory / 2**20:.0f} MiB of memory in {crash_page.read_note()}.",
            clause=quote("subprocess_run.limits"),
        )
    except Exception as error:  # a bug in a check must not lose the rest of the report
        if find_left_exception(error) is not None:
            return failed(
                describe_exception(crash_page.read_note(), error), clause=LEAVES_EXCEPTION, hint=REMEDY
            )
        if (fault := find_machine_fault(error)) is not None:
            message = f"It could not run on this machine: {fault.strerror}."
            return blocked(message, hint=_FAULT, gaps=(message,))
        return failed(f"{ERROR_OF_CHECK} {type(error).__name__}: {error}.")


def encode_outcome(outcome: CheckOutcome) -> bytes:
    """Return an outcome as one line of JSON, without its end: reading it executes nothing."""
    return json.dumps(outcome, default=_to_plain).encode("ascii")


def decode_outcome(text: bytes) -> CheckOutcome:
    """Return the outcome of `encode_outcome`.

    Raises:
        ValueError: It is something else.
    """
    try:
        return msgspec.convert(json.loads(text), CheckOutcome, dec_hook=_to_array)
    except (RecursionError, TypeError) as error:
        raise ValueError(str(error)) from None


def _to_plain(content: Any) -> Any:
    if dataclasses.is_dataclass(content):
        return {f.name: getattr(content, f.name) for f in dataclasses.fields(content)}
    if isinstance(content, (np.ndarray, np.generic)):
        return content.tolist()
    raise TypeError(f"{type(content).__name__} is not plain data")


def _to_array(kind: Any, content: Any) -> Any:
    if get_origin(kind) is np.ndarray and isinstance(content, list):
        return np.array(content, dtype=np.float64)
    raise ValueError(f"{kind} is not plain data")


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
