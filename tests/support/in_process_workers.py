"""Sweeps on this machine whose variants run in this process: to start another one takes half a second.

All code of a sweep runs but the pipe to a child and its exit; tests/e2e/test_cluster_faults.py tests these.
"""

from collections import deque
from collections.abc import Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

from emla_cosim.analyses.execution import executor, variant_processes
from emla_cosim.analyses.execution.variant_processes import VariantProcess
from emla_cosim.analyses.execution.worker_payload import REGISTRIES


class InProcessChild:
    """The child of a host, without a process: a request runs when it is sent."""

    def __init__(self, _: str, folder: str, **__: Any) -> None:
        self._variants = VariantProcess(Path(folder))
        self._messages = deque[tuple[str, Any]]()

    def send(self, request: Any) -> None:
        """Run the request, and restore what a child changes for itself."""
        registries = {kind: dict(entries) for kind, entries in REGISTRIES.items()}
        try:
            self._messages.append(self._variants.answer(request, self._messages.append))
        finally:
            for kind, entries in REGISTRIES.items():
                entries.clear()
                entries.update(registries[kind])

    def receive(self, timeout: float | None = None) -> Any:
        return self._messages.popleft()

    def is_alive(self) -> bool:
        return True

    def close(self, timeout: float = 0.0) -> None:
        self._variants.close()


class InlineExecutor(Executor):
    """Runs calls when they are submitted."""

    def __init__(self, count: int) -> None:
        pass

    def submit(self, do: Any, /, *arguments: Any, **_: Any) -> Future[Any]:
        future = Future[Any]()
        try:
            future.set_result(do(*arguments))
        except Exception as error:
            future.set_exception(error)
        return future


@contextmanager
def run_in_process() -> Iterator[None]:
    """Let sweeps on this machine run their variants in this process, in sequence."""
    with (
        patch.object(variant_processes, "Child", InProcessChild),
        patch.object(executor, "ThreadPoolExecutor", InlineExecutor),
    ):
        yield
