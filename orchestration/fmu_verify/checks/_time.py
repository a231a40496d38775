"""Loops that end in time: an FMU that is slow is not a fault."""

import time
from collections.abc import Iterable, Iterator
from typing import Any


def take_in_time(items: Iterable[Any], seconds: float) -> Iterator[Any]:
    """Yield items until a time in s has passed, counted from the first one."""
    until = time.monotonic() + seconds
    for item in items:
        if time.monotonic() > until:
            return
        yield item
