"""Functions called in a child process, because they may end it, fill its memory or never return."""

import contextlib
import multiprocessing
import os
import signal
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from .confinement import confine
from .processes import describe_exit, watch_parent
from .shield import end_with_parent, shield

_CONTEXT: Any = multiprocessing.get_context("fork" if hasattr(os, "fork") else "spawn")


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
    """

    answers: Connection

    def __init__(
        self,
        do: Callable[..., None],
        *arguments: Any,
        apart: bool = False,
        writable: Sequence[Path] | None = None,
    ) -> None:
        self.answers, theirs = _CONTEXT.Pipe(duplex=False)
        self._process = _CONTEXT.Process(
            target=_called, args=(do, arguments, theirs, apart, writable), daemon=False
        )
        self._process.start()
        theirs.close()

    def is_alive(self) -> bool:
        """Return whether the process is running."""
        return self._process.is_alive()

    def wait(self, patience: float | None = None) -> str:
        """Wait until the process ends, at most `patience` seconds; return how it ended."""
        self._process.join(patience)
        code = self._process.exitcode
        return describe_exit(code) if code is not None else "its end of the pipe closed"

    def signal_at_end(self, patience: float) -> str:
        """Return the signal that ended the process, or an empty text; wait for the end `patience` seconds."""
        self._process.join(patience)
        code = self._process.exitcode
        return describe_exit(code) if code is not None and code < 0 else ""

    def kill(self) -> None:
        """End the process."""
        self._process.kill()

    def close(self) -> None:
        """End the process and all that it started; requires `apart`."""
        self._process.join(0.2)
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
) -> None:
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
    do(answers.send, *arguments)
    answers.close()
    os._exit(0)  # exit handlers of FMU libraries must not run


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
