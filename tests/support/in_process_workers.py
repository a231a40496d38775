"""A Dask client whose only worker runs variants in this process: a cluster takes seconds to start.

Sweeps, tunings and comparisons take it as `scheduler`. All code of a sweep runs but Dask, the pipe to the
processes of a worker, and the exit of one; tests/e2e/test_cluster_faults.py tests these on real clusters.
"""

import tempfile
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import AbstractContextManager
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

from distributed import Client

from emla_cosim.analyses.execution import worker
from emla_cosim.analyses.execution.idle_processes import WorkerProcess
from emla_cosim.analyses.execution.variant_process import VariantProcess
from emla_cosim.analyses.execution.worker_payload import REGISTRIES


class InProcessWorker(WorkerProcess):
    """The process of a worker, without a process: a request runs when it is sent."""

    def __init__(self) -> None:
        self._variants = VariantProcess()
        self._answers = deque[tuple[str, Any]]()

    def send(self, request: Any) -> None:
        """Run the request, and restore what the process of a worker changes for itself."""
        folder, registries = tempfile.tempdir, {kind: dict(known) for kind, known in REGISTRIES.items()}
        try:
            self._answers.append(self._variants.answer(request, self._answers.append))
        finally:
            tempfile.tempdir = folder
            for kind, known in REGISTRIES.items():
                known.clear()
                known.update(registries[kind])

    def receive(self, timeout: float | None = None) -> Any:
        return self._answers.popleft()

    def is_alive(self) -> bool:
        return True

    def kill(self) -> None:
        raise AssertionError("a variant that takes too long needs a process that can be killed")

    def close(self, timeout: float = 0.0) -> None:
        self.send(("close",))


class InProcessClient(Client):
    """What a sweep uses of `distributed.Client`, with one worker of two threads, which run in sequence."""

    status = "running"
    scheduler = SimpleNamespace(addr="in-process")  # type: ignore[assignment]
    dashboard_link = "none"  # type: ignore[assignment]

    def __init__(self, *_: Any, **__: Any) -> None:
        self._plugins: dict[str, Any] = {}
        self._topics: dict[str, Callable[[Any], None]] = {}
        self._idle: list[InProcessWorker] = []
        self._folder = tempfile.TemporaryDirectory(prefix="in-process-worker-")
        self._worker = SimpleNamespace(
            address="in-process", local_directory=self._folder.name, state=SimpleNamespace(nthreads=2),
            log_event=lambda topic, content: self._topics[topic]((0.0, content)),
        )  # fmt: skip

    def __enter__(self) -> "InProcessClient":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __del__(self) -> None:
        """Do nothing: the client of Dask closes connections."""

    def close(self, *_: Any, **__: Any) -> None:  # type: ignore[override]
        self._folder.cleanup()

    def nthreads(self, *_: Any) -> dict[str, int]:
        return {"in-process": 2}

    def subscribe_topic(self, topic: str, handler: Callable[[Any], None]) -> None:
        self._topics[topic] = handler

    def unsubscribe_topic(self, topic: str) -> None:
        del self._topics[topic]

    def register_plugin(self, plugin: Any, *_: Any, **__: Any) -> None:
        with self._in_this_process():
            plugin.setup(self._worker)
        self._plugins[plugin.name] = plugin

    def unregister_worker_plugin(self, name: str, *_: Any) -> None:  # type: ignore[override]
        with self._in_this_process():
            self._plugins.pop(name).teardown(self._worker)

    def submit(self, _: Any, method: str, argument: Any, *, key: str, pure: bool) -> Any:  # type: ignore[override]
        future = Future[bytes]()
        with self._in_this_process():
            try:
                future.set_result(self._plugins[key.rpartition("-")[0]].call(method, argument))
            except Exception as error:
                future.set_exception(error)
        return future

    def cancel(self, *_: Any, **__: Any) -> None:
        """Do nothing: all futures are done."""

    def folders(self) -> list[Path]:
        """Return what sweeps have left in the folder of the worker."""
        return list(Path(self._folder.name).iterdir())

    def _in_this_process(self) -> AbstractContextManager[Any]:
        return patch.multiple(
            worker,
            WorkerProcess=InProcessWorker,
            start_processes=lambda _: None,
            IDLE=self._idle,
            _IDLE_S=0.0,
        )
