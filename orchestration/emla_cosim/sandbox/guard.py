"""A parent process that reports how a run ended, because an FMU can end the process in any call.

The run leaves its state in `crash_page`. This module imports only the standard library, and nothing else
before the fork.
"""

import contextlib
import os
import signal
import sys
import tempfile
import traceback
from collections.abc import Callable
from mmap import mmap

from fmublock.leftovers import make_temporary_folder, remove_folder

from . import crash_page
from .interruption import POLITE, ignore_interrupts, is_repeated_request
from .processes import describe_exit, watch_parent

_TIMEOUT, _LONG_TIMEOUT = 3, 15
"""Seconds that a run has to end after the second request: in a call of an FMU, and otherwise."""

_PATIENCE = 3, 20
"""Seconds after which a call of an FMU that does not return is reported: after a request, and without one."""


def run_supervised(
    run: Callable[[], None],
    rescue: Callable[[str], None],
    report: Callable[[int, bool], None] = lambda seconds, asked: None,
) -> None:
    """Call `run` in a child process, then exit with the exit code of the child.

    If the system cannot fork, or has no memory or no temporary folder for a child, `run` is called without
    supervision.

    Args:
        run: The function to call.
        rescue: Called in another child with the way the run ended, if it did not end normally.
        report: Called in another child when a call of an FMU does not return, with the seconds so far, and
            whether the run was asked to end.
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
        status = _wait_for_child(child, report)
        whole = crash_page.current_activity().ended and os.WIFEXITED(status)
        if not whole:
            _run_rescue(rescue, describe_exit(os.waitstatus_to_exitcode(status)))
    finally:
        ignore_interrupts()
        if folder is not None:
            remove_folder(folder)
    sys.exit(os.WEXITSTATUS(status) if whole else 1)


def _fork_child() -> tuple[int | None, str | None]:
    """Return the result of `fork`, None if there is no child, and the folder for temporary files.

    The folder is removed however the run ends. Without one, there is no child.
    """
    folder = None
    try:
        folder = tempfile.tempdir = str(make_temporary_folder("run"))
        crash_page.use_shared_memory(mmap(-1, crash_page.SIZE))
        return os.fork(), folder
    except OSError:
        return None, folder


def _run_watched(run: Callable[[], None], parent: int) -> None:
    """Call `run`; the process ends at once when its parent ends."""
    with contextlib.suppress(RuntimeError):  # there is no memory for a thread
        watch_parent(parent, lambda: os.kill(os.getpid(), signal.SIGKILL))
    try:
        run()
    except SystemExit:
        crash_page.current_activity().ended = 1
        raise
    except Exception as error:  # the state is unknown; even a normal exit of Python may fail
        # without memory even SystemExit fails, and the parent reports that
        if not (crash_page.current_activity().ended or _needs_memory(error)):
            with contextlib.suppress(Exception):
                traceback.print_exc()
        os._exit(1)
    crash_page.current_activity().ended = 1


def _needs_memory(error: BaseException | None) -> bool:
    """Return whether an exception was raised because there was no memory."""
    while error is not None and not isinstance(error, MemoryError):
        error = error.__cause__ or error.__context__
    return error is not None


def _wait_for_child(child: int, report: Callable[[int, bool], None]) -> int:
    """Wait until the child ends, pass signals on to it, and return its status.

    A call of an FMU that does not return is reported. The second request starts a timeout, after which the
    child is killed.
    """
    asked, waited, late, reported = 0, 0, 0, set[bool]()
    before: list[bytes] = []

    def pass_on(number: int, frame: object) -> None:
        nonlocal asked, late
        if not is_repeated_request():
            asked, late = asked + 1, 0
        with contextlib.suppress(ProcessLookupError):
            os.kill(child, number)

    def look(number: int, frame: object) -> None:
        """Look each second at what the child does."""
        nonlocal before, waited, late
        calls = [bytes(activity) for activity in crash_page.list_busy_activities()]
        waited, late = waited + 1 if calls and calls == before else 0, late + 1
        before = calls
        if asked >= 2 and late >= (_TIMEOUT if calls else _LONG_TIMEOUT):
            with contextlib.suppress(ProcessLookupError):
                os.kill(child, signal.SIGKILL)
        if asked < 2 and min(waited, late) >= _PATIENCE[not asked] and bool(asked) not in reported:
            reported.add(bool(asked))
            _run_report(report, waited, bool(asked))

    for signum in POLITE:
        signal.signal(signum, pass_on)
    signal.signal(signal.SIGALRM, look)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, POLITE)
    signal.setitimer(signal.ITIMER_REAL, 1.0, 1.0)
    try:
        return os.waitpid(child, 0)[1]
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def _run_report(report: Callable[[int, bool], None], seconds: int, asked: bool) -> None:
    """Call `report` in another child, which loads more than this process needs."""
    with contextlib.suppress(OSError):
        if (child := os.fork()) == 0:
            with contextlib.suppress(BaseException):
                signal.setitimer(signal.ITIMER_REAL, 0.0)
                report(seconds, asked)
            os._exit(0)
        os.waitpid(child, 0)


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
