"""One check in a process of its own, which it may end, fill or never leave."""

import contextlib
import mmap
import multiprocessing
import os
import signal
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from ..sandbox.processes import end_with, how_it_ended
from .verdict import Outcome, failed

_CONTEXT: Any = multiprocessing.get_context("fork" if hasattr(os, "fork") else "spawn")
_NOTES = 4096
"""Bytes of the file in which a check notes what it is about to do."""

_FIRST = "its first call"
"""What is noted before anything else is."""

_LOOK = 0.05
"""Seconds between two looks at whether it goes on."""

_PATIENCE = 5.0
"""Seconds that a process has to end after it has answered."""


class _Notes:
    """Where this process notes what it is about to do; nowhere until it examines something."""

    memory: Any = None


def note(doing: str) -> None:
    """Say what is done next, in the words of a sentence that ends in it: `fmi2DoStep at t = 1 s`."""
    if _Notes.memory is not None:
        text = doing.encode()[: _NOTES - 1]
        _Notes.memory[: len(text) + 1] = text + b"\0"


def noted() -> str:
    """What was noted last, in this process or one that divided from it."""
    return "" if _Notes.memory is None else _Notes.memory[:].split(b"\0")[0].decode(errors="replace")


def apart(do: Callable[..., Outcome], arguments: tuple[Any, ...], seconds: float, memory: int) -> Outcome:
    """What `do` returns, called in another process with these arguments.

    A process that ends by itself, does not answer in so many seconds, or needs more than `memory`
    bytes more than it has now, fails, with what it was doing as it noted it. So does one in which `do`
    raises anything.
    """
    return next(apart_each(do, [arguments], seconds, memory))


def apart_each(
    do: Callable[..., Outcome], items: Sequence[tuple[Any, ...]], seconds: float, memory: int
) -> Iterator[Outcome]:
    """What `do` returns for each of several arguments, as `apart`, in as few processes as it takes.

    Where one of them ends its process, or has to be ended, the next one gets a new one.
    """
    left = list(items)
    while left:
        with _note_file() as notes, _child(do, left, notes, memory) as (process, answers):
            whole = True
            while left and whole:
                outcome, whole = _outcome(process, answers, notes, seconds)
                del left[0]
                yield outcome


@contextlib.contextmanager
def _child(
    do: Callable[..., Outcome], items: Sequence[tuple[Any, ...]], notes: Path, memory: int
) -> Iterator[tuple[Any, Connection]]:
    """A process that does them, and where its answers come from."""
    mine, theirs = _CONTEXT.Pipe(duplex=False)
    process = _CONTEXT.Process(target=_answer, args=(do, items, theirs, notes, memory), daemon=False)
    process.start()
    theirs.close()
    try:
        yield process, mine
    finally:
        _end(process)
        mine.close()


def _outcome(process: Any, answers: Connection, notes: Path, seconds: float) -> tuple[Outcome, bool]:
    """The next answer, and whether more can come."""
    began = moved = time.monotonic()
    doing = _read(notes)
    try:
        while not answers.poll(min(_LOOK, max(0.0, began + seconds - time.monotonic()))):
            now = time.monotonic()
            if doing != (doing := _read(notes)):
                moved = now
            if now > began + seconds:
                return _late(doing, seconds, now - moved), False
            if not process.is_alive() and not answers.poll(0):
                raise EOFError
        found = answers.recv()
        if isinstance(found, Outcome):
            return found, True
    except (EOFError, OSError):
        process.join(_PATIENCE)
        return failed(f"It ended the process in {_read(notes)} ({_status(process)})."), False
    except Exception:  # whatever pickle makes of it
        found = None
    return failed(f"It wrote into a file that is not its own, in {_read(notes)}."), False


def _late(doing: str, seconds: float, still: float) -> Outcome:
    """What is said of a check that takes too long, which has been doing the same for `still` s."""
    if still > 0.5 * seconds:
        return failed(f"It did not return from {doing} within {seconds:g} s.")
    return failed(
        f"It was not done within {seconds:g} s; it had come to {doing}, and went on.",
        hint="It is slow, and not known to be wrong: give each check more time (--seconds).",
    )


def _status(process: Any) -> str:
    return how_it_ended(process.exitcode) if process.exitcode is not None else "its end of the pipe closed"


def _end(process: Any) -> None:
    """Whatever it does, and whatever it started."""
    process.join(0.2)
    if hasattr(os, "killpg"):
        with contextlib.suppress(OSError):
            os.killpg(process.pid, signal.SIGKILL)
    if process.is_alive():
        process.kill()
    process.join()
    process.close()


def _answer(
    do: Callable[..., Outcome],
    items: Sequence[tuple[Any, ...]],
    answers: Connection,
    notes: Path,
    memory: int,
) -> None:
    """In the child: do it, and send what came out."""
    if hasattr(os, "setsid"):
        os.setsid()
    end_with_parent()
    _silence()
    with notes.open("r+b") as stream:
        _Notes.memory = mmap.mmap(stream.fileno(), 0)
    _limit(memory)
    for arguments in items:
        note(_FIRST)
        answers.send(_answered(do, arguments, memory))
    answers.close()
    os._exit(0)  # libraries of the FMU have no say in how this process ends


def end_with_parent() -> None:
    """From now on this process, and what it started, ends when the one that made it does."""
    parent = multiprocessing.parent_process()
    if parent is not None and parent.pid is not None:
        end_with(parent.pid, _end_all)


def _end_all() -> None:
    """End the group of processes that belong to the check."""
    if hasattr(os, "killpg"):
        os.killpg(0, signal.SIGKILL)
    os._exit(1)


def _answered(do: Callable[..., Outcome], arguments: tuple[Any, ...], memory: int) -> Outcome:
    try:
        return do(*arguments)
    except MemoryError:
        return failed(f"It needs more than {memory / 2**20:.0f} MiB of memory in {noted()}.")
    except Exception as error:  # a slip of ours is told, and costs nobody the rest of the report
        return failed(f"The check itself went wrong: {type(error).__name__}: {error}.")


def _silence() -> None:
    """What an FMU prints is no part of a report."""
    with Path(os.devnull).open("wb") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        os.dup2(nowhere.fileno(), 2)


def _limit(memory: int) -> None:
    """Let this process have so many bytes more; no limit where systems know none."""
    try:
        import resource

        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + memory, used + memory))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    except (ImportError, OSError, ValueError):
        return


@contextlib.contextmanager
def _note_file() -> Iterator[Path]:
    descriptor, name = tempfile.mkstemp(prefix="emla-verify-")
    path = Path(name)
    with os.fdopen(descriptor, "wb") as stream:
        stream.write(_FIRST.encode().ljust(_NOTES, b"\0"))
    try:
        yield path
    finally:
        path.unlink(missing_ok=True)


def _read(notes: Path) -> str:
    return notes.read_bytes().split(b"\0")[0].decode(errors="replace")
