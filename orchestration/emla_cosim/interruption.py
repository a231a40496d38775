"""Ctrl-C, or a polite end from outside, as a request that a run can answer between two steps."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

_POLITE = [
    signal.Signals[name] for name in ("SIGINT", "SIGTERM", "SIGHUP") if name in signal.Signals.__members__
]
"""Ctrl-C, the end that a machine or a scheduler asks for, and a terminal that is closed."""


@contextmanager
def interruption() -> Iterator[Callable[[], bool]]:
    """Turn the first of these signals into a flag, given as a function; the second one acts at once."""
    requested = False

    def request(signum: int, frame: FrameType | None) -> None:
        nonlocal requested
        requested = True
        for number in _POLITE:
            signal.signal(number, signal.default_int_handler)

    with _handled(request):
        yield lambda: requested


@contextmanager
def ending_as_ctrl_c() -> Iterator[None]:
    """Let each of these signals raise KeyboardInterrupt, so that everything is tidied up."""
    with _handled(signal.default_int_handler):
        yield


@contextmanager
def _handled(handler: Any) -> Iterator[None]:
    try:
        previous = {number: signal.signal(number, handler) for number in _POLITE}
    except ValueError:  # not in the main thread: signals are not ours to take
        yield
        return
    try:
        yield
    finally:
        for number, earlier in previous.items():
            signal.signal(number, earlier)
