"""Run the variants of one analysis in processes of their own.

An FMU may end its process, fill its memory or never return. So a host starts a process for each thread that
calls it, and replaces one that ends or takes too long. This module loads fast, and its processes load the
rest while their caller prepares a scenario.
"""

import math
import os
import pickle
import platform
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from ...base.errors import RunError
from ...base.process import Child, ChildEndedError, ChildPool
from .chunk_queue import ChunkAnswer, ChunkRequest

ANSWER, ERROR, READY, OUTCOME = "answer", "error", "ready", "outcome"
"""Kinds of messages: the answer, an exception, the simulation is prepared, and the outcome of a variant."""

PAYLOAD = "payload.pickle"
"""The file with prepared systems and registered objects, beside the FMUs."""

_SLOW_S = 10.0
"""Seconds after which a variant that still runs is reported; again after twice the time."""

_CLOSE_S = 2.0
"""Seconds that an idle process may take to end its FMUs."""


class VariantHost:
    """A folder with the FMUs and systems of one analysis, and the processes that run its variants.

    Threads may call the methods at the same time.

    Args:
        folder: An empty folder, which the processes remove if this one is killed.
        count: Number of processes. They start now, and read the folder at the first request.

    Raises:
        RunError: A process cannot start.
    """

    def __init__(self, folder: Path, count: int) -> None:
        self.count, self._folder, self._is_loaded = count, folder, False
        self._pool = ChildPool(self._start, count)

    def load(self, files: Mapping[str, bytes], content: bytes) -> None:
        """Write the files of a `WorkerPayload`. Raise RunError if they cannot be written."""
        self._is_loaded = True
        try:
            for name, file in {**files, PAYLOAD: content}.items():
                path = self._folder / name
                path.parent.mkdir(exist_ok=True)
                path.write_bytes(file)
        except OSError as error:
            raise RunError(
                f"the FMUs cannot be written to a temporary folder on {platform.node()}: {error}."
            ) from error

    def describe(self, group: int) -> bytes:
        """Return the pickled `SimulationDescription` of a group.

        Raises:
            CosimError: The simulation cannot be prepared.
        """
        with self._pool.member() as child:
            try:
                child.send(("describe", group))
                return _receive(child)[1]
            except ChildEndedError as error:
                raise RunError(
                    f"the process that prepares the scenario ended ({error}): an FMU crashed it, or it ran "
                    "out of memory."
                ) from error

    def run(self, request: ChunkRequest, report_slow: Callable[[int, float], None]) -> ChunkAnswer:
        """Run variants in sequence. One that ends its process, or takes too long, ends the chunk.

        Args:
            request: The variants.
            report_slow: Called with the number of a variant that still runs after a while, and its time in s.
        """
        outcomes, numbers, work_s = list[bytes](), request.numbers, 0.0
        limit = math.inf if request.timeout is None else request.timeout
        with self._pool.member(request.is_exclusive) as child:
            try:
                child.send(("run", request))
                _receive(child)  # the simulation is prepared, which may take any time
                while len(outcomes) < len(numbers):
                    start = time.monotonic()
                    kind, content = _receive(child, limit, partial(report_slow, numbers[len(outcomes)]))
                    if kind == ANSWER:
                        return ChunkAnswer(outcomes, *content)
                    outcomes.append(content)
                    work_s += time.monotonic() - start
                return ChunkAnswer(outcomes, *_receive(child)[1])
            except TimeoutError:
                child.kill()
                ended, timed_out = None, numbers[len(outcomes)]
            except ChildEndedError as error:
                if self._pool.is_closed:
                    raise RunError("the analysis was cancelled.") from error
                crashed = min(len(outcomes), len(numbers) - 1)  # it may end after its last variant
                ended, timed_out = (numbers[crashed], str(error)), None
                del outcomes[crashed:]
        if request.has_signals:  # they are lost with the process
            outcomes.clear()
        return ChunkAnswer(outcomes, work_s, ended=ended, timed_out=timed_out)

    def close(self) -> None:
        """End the processes, also those that run variants. The folder may remain."""
        self._pool.close(_CLOSE_S if self._is_loaded else 0.0)

    def _start(self) -> Child:
        function = f"{__package__}.variant_process:run_variants"  # loads more than this process needs
        environment = {
            "POLARS_MAX_THREADS": os.environ.get("POLARS_MAX_THREADS", "1"),  # each process has one core
            "TMPDIR": str(self._folder),  # for what is unpacked and what FMUs leave: it ends with the folder
        }
        try:
            return Child(function, str(self._folder), environment=environment)
        except OSError as error:
            raise RunError(f"no process can be started on {platform.node()}: {error.strerror}.") from error


def _receive(
    child: Child, limit: float = math.inf, report_slow: Callable[[float], None] | None = None
) -> tuple[str, Any]:
    """Return kind and content of the next message. Raise what the child raised.

    Raises:
        TimeoutError: There is none for `limit` seconds.
    """
    start, next_report = time.monotonic(), _SLOW_S
    while True:
        elapsed = time.monotonic() - start
        if elapsed >= limit:
            raise TimeoutError
        if elapsed >= next_report:
            next_report *= 2.0
            if report_slow is not None:
                report_slow(elapsed)
        with suppress(TimeoutError):
            kind, content = child.receive(min(next_report, limit) - elapsed)
            break
    if kind == ERROR:
        raise pickle.loads(content)
    return kind, content
