"""Run a check in a subprocess, which it may crash, fill or never leave."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

from ..base.errors import find_machine_fault
from ..fmu.python_exceptions import REMEDY, find_left_exception
from ..sandbox import crash_page
from ..sandbox.child import Child, limit_memory, silence
from ..sandbox.crash_page import CrashPageFile
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

_POLL = 0.05
"""Seconds between two looks at the progress."""

_TIMEOUT = 5.0
"""Seconds that a process may take to end after its last sign of life."""

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
        with closing(CrashPageFile()) as notes, ExitStack() as held:
            places = None if writable is None else [*writable, notes.path]
            child = Child(_answer, do, left, notes.path, memory, apart=True, writable=places, lines=True)
            held.callback(child.close)
            whole = True
            while left and whole:
                outcome, whole = _outcome(child, notes, seconds)
                del left[0]
                if whole and not left and (how := child.signal_at_end(_TIMEOUT_AT_END)):
                    outcome = failed(f"It ended the process in {_read(notes)} ({how}).")
                yield outcome


def _outcome(child: Child, notes: CrashPageFile, seconds: float) -> tuple[CheckOutcome, bool]:
    """Return the next outcome, and whether the process can continue."""
    began = moved = time.monotonic()
    doing = _read(notes)
    try:
        while (line := child.receive_line(min(_POLL, max(0.0, began + seconds - time.monotonic())))) is None:
            now = time.monotonic()
            if doing != (doing := _read(notes, doing)):
                moved = now
            if now > began + seconds:
                return _describe_timeout(doing, seconds, now - moved), False
            if not child.is_alive() and not child.answers.poll(0):
                raise EOFError
        return read_outcome(line), True
    except (EOFError, OSError):
        how = child.wait(_TIMEOUT)
        said = f"It ended the process in {_read(notes, doing)} ({how})."
        return failed(said, clause=RETURNS), False
    except ValueError:
        return failed(f"It wrote into a file of this program, in {_read(notes, doing)}."), False


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
    send: Callable[[bytes], None],
    do: Callable[..., CheckOutcome],
    items: Sequence[tuple[Any, ...]],
    notes: Path,
    memory: int,
) -> None:
    """Call `do` in the child process and send the outcomes."""
    silence()  # discard what an FMU prints
    crash_page.share_file(notes)
    limit_memory(memory)
    for arguments in items:
        note(_FIRST)
        send(write_outcome(_call_limited(do, arguments, memory)))


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
