"""One check in a process of its own, which it may end, fill or never leave."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

from ..sandbox import black_box
from ..sandbox.black_box import BlackBoxFile
from ..sandbox.child import Child, limit_memory, silence
from .verdict import CheckOutcome, failed

_FIRST = "its first call"
"""What is noted before anything else is."""

_LOOK = 0.05
"""Seconds between two looks at whether it goes on."""

_TIMEOUT = 5.0
"""Seconds that a process has to end after it has answered."""


def note(doing: str) -> None:
    """Say what is done next, in the words of a sentence that ends in it: `fmi2DoStep at t = 1 s`."""
    black_box.write_message(doing.encode()[: black_box.LONGEST_NOTE])


def last_note() -> str:
    """What was noted last, in this process or one that divided from it."""
    return black_box.read_message().decode(errors="replace")


def run_in_subprocess(
    do: Callable[..., CheckOutcome], arguments: tuple[Any, ...], seconds: float, memory: int
) -> CheckOutcome:
    """What `do` returns, called in another process with these arguments.

    A process that ends by itself, does not answer in so many seconds, or needs more than `memory`
    bytes more than it has now, fails, with what it was doing as it noted it. So does one in which `do`
    raises anything.
    """
    return next(run_each_in_subprocess(do, [arguments], seconds, memory))


def run_each_in_subprocess(
    do: Callable[..., CheckOutcome], items: Sequence[tuple[Any, ...]], seconds: float, memory: int
) -> Iterator[CheckOutcome]:
    """What `do` returns for each of several arguments, as `apart`, in as few processes as it takes.

    Where one of them ends its process, or has to be ended, the next one gets a new one.
    """
    left = list(items)
    while left:
        with (
            closing(BlackBoxFile()) as notes,
            closing(Child(_answer, do, left, notes.path, memory, apart=True)) as child,
        ):
            whole = True
            while left and whole:
                outcome, whole = _outcome(child, notes, seconds)
                del left[0]
                yield outcome


def _outcome(child: Child, notes: BlackBoxFile, seconds: float) -> tuple[CheckOutcome, bool]:
    """The next answer, and whether more can come."""
    began = moved = time.monotonic()
    answers, doing = child.answers, _read(notes)
    try:
        while not answers.poll(min(_LOOK, max(0.0, began + seconds - time.monotonic()))):
            now = time.monotonic()
            if doing != (doing := _read(notes, doing)):
                moved = now
            if now > began + seconds:
                return _describe_timeout(doing, seconds, now - moved), False
            if not child.is_alive() and not answers.poll(0):
                raise EOFError
        found = answers.recv()
        if isinstance(found, CheckOutcome):
            return found, True
    except (EOFError, OSError):
        how = child.wait(_TIMEOUT)
        return failed(f"It ended the process in {_read(notes, doing)} ({how})."), False
    except Exception:  # whatever pickle makes of it
        found = None
    return failed(f"It wrote into a file that is not its own, in {_read(notes, doing)}."), False


def _describe_timeout(doing: str, seconds: float, still: float) -> CheckOutcome:
    """What is said of a check that takes too long, which has been doing the same for `still` s."""
    if still > 0.5 * seconds:
        return failed(f"It did not return from {doing} within {seconds:g} s.")
    return failed(
        f"It was not done within {seconds:g} s; it had come to {doing}, and went on.",
        hint="It is slow, and not known to be wrong: give each check more time (--seconds).",
    )


def _answer(
    send: Callable[[CheckOutcome], None],
    do: Callable[..., CheckOutcome],
    items: Sequence[tuple[Any, ...]],
    notes: Path,
    memory: int,
) -> None:
    """In the child: do it, and send what came out."""
    silence()  # what an FMU prints is no part of a report
    black_box.share_file(notes)
    limit_memory(memory)
    for arguments in items:
        note(_FIRST)
        send(_call_limited(do, arguments, memory))


def _call_limited(do: Callable[..., CheckOutcome], arguments: tuple[Any, ...], memory: int) -> CheckOutcome:
    try:
        return do(*arguments)
    except MemoryError:
        return failed(f"It needs more than {memory / 2**20:.0f} MiB of memory in {last_note()}.")
    except Exception as error:  # a slip of ours is told, and costs nobody the rest of the report
        return failed(f"The check itself went wrong: {type(error).__name__}: {error}.")


def _read(notes: BlackBoxFile, before: str = _FIRST) -> str:
    """What was noted last; the note before, where the next one is just being written."""
    return notes.message().decode(errors="replace") or before
