"""Code that runs on Dask's workers: they pass variants on to processes of their own.

An FMU may end its process, fill its memory or never return. So no variant runs in a worker's own process: a
worker starts a process for each of its threads, and replaces it when it ends or takes too long.
"""

import contextlib
import os
import pickle
import shutil
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from distributed import WorkerPlugin, get_worker

from ...base.errors import CommandError, RunError
from ...base.process import ChildEndedError
from .idle_processes import (
    ANSWER,
    IDLE,
    OUTCOME,
    PAYLOAD,
    READY,
    TURN,
    WorkerProcess,
    end_idle,
    start_processes,
)

_LOOK = 0.2
"""Seconds between two looks at the variants that run."""

_SLOW_S = 10.0
"""Seconds after which a worker reports a variant that still runs; again after twice the time."""

_IDLE_S = 60.0
"""Seconds after the last sweep for which a worker keeps its processes for the next one."""

_CLOSE_S = 2.0
"""Seconds that an idle process may take to close a sweep."""


@dataclass(frozen=True)
class ChunkRequest:
    """Variants to run.

    Attributes:
        group: Position of their preparation.
        numbers: Numbers of the variants.
        content: The variants and measures, pickled.
        has_signals: Whether signals are kept.
        seconds: Time in s after which no further variant begins.
        timeout: Longest time of a variant in s; None without a limit.
        alone: Whether a process runs these variants and no others.
    """

    group: int
    numbers: Sequence[int]
    content: bytes
    has_signals: bool
    seconds: float
    timeout: float | None
    alone: bool = False


@dataclass(frozen=True)
class ChunkAnswer:
    """What came out of a chunk. The variants without outcome did not run.

    Attributes:
        outcomes: Outcomes, each pickled, in the order of the variants.
        wall_s: Duration in s.
        series: Signals of these variants as a Parquet file.
        ended: Number of the variant whose process ended, and how.
        timed_out: Number of the variant that took too long.
    """

    outcomes: Sequence[bytes]
    wall_s: float
    series: bytes | None = None
    ended: tuple[int, str] | None = None
    timed_out: int | None = None


def make_plugin(
    key: str, needed: str, files: Mapping[str, tuple[str, bytes]], content: bytes
) -> WorkerPlugin:
    """Return what prepares a worker for a sweep.

    Args:
        key: Name of the sweep.
        needed: The version of emla-cosim that workers need.
        files: Names and contents of FMU files by hash.
        content: Prepared systems and registered objects, pickled.
    """

    # defined here, it is sent by value: a worker that cannot import it would end
    class SweepPlugin(WorkerPlugin):
        name = key

        def setup(self, worker: Any) -> None:
            try:
                from emla_cosim.analyses.execution.worker import SweepProcesses

                self.processes = SweepProcesses(worker, key, needed, files, content)
            except Exception as error:  # a plugin that fails would be lost, and the reason with it
                self.error = error

        def teardown(self, worker: Any) -> None:
            if hasattr(self, "processes"):
                self.processes.close()

        def call(self, method: str, argument: Any) -> bytes:
            if hasattr(self, "error"):
                raise self.error
            return getattr(self.processes, method)(argument)

    return SweepPlugin()


def make_call(key: str) -> Callable[[str, Any], bytes]:
    """Return the function of all tasks: it calls a method of the `SweepProcesses` of a sweep.

    Its argument must be of a type that Python has, for the same reason as the plugin.
    """

    def call(method: str, argument: Any) -> bytes:
        plugin: Any = get_worker().plugins[key]
        return plugin.call(method, argument)

    return call


class _RunningChunk:
    """A chunk that runs, as the thread that watches it sees it."""

    def __init__(self, process: WorkerProcess, request: ChunkRequest) -> None:
        self._process, self._request = process, request
        self._turn = threading.Lock()
        self._began: float | None = None
        self._next_report = _SLOW_S
        self.outcomes: list[bytes] = []
        self.timed_out: int | None = None
        self.work_s = 0.0

    @property
    def current(self) -> int | None:
        """The number of the variant that runs; None while the simulation is prepared, and at the end."""
        done = len(self.outcomes)
        if self._began is None or done == len(self._request.numbers):
            return None
        return self._request.numbers[done]

    def advance(self, outcome: bytes | None = None) -> None:
        """Note that the first variant begins, or that one has this outcome."""
        with self._turn:
            now = time.monotonic()
            if outcome is not None and self._began is not None:
                self.outcomes.append(outcome)
                self.work_s += now - self._began
            self._began, self._next_report = now, _SLOW_S

    def look(self) -> tuple[int, float] | None:
        """End the process if its variant takes too long. Return number and time of a variant to report."""
        with self._turn:
            number = self.current
            if number is None or self._began is None:
                return None
            spent, timeout = time.monotonic() - self._began, self._request.timeout
            if timeout is not None and spent > timeout:
                self.timed_out, self._began = number, None
                self._process.kill()
                return None
            if spent < self._next_report:
                return None
            self._next_report *= 2.0
            return number, spent


class SweepProcesses:
    """The folder of a sweep on a worker, and the processes that run its variants."""

    def __init__(
        self, worker: Any, key: str, needed: str, files: Mapping[str, tuple[str, bytes]], content: bytes
    ) -> None:
        """Write the files. Raise CommandError for another version, and OSError if they cannot be written."""
        self._worker, self._key = worker, key
        self._running: set[_RunningChunk] = set()
        self._used: set[WorkerProcess] = set()
        self._closed = threading.Event()
        self._files: dict[str, str] = {}
        if (here := version("emla-cosim")) != needed:
            raise CommandError(
                f"the worker {worker.address} has emla-cosim {here}, not {needed}; install that."
            )
        # Dask removes its folder even if the worker is killed
        folder = tempfile.mkdtemp(prefix="emla-sweep-", dir=worker.local_directory)
        self._folder = os.path.realpath(folder)
        for sha, (name, file) in files.items():
            place = Path(self._folder, sha[:16], name)
            place.parent.mkdir(exist_ok=True)
            place.write_bytes(file)
            self._files[sha] = f"{sha[:16]}/{name}"
        Path(self._folder, PAYLOAD).write_bytes(content)
        start_processes(worker.state.nthreads)
        threading.Thread(target=self._watch, daemon=True).start()

    def describe(self, group: int) -> bytes:
        """Describe the simulation of a group, as a pickled `SimulationDescription`.

        Raises:
            CosimError: The simulation cannot be prepared.
        """
        with self._process() as process:
            try:
                return process.call("describe", group)
            except ChildEndedError as error:
                raise RunError(
                    f"the process that prepares the scenario ended ({error}): an FMU crashed it, or it ran "
                    "out of memory."
                ) from error

    def run(self, content: bytes) -> bytes:
        """Run the variants of a `ChunkRequest` in sequence; return the `ChunkAnswer`. Both are pickled."""
        request: ChunkRequest = pickle.loads(content)
        with self._process(request.alone) as process:
            return pickle.dumps(self._run(process, request))

    @contextlib.contextmanager
    def _process(self, alone: bool = False) -> Iterator[WorkerProcess]:
        """Take an idle process, or start one, and open the sweep in it.

        Args:
            alone: Whether to replace the idle process by one that ends afterwards.
        """
        with TURN:
            found = next((p for p in IDLE if p.key == self._key), IDLE[-1] if IDLE else None)
            if found is not None:
                IDLE.remove(found)
        if alone and found is not None:
            found.close()
            found = None
        try:
            found = self._open(found or WorkerProcess())
        except ChildEndedError:  # it was idle and did not survive; a new one tells why
            found = self._open(WorkerProcess())
        with TURN:
            self._used.add(found)
        try:
            yield found
        finally:
            with TURN:
                self._used.discard(found)
                if found.is_alive() and not alone and not self._closed.is_set():
                    IDLE.append(found)
                else:
                    found.close()

    def _open(self, process: WorkerProcess) -> WorkerProcess:
        try:
            process.call("open", self._folder, self._files)
        except BaseException:
            process.close()
            raise
        process.key = self._key
        return process

    def _run(self, process: WorkerProcess, request: ChunkRequest) -> ChunkAnswer:
        running = _RunningChunk(process, request)
        self._running.add(running)
        try:
            process.send(("run", request.group, request.content, request.seconds))
            while True:
                kind, content = process.receive()
                if kind == READY:
                    running.advance()
                elif kind == OUTCOME:
                    running.advance(content)
                elif kind == ANSWER:
                    wall_s, series = content
                    return ChunkAnswer(running.outcomes, wall_s, series)
                else:
                    raise pickle.loads(content)
        except ChildEndedError as error:
            if self._closed.is_set():
                raise RunError("the sweep was ended.") from error
            return self._answer_of_ended(running, request, str(error))
        finally:
            self._running.discard(running)

    def _answer_of_ended(self, running: _RunningChunk, request: ChunkRequest, how: str) -> ChunkAnswer:
        """Return the answer if the process ended: only the variant that ran is to blame."""
        numbers, late = request.numbers, running.timed_out
        done = min(len(running.outcomes), len(numbers) - 1)  # it may end after its last variant
        outcomes = [] if request.has_signals else running.outcomes  # the signals are lost with the process
        if late is None:
            return ChunkAnswer(outcomes[:done], running.work_s, ended=(numbers[done], how))
        if late != numbers[done]:  # it was done just before its process was ended
            late = None
        return ChunkAnswer(outcomes[: done + (late is None)], running.work_s, timed_out=late)

    def _watch(self) -> None:
        """Look at the variants that run, until the sweep is closed."""
        while not self._closed.wait(_LOOK):
            for running in list(self._running):
                if (slow := running.look()) is not None:
                    self._worker.log_event(self._key, list(slow))

    def close(self) -> None:
        """End processes that still run variants, close the sweep in idle ones, and remove the files."""
        self._closed.set()
        with TURN:
            for process in self._used:
                process.kill()
            for process in [p for p in IDLE if p.key == self._key]:
                try:
                    process.call("close", timeout=_CLOSE_S)
                    process.key = None
                except Exception:  # an FMU does not end
                    IDLE.remove(process)
                    process.close()
        shutil.rmtree(self._folder, ignore_errors=True)
        timer = threading.Timer(_IDLE_S, end_idle)
        timer.daemon = True
        timer.start()
