"""Run variants on the workers of a Dask cluster: each calls the same `VariantHost` as one machine does.

A worker's own process runs no variant, so that one that ends its process or hangs costs no worker.
"""

import gc
import itertools
import math
import pickle
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import contextmanager, nullcontext, suppress
from importlib.metadata import version
from queue import SimpleQueue
from typing import Any, cast

from distributed import Client, Future, KilledWorker, SchedulerPlugin, WorkerPlugin, get_worker
from distributed.comm.core import CommClosedError

from ...base.errors import RunError
from .executor import UNFIT, WorkersLostError, first_line
from .worker_payload import WorkerPayload

_CONNECT_S = 15.0
"""Seconds to wait for an answer of a scheduler."""

_REPORT_DELAY_S = 1.0
"""Seconds without workers after which a note reports this."""

_LOOK_INTERVAL_S = 0.2
"""Seconds between two looks at the number of workers."""

_CONNECTION_ERRORS = (CommClosedError, OSError, CancelledError, TimeoutError)
"""Exceptions if no scheduler answers."""


class DaskWorkers:
    """The workers of a scheduler, which have the payload; see `Workers`.

    Args:
        client: A client of the scheduler.
        payload: What the variants need.
        report: Called with notes.
    """

    def __init__(self, client: Client, payload: WorkerPayload, report: Callable[[str], None]) -> None:
        self._client, self._key, self._patience = client, payload.key, payload.patience
        self._report, self._address = report, str(cast(Any, client.scheduler).addr)
        self._calls = itertools.count()
        self._thread_count, self._last_look = 0, -math.inf
        self._last_worker, self._is_reported = time.monotonic(), False
        self.slow = SimpleQueue[tuple[int, float]]()

    def load(self, payload: WorkerPayload) -> None:
        """Send the payload to all workers, also to those that come later."""
        self._client.subscribe_topic(self._key, lambda event: self.slow.put(tuple(event[1])))
        plugin = _make_host_plugin(self._key, version("emla-cosim"), payload.files, payload.content)
        self._client.register_plugin(_make_removal_plugin(self._key, self._client.id))
        self._client.register_plugin(plugin)

    def threads(self) -> int:
        """Return how many chunks can run at once, and report once that there are no workers.

        Raises:
            RunError: There were no workers for too long.
        """
        now = time.monotonic()
        if now - self._last_look < _LOOK_INTERVAL_S:
            return self._thread_count
        threads: Any = self._client.nthreads()
        self._thread_count, self._last_look = sum(dict(threads).values()), now
        if self._thread_count:
            self._last_worker, self._is_reported = now, False
        elif now - self._last_worker > self._patience:
            raise RunError(
                f"the scheduler at {self._address} had no workers for {self._patience:g} s; start workers, "
                "or wait longer with --patience."
            )
        elif not self._is_reported and now - self._last_worker > _REPORT_DELAY_S:
            self._is_reported = True
            self._report(
                f"Waiting for workers: the scheduler at {self._address} has none. --patience limits the time "
                f"to {self._patience:g} s."
            )
        return self._thread_count

    def submit(self, method: str, argument: Any) -> Future:
        """Call a method of the host of a worker."""
        key = f"{self._key}-{next(self._calls)}"
        # pure would let Dask reuse an answer of the same arguments
        return self._client.submit(_make_call(self._key), method, pickle.dumps(argument), key=key, pure=False)

    def answer(self, task: Future) -> Any:
        """Return the answer of a task that is done. Raise WorkersLostError, or what the call raised."""
        try:
            return pickle.loads(task.result())
        except KilledWorker as error:
            raise WorkersLostError(1 + error.allowed_failures) from error

    def cancel(self, tasks: Sequence[Future]) -> None:
        """Let these tasks not begin, if they have not begun."""
        with suppress(Exception):
            self._client.cancel(list(tasks), force=True)

    def explain(self, error: Exception) -> RunError | None:
        """Return the error that explains an exception that concerns all variants; None for any other."""
        if isinstance(error, _CONNECTION_ERRORS):
            return RunError(f"the scheduler at {self._address} does not answer: {first_line(error)}.")
        if isinstance(error, UNFIT):
            return RunError(
                f"the workers of {self._address} cannot run this: {first_line(error.__cause__ or error)}; "
                "install the same versions of all packages there."
            )
        return None

    def close(self) -> None:
        """End what runs on the workers, and remove the payload from them."""
        with suppress(Exception):
            self._client.unsubscribe_topic(self._key)
        with suppress(Exception):
            self._client.unregister_worker_plugin(self._key)
        with suppress(Exception):
            self._client.unregister_scheduler_plugin(self._key)


def _make_host_plugin(key: str, required: str, files: Mapping[str, bytes], content: bytes) -> WorkerPlugin:
    """Return the plugin that prepares a worker for an analysis.

    Args:
        key: Name of the analysis.
        required: The version of emla-cosim that workers need.
        files: See `WorkerPayload`.
        content: See `WorkerPayload`.
    """

    # defined here, it is sent by value: a worker that cannot import it would end
    class HostPlugin(WorkerPlugin):
        name = key

        def setup(self, worker: Any) -> None:
            try:
                from importlib.metadata import version
                from pathlib import Path
                from tempfile import mkdtemp

                from emla_cosim.analyses.execution.variant_processes import VariantHost
                from emla_cosim.base.errors import CommandError

                if (there := version("emla-cosim")) != required:
                    raise CommandError(
                        f"the worker {worker.address} has emla-cosim {there}, not {required}; install that."
                    )
                # Dask removes its folder even if the worker is killed
                self.folder = Path(mkdtemp(prefix="emla-variants-", dir=worker.local_directory)).resolve()
                self.host = VariantHost(self.folder, worker.state.nthreads)
                self.host.load(files, content)
            except Exception as error:  # a plugin that fails would be lost, and the reason with it
                self.error = error

        def teardown(self, worker: Any) -> None:
            if hasattr(self, "host"):
                from fmublock.files import remove_folder

                self.host.close()
                remove_folder(self.folder)

        def call(self, method: str, argument: bytes) -> bytes:
            if hasattr(self, "error"):
                raise self.error
            if method == "describe":
                return pickle.dumps(self.host.describe(pickle.loads(argument)))

            def report_slow(number: int, seconds: float) -> None:
                get_worker().log_event(key, [number, seconds])

            return pickle.dumps(self.host.run(pickle.loads(argument), report_slow))

    return HostPlugin()


def _make_removal_plugin(key: str, client_id: str) -> SchedulerPlugin:
    """Return the plugin that removes the payload from all workers when its client was killed."""

    class Removal(SchedulerPlugin):
        name = key

        def remove_client(self, scheduler: Any, client: str) -> None:
            if client == client_id:
                scheduler.loop.add_callback(scheduler.unregister_worker_plugin, None, key)
                scheduler.loop.add_callback(scheduler.remove_plugin, key)

    return Removal()


def _make_call(key: str) -> Callable[[str, bytes], bytes]:
    """Return the function of all tasks: it calls a method of the plugin.

    Its argument must be of a type that Python has, for the same reason as the plugin.
    """

    def call(method: str, argument: bytes) -> bytes:
        plugin: Any = get_worker().plugins[key]
        return plugin.call(method, argument)

    return call


@contextmanager
def connect(
    scheduler: str | Client, payload: WorkerPayload, report: Callable[[str], None]
) -> Iterator[DaskWorkers]:
    """Yield the workers of a scheduler, or of a client, which stays open.

    Raises:
        RunError: The scheduler does not answer.
    """
    if isinstance(scheduler, Client):
        if scheduler.status != "running" or scheduler.scheduler is None:
            raise RunError(f"the client in `scheduler` is {scheduler.status}; it must be running.")
        opened = nullcontext(scheduler)
    else:
        opened = _open_client(scheduler)
    with opened as client:
        report(f"Dask's dashboard: {client.dashboard_link}")
        yield DaskWorkers(client, payload, report)


def _open_client(address: str) -> Client:
    """Return a client of a scheduler; raise RunError if none answers."""
    try:
        return Client(address, timeout=_CONNECT_S, set_as_default=False)
    except Exception as error:  # an invalid address may raise anything
        reason = first_line(error)
    gc.collect()  # now: a half-made client hangs if it is collected while another one is created
    raise RunError(f"no scheduler answers at '{address}': {reason}.")
