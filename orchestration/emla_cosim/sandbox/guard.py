"""A parent for the process of a run, which an FMU can end with any call: somebody has to say so then.

The run leaves what has to be known in `black_box`. Only what every Python has is imported here, and
nothing before the process divides.
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
"""Seconds that a run has to end when it was asked to twice."""


def run_supervised(run: Callable[[], None], rescue: Callable[[str], None]) -> None:
    """Do `run` in a child process, and end as that ends.

    Where it does not come to an end of its own, one more child calls `rescue` with the way it ended. Without
    processes that can divide, or room for one more, there is no guard.
    """
    if not hasattr(os, "fork"):
        run()
        return
    signal.pthread_sigmask(signal.SIG_BLOCK, POLITE)  # until somebody can answer
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
    """The child as `fork` gives it, None where there can be none; and the folder for temporary files."""
    folder = None
    try:
        memory = mmap(-1, black_box.SIZE)
        folder = _temporary_folder()
        black_box.use_shared_memory(memory)
        return os.fork(), folder
    except OSError:
        return None, folder


def _run_watched(run: Callable[[], None], parent: int) -> None:
    """The run, which ends at once when its parent does."""
    watch_parent(parent, lambda: os.kill(os.getpid(), signal.SIGKILL))
    try:
        run()
    except SystemExit:
        black_box.current_activity().ended = 1
        raise
    except Exception:  # nothing can be relied on, not even that Python comes to its end
        if not black_box.current_activity().ended:  # where memory ends, so does what raises SystemExit
            with contextlib.suppress(Exception):
                traceback.print_exc()
        os._exit(1)
    black_box.current_activity().ended = 1


def _wait_for_child(child: int) -> int:
    """The status of the child when it has ended; what asks this process to end is passed on.

    A child that is asked twice and does not end, because an FMU does not return, is killed.
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
    """Call `rescue` in one more child: what it loads may end its process, too, where memory has ended."""
    try:
        child = os.fork()
    except OSError:
        rescue(how)
        return
    if child == 0:
        with contextlib.suppress(BaseException):
            rescue(how)
            for stream in (sys.stdout, sys.stderr):
                with contextlib.suppress(OSError, ValueError):  # `rescue` has said what cannot be written
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
    """A folder for all temporary files, which then go however the run ends; None where there can be none."""
    try:
        folder = tempfile.mkdtemp(prefix="emla-run-")
    except OSError:
        return None  # `tempdir` names everybody's folder now, which is not ours to remove
    tempfile.tempdir = folder
    return folder
