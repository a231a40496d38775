"""Ctrl-C, or a polite end from outside, as a request that a run can answer between two steps."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

_DEFAULTS = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL}


@contextmanager
def interruption() -> Iterator[Callable[[], bool]]:
    """Turn the first Ctrl-C or SIGTERM into a flag, given as a function; the second one acts at once."""
    requested = False

    def request(signum: int, frame: FrameType | None) -> None:
        nonlocal requested
        requested = True
        for number, default in _DEFAULTS.items():
            signal.signal(number, default)

    try:
        previous = {number: signal.signal(number, request) for number in _DEFAULTS}
    except ValueError:  # not in the main thread: signals are not ours to take
        yield lambda: False
        return
    try:
        yield lambda: requested
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
