"""Processes of a worker that run variants, while they wait for the next chunk.

This module does not load Dask, so that the processes of a cluster on this machine load while Dask does.
"""

import pickle
import threading
from typing import Any

from ...base.process import Child

ANSWER, ERROR, READY, OUTCOME = "answer", "error", "ready", "outcome"
"""Kinds of messages: the answer, an exception, the simulation is prepared, and the outcome of a variant."""

PAYLOAD = "payload.pickle"
"""The file with prepared systems and registered objects, beside the FMUs of a sweep."""


class WorkerProcess(Child):
    """A process that runs variants."""

    key: str | None = None
    """The sweep that it has open."""

    def __init__(self) -> None:
        super().__init__(f"{__package__}.variant_process:run_variants")  # loads more than a worker needs

    def call(self, name: str, *arguments: Any, timeout: float | None = None) -> Any:
        """Return the answer to a request. Raise what the process raised, or ChildEndedError."""
        self.send((name, *arguments))
        kind, content = self.receive(timeout)
        if kind != ANSWER:
            raise pickle.loads(content)
        return content


IDLE: list[WorkerProcess] = []
"""Processes that wait for the next chunk, of any sweep. They end with the worker."""

TURN = threading.Lock()


def end_idle() -> None:
    """End the processes that no sweep uses."""
    with TURN:
        for process in [p for p in IDLE if p.key is None]:
            IDLE.remove(process)
            process.close()


def start_processes(count: int) -> None:
    """Start processes until so many are idle: they load while the first one prepares a scenario.

    Raises:
        OSError: A process cannot start.
    """
    with TURN:
        IDLE.extend(WorkerProcess() for _ in range(count - len(IDLE)))
