"""Functions called in a child process, because they may end it, fill its memory or never return."""

import contextlib
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Sequence
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from .channel import close_parent_channels
from .confinement import confine
from .processes import describe_exit, watch_parent
from .shield import end_with_parent, shield

_CONTEXT: Any = multiprocessing.get_context("fork" if hasattr(os, "fork") else "spawn")


_CHUNK = 65536
"""Bytes that are read at once."""

_PAUSE = 0.005
"""Seconds between two looks whether a process runs."""

_LONGEST_LINE = 2**29
"""Bytes of the longest line that is received."""


class Child:
    """A child process that executes `do(send, *arguments)`; it ends when this process ends.

    It is a fork of this process if the system supports that.

    Attributes:
        answers: Receives the objects that `do` sends; raises EOFError or OSError once the child has ended.

    Args:
        do: The function. Its first argument is a function that sends an object.
        *arguments: The other arguments.
        apart: Whether the child gets a process group of its own, so that `close` also ends the processes it
            started, and a parent of its own, so that a signal to its parent reaches no other process.
        writable: Folders and files that the child may change, if the system can confine it; default: all.
            Requires `apart`.
        lines: Whether `do` sends lines of bytes, without their end, for `receive_line`. Nothing of what the
            child sends is then unpickled, which could execute code in this process.
    """

    answers: Connection

    def __init__(
        self,
        do: Callable[..., None],
        *arguments: Any,
        apart: bool = False,
        writable: Sequence[Path] | None = None,
        lines: bool = False,
    ) -> None:
        self.answers, theirs = _CONTEXT.Pipe(duplex=False)
        self._received, self._searched = bytearray(), 0
        self._process = _CONTEXT.Process(
            target=_called, args=(do, arguments, theirs, apart, writable, lines), daemon=False
        )
        self._process.start()
        theirs.close()

    def is_alive(self) -> bool:
        """Return whether the process is running."""
        return self._process.is_alive()

    def receive_line(self, patience: float) -> bytes | None:
        """Return the next line, or None if it is not complete after `patience` seconds.

        Raises:
            EOFError: The child closed its end.
            ValueError: The line is too long.
        """
        until = time.monotonic() + patience
        while (end := self._received.find(b"\n", self._searched)) < 0:
            self._searched = len(self._received)
            if not self.answers.poll(max(0.0, until - time.monotonic())):
                return None
            part = _read_available(self.answers)
            if not part:
                raise EOFError
            self._received += part
            if len(self._received) > _LONGEST_LINE:
                raise ValueError("the line is too long")
        line = bytes(self._received[:end])
        del self._received[: end + 1]
        self._searched = 0
        return line

    def wait(self, patience: float | None = None) -> str:
        """Wait until the process ends, at most `patience` seconds; return how it ended."""
        code = self._join(patience)
        return describe_exit(code) if code is not None else "its end of the pipe closed"

    def signal_at_end(self, patience: float) -> str:
        """Return the signal that ended the process, or an empty text; wait for the end `patience` seconds."""
        code = self._join(patience)
        return describe_exit(code) if code is not None and code < 0 else ""

    def _join(self, patience: float | None) -> int | None:
        """Wait until the process ends, at most `patience` seconds; return its exit code, None if it runs.

        The sentinel of `multiprocessing` is a pipe. The process may write into it, and `Process.join` then
        waits without a limit. Processes that it started may keep the pipe open.
        """
        until = None if patience is None else time.monotonic() + patience
        while self._process.is_alive() and (until is None or time.monotonic() < until):
            time.sleep(_PAUSE)
        return self._process.exitcode

    def kill(self) -> None:
        """End the process."""
        self._process.kill()

    def close(self) -> None:
        """End the process and all that it started; requires `apart`."""
        self._join(0.2)
        if hasattr(os, "killpg"):
            with contextlib.suppress(OSError):
                os.killpg(self._process.pid, signal.SIGKILL)
        if self._process.is_alive():
            self._process.kill()
        self._process.join()
        self._process.close()
        self.answers.close()


def _called(
    do: Callable[..., None],
    arguments: tuple[Any, ...],
    answers: Connection,
    apart: bool,
    writable: Sequence[Path] | None,
    lines: bool,
) -> None:
    if apart:
        close_parent_channels()
    if apart and hasattr(os, "setsid"):
        os.setsid()
        _restore_signals()
        if writable is not None:
            confine(writable)  # before there are other threads, and a parent to signal
        starter = os.getppid()

        def release() -> None:
            answers.close()
            end_with_parent()
            watch_parent(starter, _end_all)

        shield(release)
    end_with_parent()
    parent = os.getppid() if hasattr(os, "fork") else getattr(multiprocessing.parent_process(), "pid", None)
    if parent is not None:
        watch_parent(parent, _end_all)
    do(partial(_send_line, answers) if lines else answers.send, *arguments)
    answers.close()
    os._exit(0)  # exit handlers of FMU libraries must not run


def _send_line(answers: Connection, line: bytes) -> None:
    if os.name == "nt":
        return answers.send_bytes(line + b"\n")
    rest = memoryview(line + b"\n")
    while rest:
        rest = rest[os.write(answers.fileno(), rest) :]
    return None


def _read_available(answers: Connection) -> bytes:
    """Return what is there, without waiting for the rest of a message that an FMU began."""
    return answers.recv_bytes() if os.name == "nt" else os.read(answers.fileno(), _CHUNK)


def _restore_signals() -> None:
    """Let signals end this process, whatever the process that started it does with them."""
    for name in ("SIGTERM", "SIGHUP", "SIGINT"):
        if number := getattr(signal, name, None):
            signal.signal(number, signal.SIG_DFL)


def _end_all() -> None:
    """End the process group of this process."""
    if hasattr(os, "killpg"):
        os.killpg(0, signal.SIGKILL)
    os._exit(1)


def silence() -> None:
    """Discard all output of this process."""
    with Path(os.devnull).open("wb") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        os.dup2(nowhere.fileno(), 2)


def limit_memory(memory: int) -> None:
    """Limit the additional memory of this process in bytes, if the system supports limits."""
    try:
        import resource

        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + memory, used + memory))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    except (ImportError, OSError, ValueError):
        return
