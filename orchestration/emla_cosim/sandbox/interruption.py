"""Ctrl-C, or a polite end from outside, as a request that a run can answer between two steps."""

import math
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

POLITE = [
    signal.Signals[name] for name in ("SIGINT", "SIGTERM", "SIGHUP") if name in signal.Signals.__members__
]
"""Ctrl-C, the end that a machine or a scheduler asks for, and a terminal that is closed."""

ONE_REQUEST = 0.3
"""Seconds within which several signals are one request."""


@contextmanager
def catch_interrupts() -> Iterator[Callable[[], bool]]:
    """Turn the first of these signals into a flag, given as a function; the second one acts at once.

    Within another such block it is one with that: the flag is the same.
    """
    if _open and threading.current_thread() is threading.main_thread():
        yield _open[-1]
        return
    requested = False
    _LastRequest.request = -math.inf  # what came before was meant for something else

    def request(signum: int, frame: FrameType | None) -> None:
        nonlocal requested
        if is_repeated_request():
            return
        requested = True
        for number in POLITE:
            signal.signal(number, _end)

    def asked() -> bool:
        return requested

    with _install_handler(request) as ours:
        if not ours:
            yield asked
            return
        _open.append(asked)
        try:
            yield asked
        finally:
            _open.pop()


_open: list[Callable[[], bool]] = []
"""The flag of the block that has the signals, while there is one."""


@contextmanager
def raise_on_interrupt() -> Iterator[None]:
    """Let each of these signals raise KeyboardInterrupt, so that everything is tidied up."""
    with _install_handler(_end):
        yield


@contextmanager
def exit_on_interrupt(end: Callable[[], None]) -> Iterator[None]:
    """Let each of these signals call `end`: while modules are imported an exception would come to anybody."""

    def called(signum: int, frame: FrameType | None) -> None:
        if not is_repeated_request():
            end()

    with _install_handler(called):
        yield


@contextmanager
def defer_interrupts() -> Iterator[None]:
    """Let these signals act at the end of the block: an exception in what C calls would be lost."""
    held: list[int] = []
    try:
        with _install_handler(lambda signum, frame: held.append(signum)):
            yield
    finally:
        if held:
            signal.raise_signal(held[0])


def ignore_interrupts() -> None:
    """From now on these signals do nothing: nothing is left that could be ended early."""
    for number in POLITE:
        signal.signal(number, signal.SIG_IGN)


def _end(signum: int, frame: FrameType | None) -> None:
    if not is_repeated_request():
        raise KeyboardInterrupt


class _LastRequest:
    request = -math.inf


def is_repeated_request() -> bool:
    """Whether this is the last request again: it comes to a process and to its parent, which passes it on."""
    now = time.monotonic()
    if now - _LastRequest.request < ONE_REQUEST:
        return True
    _LastRequest.request = now
    return False


@contextmanager
def _install_handler(handler: Any) -> Iterator[bool]:
    """Let `handler` take the signals; whether it can."""
    try:
        previous = {number: signal.signal(number, handler) for number in POLITE}
    except ValueError:  # not in the main thread: signals are not ours to take
        yield False
        return
    try:
        yield True
    finally:
        for number, earlier in previous.items():
            signal.signal(number, earlier)
