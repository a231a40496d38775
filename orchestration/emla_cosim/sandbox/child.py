"""A function called in a child process, which may end, fill or never leave that process."""

import contextlib
import multiprocessing
import os
import signal
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from .processes import describe_exit, watch_parent

_CONTEXT: Any = multiprocessing.get_context("fork" if hasattr(os, "fork") else "spawn")


class Child:
    """A process that calls `do` with a function that sends answers, and with these arguments.

    It divides from this one, where systems can do that, and ends when this one does. With `apart` it has a
    group of its own, and what it starts is ended with it. `answers` gives what it sends; EOFError and
    OSError tell that it is no more.
    """

    answers: Connection

    def __init__(self, do: Callable[..., None], *arguments: Any, apart: bool = False) -> None:
        self.answers, theirs = _CONTEXT.Pipe(duplex=False)
        self._process = _CONTEXT.Process(target=_called, args=(do, arguments, theirs, apart), daemon=False)
        self._process.start()
        theirs.close()

    def is_alive(self) -> bool:
        """Whether it has not ended yet."""
        return self._process.is_alive()

    def wait(self, patience: float | None = None) -> str:
        """Wait until it ends, so many seconds at most if given; return how it ended."""
        self._process.join(patience)
        code = self._process.exitcode
        return describe_exit(code) if code is not None else "its end of the pipe closed"

    def close(self) -> None:
        """End it, and what it started, whatever they do; it must have been started `apart`."""
        self._process.join(0.2)
        if hasattr(os, "killpg"):
            with contextlib.suppress(OSError):
                os.killpg(self._process.pid, signal.SIGKILL)
        if self._process.is_alive():
            self._process.kill()
        self._process.join()
        self._process.close()
        self.answers.close()


def _called(do: Callable[..., None], arguments: tuple[Any, ...], answers: Connection, apart: bool) -> None:
    if apart and hasattr(os, "setsid"):
        os.setsid()
    parent = multiprocessing.parent_process()
    if parent is not None and parent.pid is not None:
        watch_parent(parent.pid, _end_all)
    do(answers.send, *arguments)
    answers.close()
    os._exit(0)  # libraries of an FMU have no say in how this process ends


def _end_all() -> None:
    """End the group of processes that this one belongs to."""
    if hasattr(os, "killpg"):
        os.killpg(0, signal.SIGKILL)
    os._exit(1)


def silence() -> None:
    """Let nothing that this process prints be seen."""
    with Path(os.devnull).open("wb") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        os.dup2(nowhere.fileno(), 2)


def limit_memory(memory: int) -> None:
    """Let this process have so many bytes more; no limit where systems know none."""
    try:
        import resource

        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + memory, used + memory))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    except (ImportError, OSError, ValueError):
        return
