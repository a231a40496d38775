"""One check in a process of its own, which it may end, fill or never leave."""

import contextlib
import mmap
import multiprocessing
import os
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from ..processes import how_it_ended
from .verdict import Outcome, failed

_CONTEXT: Any = multiprocessing.get_context("fork" if hasattr(os, "fork") else "spawn")
_NOTES = 4096
"""Bytes of the file in which a check notes what it is about to do."""

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
    bytes more than it has now, fails, with what it was doing as it noted it.
    """
    with _note_file() as notes:
        mine, theirs = _CONTEXT.Pipe(duplex=False)
        process = _CONTEXT.Process(target=_answer, args=(do, arguments, theirs, notes, memory), daemon=False)
        process.start()
        theirs.close()
        try:
            return _outcome(process, mine, notes, seconds)
        finally:
            _end(process)
            mine.close()


def _outcome(process: Any, answers: Connection, notes: Path, seconds: float) -> Outcome:
    until = time.monotonic() + seconds
    try:
        while not answers.poll(min(0.05, max(0.0, until - time.monotonic()))):
            if time.monotonic() > until:
                return failed(f"It did not return from {_read(notes)} within {seconds:g} s.")
            if not process.is_alive() and not answers.poll(0):
                raise EOFError
        found = answers.recv()
    except (EOFError, OSError):
        process.join(_PATIENCE)
        return failed(f"It ended the process in {_read(notes)} ({_status(process)}).")
    if isinstance(found, Outcome):
        return found
    raise found


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
    do: Callable[..., Outcome], arguments: tuple[Any, ...], answers: Connection, notes: Path, memory: int
) -> None:
    """In the child: do it, and send what came out."""
    if hasattr(os, "setsid"):
        os.setsid()
    _silence()
    with notes.open("r+b") as stream:
        _Notes.memory = mmap.mmap(stream.fileno(), 0)
    _limit(memory)
    try:
        answer: Any = do(*arguments)
    except MemoryError:
        answer = failed(f"It needs more than {memory / 2**20:.0f} MiB of memory in {_read(notes)}.")
    except Exception as error:
        answer = error
    try:
        answers.send(answer)
    except Exception as error:  # what cannot be sent is told
        answers.send(RuntimeError(repr(error)))
    answers.close()
    os._exit(0)  # libraries of the FMU have no say in how this process ends


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
        stream.write(b"its first call".ljust(_NOTES, b"\0"))
    try:
        yield path
    finally:
        path.unlink(missing_ok=True)


def _read(notes: Path) -> str:
    return notes.read_bytes().split(b"\0")[0].decode(errors="replace")
