"""Ctrl-C while C steps: long calls that a signal must end."""

import os
import signal
import threading
from collections.abc import Callable
from typing import Any

import pytest

from emla_cosim.master.stepping.native_loop import NativeLoop
from emla_cosim.stepper.layout import Failure

STEPS, NEVER = 10**7, 2**40


def interrupt_steps(
    patch: pytest.MonkeyPatch, applies: Callable[[NativeLoop], bool] = lambda loop: True
) -> list[Failure]:
    """Send SIGINT while C does ten million steps without a row; return how its calls end, as they do."""
    ends, run = list[Failure](), NativeLoop.run

    def run_long(loop: NativeLoop, first: int, count: int, clock: Any, steps_per_row: int, rows: Any) -> Any:
        if not applies(loop):
            return run(loop, first, count, clock, steps_per_row, rows)
        timer = threading.Timer(0.05, os.kill, (os.getpid(), signal.SIGINT))
        timer.start()
        try:
            return run(loop, first, STEPS, clock, NEVER, rows)
        finally:
            timer.cancel()
            ends.append(Failure(loop._stepper.failure))

    patch.setattr(NativeLoop, "run", run_long)
    return ends
