"""A parent process that reports how a command ended, because an FMU can end the process in any call.

The command leaves its state in `crash_page`. Before the fork, this module imports little more than the
standard library.
"""

import contextlib
import os
import select
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable

from fmublock.files import make_temporary_folder, remove_folder

from ..base.crash_page import CrashPageFile, current_activity, list_busy_activities, share_file
from ..base.interruption import POLITE, ignore_interrupts, is_repeated_request
from ..base.process import describe_exit, watch_parent

_TIMEOUT, _LONG_TIMEOUT = 3.0, 15.0
"""Seconds that a run has to end after the second request: in a call of an FMU, and otherwise."""

_REPORT_DELAYS = 20.0, 3.0
"""Seconds after which a call of an FMU that does not return is reported: without a request, and after one."""

_CHECK_INTERVAL = 1.0
"""Seconds between two looks at what the run does."""


def run_supervised(
    run: Callable[[], None],
    rescue: Callable[[str], None],
    report: Callable[[int, bool], None] = lambda seconds, is_requested: None,
) -> None:
    """Call `run` in a child process, then exit with the exit code of the child.

    The child is in the session of this process, so that it can use the terminal. If the system cannot fork,
    or has no memory or no temporary folder for a child, `run` is called without supervision.

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
    parent, folder, child = os.getpid(), None, None
    with contextlib.suppress(OSError):
        # it is removed however the run ends
        folder = tempfile.tempdir = str(make_temporary_folder("run"))
        share_file(CrashPageFile().path)
        child = os.fork()
    if child == 0:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, POLITE)
        _run_watched(run, parent)
        return
    try:
        if child is None:
            signal.pthread_sigmask(signal.SIG_UNBLOCK, POLITE)
            run()
            return
        code = _Supervision(child, report).wait()
        has_ended = current_activity().ended and code >= 0
        if not has_ended:
            _rescue(rescue, describe_exit(code))
    finally:
        ignore_interrupts()
        if folder is not None:
            remove_folder(folder)
    sys.exit(code if has_ended else 1)


def _run_watched(run: Callable[[], None], parent: int) -> None:
    """Call `run`; the process ends at once when its parent ends."""
    with contextlib.suppress(RuntimeError):  # there is no memory for a thread
        watch_parent(parent, lambda: os.kill(os.getpid(), signal.SIGKILL))
    try:
        run()
    except SystemExit:
        current_activity().ended = 1
        raise
    except Exception as error:  # the state is unknown; even a normal exit of Python may fail
        # without memory even SystemExit fails, and the parent reports that
        if not (current_activity().ended or _is_out_of_memory(error)):
            with contextlib.suppress(Exception):
                traceback.print_exc()
        os._exit(1)
    current_activity().ended = 1


def _is_out_of_memory(error: BaseException | None) -> bool:
    """Return whether an exception was raised because there was no memory."""
    while error is not None and not isinstance(error, MemoryError):
        error = error.__cause__ or error.__context__
    return error is not None


class _Supervision:
    """Waits for a child, passes signals on to it, and reports a call of an FMU that does not return.

    The second request to end starts a timeout, after which the child is killed.
    """

    def __init__(self, child: int, report: Callable[[int, bool], None]) -> None:
        self._child, self._report = child, report
        self._requests, self._reported = 0, set[bool]()
        self._calls = list[bytes]()
        self._requested = self._called = time.monotonic()
        """Times of the last request, and since when the same calls are in progress."""

    def wait(self) -> int:
        """Return the exit code of the child, or the negative number of the signal that ended it."""
        reader, writer = os.pipe()
        os.set_blocking(writer, False)
        signal.set_wakeup_fd(writer, warn_on_full_buffer=False)
        for number in (*POLITE, signal.SIGCHLD):
            signal.signal(number, lambda *_: None)  # the number arrives in the pipe
        signal.pthread_sigmask(signal.SIG_UNBLOCK, POLITE)
        while True:
            pid, status = os.waitpid(self._child, os.WNOHANG)
            if pid:
                return os.waitstatus_to_exitcode(status)
            if select.select([reader], [], [], _CHECK_INTERVAL)[0]:
                for number in os.read(reader, 64):
                    self._pass_on(number)
            self._inspect_child()

    def _pass_on(self, number: int) -> None:
        """Pass a signal to the child if it is one of `POLITE`, and count it as a request to end."""
        if number not in POLITE:
            return
        if not is_repeated_request():
            self._requests, self._requested = self._requests + 1, time.monotonic()
        os.kill(self._child, number)

    def _inspect_child(self) -> None:
        """Kill the child if it does not end in time, or report a call of an FMU that does not return."""
        now, calls = time.monotonic(), [bytes(activity) for activity in list_busy_activities()]
        if calls != self._calls:
            self._calls, self._called = calls, now
        if self._requests >= 2:
            if now - self._requested >= (_TIMEOUT if calls else _LONG_TIMEOUT):
                os.kill(self._child, signal.SIGKILL)
            return
        is_requested = self._requests == 1
        is_late = now - max(self._called, self._requested) >= _REPORT_DELAYS[is_requested]
        if calls and is_late and is_requested not in self._reported:
            self._reported.add(is_requested)
            with contextlib.suppress(OSError):
                _call_in_child(lambda: self._report(round(now - self._called), is_requested))


def _rescue(rescue: Callable[[str], None], how: str) -> None:
    """Call `rescue` in another child, because what it loads can end the process or exhaust the memory."""
    try:
        code = _call_in_child(lambda: rescue(how))
    except OSError:
        rescue(how)
        return
    if code:
        with contextlib.suppress(OSError):
            print(
                f"Error: the run ended: {how}. What it computed could not be saved: {describe_exit(code)}.",
                file=sys.stderr,
            )


def _call_in_child(call: Callable[[], None]) -> int:
    """Call a function in another child, and return how that ended. Raises OSError if there is no child."""
    if child := os.fork():
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    with contextlib.suppress(BaseException):
        call()
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError, ValueError):  # `call` has reported write errors
                stream.flush()
        os._exit(0)
    os._exit(1)
