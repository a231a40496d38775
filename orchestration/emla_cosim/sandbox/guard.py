"""A parent process that reports how a run ended, because an FMU can end the process in any call.

The run leaves its state in `black_box`. This module imports only the standard library, and nothing else
before the fork.
"""

import contextlib
import os
import shutil
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable
from mmap import mmap

from . import black_box
from .interruption import POLITE, ignore_interrupts, is_repeated_request
from .processes import describe_exit, watch_parent

_TIMEOUT = 3.0
"""Seconds that a run has to end after the second request."""


def run_supervised(run: Callable[[], None], rescue: Callable[[str], None]) -> None:
    """Call `run` in a child process, then exit with the exit code of the child.

    If the system cannot fork, or has no memory left for a child, `run` is called without supervision.

    Args:
        run: The function to call.
        rescue: Called in another child with the way the run ended, if it did not end normally.
    """
    if not hasattr(os, "fork"):
        run()
        return
    signal.pthread_sigmask(signal.SIG_BLOCK, POLITE)  # until handlers are installed
    parent = os.getpid()
    child, folder = _fork_child()
    if child == 0:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, POLITE)
        _run_watched(run, parent)
        return
    try:
        if child is None:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, POLITE)
            run()
            return
        status = _wait_for_child(child)
        whole = black_box.current_activity().ended and os.WIFEXITED(status)
        if not whole:
            _run_rescue(rescue, describe_exit(os.waitstatus_to_exitcode(status)))
    finally:
        ignore_interrupts()
        if folder is not None:
            shutil.rmtree(folder, ignore_errors=True)
    sys.exit(os.WEXITSTATUS(status) if whole else 1)


def _fork_child() -> tuple[int | None, str | None]:
    """Return the result of `fork`, None if it fails, and the folder for temporary files."""
    folder = None
    try:
        memory = mmap(-1, black_box.SIZE)
        folder = _temporary_folder()
        black_box.use_shared_memory(memory)
        return os.fork(), folder
    except OSError:
        return None, folder


def _run_watched(run: Callable[[], None], parent: int) -> None:
    """Call `run`; the process ends at once when its parent ends."""
    watch_parent(parent, lambda: os.kill(os.getpid(), signal.SIGKILL))
    try:
        run()
    except SystemExit:
        black_box.current_activity().ended = 1
        raise
    except Exception:  # the state is unknown; even a normal exit of Python may fail
        if not black_box.current_activity().ended:  # without memory even SystemExit fails
            with contextlib.suppress(Exception):
                traceback.print_exc()
        os._exit(1)
    black_box.current_activity().ended = 1


def _wait_for_child(child: int) -> int:
    """Wait until the child ends, pass signals on to it, and return its status.

    The second request starts a timeout, after which a child that an FMU blocks is killed.
    """
    asked = 0

    def pass_on(number: int, frame: object) -> None:
        nonlocal asked
        asked += not is_repeated_request()
        if asked == 2:
            signal.setitimer(signal.ITIMER_REAL, _TIMEOUT)
        with contextlib.suppress(ProcessLookupError):
            os.kill(child, signal.SIGKILL if number == signal.SIGALRM else number)

    for number in (*POLITE, signal.SIGALRM):
        signal.signal(number, pass_on)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, POLITE)
    return os.waitpid(child, 0)[1]


def _run_rescue(rescue: Callable[[str], None], how: str) -> None:
    """Call `rescue` in another child, because what it loads can end the process or exhaust the memory."""
    try:
        child = os.fork()
    except OSError:
        rescue(how)
        return
    if child == 0:
        with contextlib.suppress(BaseException):
            rescue(how)
            for stream in (sys.stdout, sys.stderr):
                with contextlib.suppress(OSError, ValueError):  # `rescue` has reported write errors
                    stream.flush()
            os._exit(0)
        os._exit(1)
    if end := os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]):
        with contextlib.suppress(OSError):
            print(
                f"Error: the run ended: {how}. What it computed could not be saved: {describe_exit(end)}.",
                file=sys.stderr,
            )


def _temporary_folder() -> str | None:
    """Return a folder for all temporary files, removed however the run ends; None if it cannot be created."""
    try:
        folder = tempfile.mkdtemp(prefix="emla-run-")
    except OSError:
        return None  # keep the default folder, which other programs share
    tempfile.tempdir = folder
    return folder
