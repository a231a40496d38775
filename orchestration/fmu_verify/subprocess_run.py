"""Run a check in a subprocess, which it may crash, fill or never leave."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from emla_cosim.base import crash_page
from emla_cosim.base.channel import LOOK, Channel, GarbledError
from emla_cosim.base.crash_page import CrashPageFile
from emla_cosim.base.errors import find_machine_fault
from emla_cosim.base.process import Child, ChildEndedError, describe_exit, limit_memory, silence
from emla_cosim.fmu.python_exceptions import REMEDY, find_left_exception

from .confinement import confine
from .plain_outcome import read_outcome, write_outcome
from .verdict import (
    LEAVES_EXCEPTION,
    RETURNS,
    CheckOutcome,
    blocked,
    failed,
    left_exception,
    own_rule,
)

_FIRST = "its first call"
"""The note before the first call."""

_OWN = own_rule("emla verify", "A check stays within its limits of time and memory.")

ERROR_OF_CHECK = "The check itself has an error:"
"""How the message begins if a check raises an exception."""

_TIMEOUT_AT_END = 1.0
"""Seconds that a process may take to end after its answer."""


def note(doing: str) -> None:
    """Note the next action, as messages name it: `fmi2DoStep at t = 1 s`."""
    crash_page.write_note(doing)


def last_note() -> str:
    """Return the last note of this process or one forked from it."""
    return crash_page.read_note()


def run_in_subprocess(
    do: Callable[..., CheckOutcome],
    arguments: tuple[Any, ...],
    seconds: float,
    memory: int,
    writable: Sequence[Path] | None = None,
) -> CheckOutcome:
    """Call `do` in a subprocess and return its outcome.

    The outcome is failed, with the last note, if the process ends, exceeds a limit, or `do` raises.

    Args:
        do: Function to call.
        arguments: Its arguments.
        seconds: Time limit in s.
        memory: Memory limit in bytes, in addition to what the process uses now.
        writable: Folders that the process may write to, if the system can confine it. Default: all.
    """
    return next(run_each_in_subprocess(do, [arguments], seconds, memory, writable))


def run_each_in_subprocess(
    do: Callable[..., CheckOutcome],
    items: Sequence[tuple[Any, ...]],
    seconds: float,
    memory: int,
    writable: Sequence[Path] | None = None,
) -> Iterator[CheckOutcome]:
    """Call `do` for each of several arguments like `run_in_subprocess`, in as few processes as possible.

    If one call ends its process or exceeds a limit, the next call gets a new process.
    """
    left = list(items)
    while left:
        with (
            closing(CrashPageFile()) as notes,
            closing(Child(_answer, do, left, notes.path, memory, writable, fork=True)) as child,
        ):
            can_continue = True
            while left and can_continue:
                outcome, can_continue = _receive_outcome(child, notes, seconds)
                del left[0]
                if can_continue and not left and (code := child.wait(_TIMEOUT_AT_END) or 0) < 0:
                    outcome = failed(f"It ended the process in {_read(notes)} ({describe_exit(code)}).")
                yield outcome


def _receive_outcome(child: Child, notes: CrashPageFile, seconds: float) -> tuple[CheckOutcome, bool]:
    """Return the next outcome, and whether the process can continue."""
    began = moved = now = time.monotonic()
    doing = _read(notes)
    while True:
        try:
            return read_outcome(child.receive_bytes(min(LOOK, began + seconds - now))), True
        except TimeoutError:
            now = time.monotonic()
        except (ChildEndedError, ValueError) as error:
            if isinstance(error, ValueError) or isinstance(error.__cause__, GarbledError):
                return failed(f"It wrote into a file of this program, in {_read(notes, doing)}."), False
            said = f"It ended the process in {_read(notes, doing)} ({error})."
            return failed(said, clause=RETURNS), False
        if doing != (doing := _read(notes, doing)):
            moved = now
        if now > began + seconds:
            return _describe_timeout(doing, seconds, now - moved), False


_FAULT = "The machine has too little space or memory, or a limit is too low (`ulimit -a`)."
_SLOW = "The FMU may only be slow. Increase the time limit (--seconds)."


def _describe_timeout(doing: str, seconds: float, still: float) -> CheckOutcome:
    """Return the outcome of a check that takes too long and has been in the same call for `still` s."""
    if doing == _FIRST:
        said = f"It did not finish within {seconds:g} s, before it called the FMU."
        return blocked(said, hint=_SLOW, gaps=(said,))
    if still > 0.5 * seconds:
        return failed(f"It did not return from {doing} within {seconds:g} s.", clause=RETURNS)
    said = f"It did not finish within {seconds:g} s; it was at {doing} and still made progress."
    return blocked(said, hint=_SLOW, gaps=(said,))


def _answer(
    channel: Channel,
    do: Callable[..., CheckOutcome],
    items: Sequence[tuple[Any, ...]],
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
    for arguments in items:
        note(_FIRST)
        channel.send_bytes(write_outcome(_call_limited(do, arguments, memory)))


def _call_limited(do: Callable[..., CheckOutcome], arguments: tuple[Any, ...], memory: int) -> CheckOutcome:
    try:
        return do(*arguments)
    except MemoryError:
        return failed(f"It needs more than {memory / 2**20:.0f} MiB of memory in {last_note()}.", clause=_OWN)
    except Exception as error:  # a bug in a check must not lose the rest of the report
        if find_left_exception(error) is not None:
            return failed(left_exception(last_note(), error), clause=LEAVES_EXCEPTION, hint=REMEDY)
        if (fault := find_machine_fault(error)) is not None:
            said = f"It could not run on this machine: {fault.strerror}."
            return blocked(said, hint=_FAULT, gaps=(said,))
        return failed(f"{ERROR_OF_CHECK} {type(error).__name__}: {error}.")


def _read(notes: CrashPageFile, before: str = _FIRST) -> str:
    """Return the last note, or the one before while the next is being written."""
    return notes.note() or before
