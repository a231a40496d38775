"""Conversion of Ctrl-C and similar signals to a request that a run handles between two steps."""

import math
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import NoReturn

POLITE = [
    signal.Signals[name] for name in ("SIGINT", "SIGTERM", "SIGHUP") if name in signal.Signals.__members__
]
"""The signals of Ctrl-C, of a system or scheduler that ends the process, and of a closed terminal."""

ONE_REQUEST = 0.3
"""Seconds within which several signals count as one request."""

_flags: list[Callable[[], bool]] = []
"""The flags of the open blocks of `catch_interrupts`."""


class _LastRequest:
    time = -math.inf


@contextmanager
def catch_interrupts() -> Iterator[Callable[[], bool]]:
    """Set a flag on the first of these signals; the second one raises KeyboardInterrupt.

    An inner block uses the flag of the outer one. In a thread, nothing sets the flag.

    Yields:
        A function that returns the flag.
    """
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return
    if _flags:
        yield _flags[-1]
        return
    requested = False
    _LastRequest.time = -math.inf  # forget requests from before this block

    def request() -> None:
        nonlocal requested
        if requested:
            raise KeyboardInterrupt
        requested = True

    _flags.append(lambda: requested)
    try:
        with on_interrupt(request):
            yield _flags[-1]
    finally:
        _flags.pop()


@contextmanager
def on_interrupt(call: Callable[[], None]) -> Iterator[None]:
    """Call a function on each of these signals during the block. In a thread, do nothing."""

    def handle(signum: int, frame: FrameType | None) -> None:
        if not is_repeated_request():
            call()

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    previous = {number: signal.signal(number, handle) for number in POLITE}
    try:
        yield
    finally:
        for number, earlier in previous.items():
            signal.signal(number, earlier)


def raise_interrupt() -> NoReturn:
    """Raise KeyboardInterrupt, so that code that cleans up is executed."""
    raise KeyboardInterrupt


def ignore_interrupts() -> None:
    """Ignore these signals from now on, because the process is about to end."""
    for number in POLITE:
        signal.signal(number, signal.SIG_IGN)


def is_repeated_request() -> bool:
    """Return whether this signal repeats the last one: a process gets it directly and from its parent.

    If not, it counts as the last one from now on.
    """
    now = time.monotonic()
    is_repeated = now - _LastRequest.time < ONE_REQUEST
    if not is_repeated:
        _LastRequest.time = now
    return is_repeated
