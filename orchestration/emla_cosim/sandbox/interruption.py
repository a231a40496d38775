"""Conversion of Ctrl-C and similar signals to a request that a run handles between two steps."""

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
"""The signals of Ctrl-C, of a system or scheduler that ends the process, and of a closed terminal."""

ONE_REQUEST = 0.3
"""Seconds within which several signals count as one request."""


@contextmanager
def catch_interrupts() -> Iterator[Callable[[], bool]]:
    """Set a flag on the first of these signals; the second one raises KeyboardInterrupt.

    An inner block uses the flag of the outer one.

    Yields:
        A function that returns the flag.
    """
    if _open and threading.current_thread() is threading.main_thread():
        yield _open[-1]
        return
    requested = False
    _LastRequest.request = -math.inf  # forget requests from before this block

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
"""The flags of blocks that handle the signals."""


@contextmanager
def raise_on_interrupt() -> Iterator[None]:
    """Raise KeyboardInterrupt on each of these signals, so that cleanup code runs."""
    with _install_handler(_end):
        yield


@contextmanager
def exit_on_interrupt(end: Callable[[], None]) -> Iterator[None]:
    """Call `end` on each of these signals; an exception could be lost in code of imported modules."""

    def called(signum: int, frame: FrameType | None) -> None:
        if not is_repeated_request():
            end()

    with _install_handler(called):
        yield


def ignore_interrupts() -> None:
    """Ignore these signals from now on, because the process is about to end."""
    for number in POLITE:
        signal.signal(number, signal.SIG_IGN)


def _end(signum: int, frame: FrameType | None) -> None:
    if not is_repeated_request():
        raise KeyboardInterrupt


class _LastRequest:
    request = -math.inf


def is_repeated_request() -> bool:
    """Return whether this signal repeats the last one: a process gets it directly and from its parent."""
    now = time.monotonic()
    if now - _LastRequest.request < ONE_REQUEST:
        return True
    _LastRequest.request = now
    return False


@contextmanager
def _install_handler(handler: Any) -> Iterator[bool]:
    """Install a signal handler for the block; yield whether that is possible."""
    try:
        previous = {number: signal.signal(number, handler) for number in POLITE}
    except ValueError:  # only the main thread can install handlers
        yield False
        return
    try:
        yield True
    finally:
        for number, earlier in previous.items():
            signal.signal(number, earlier)
