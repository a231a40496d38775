"""Dask clusters for tests: the one of a machine, shared, and one of processes that share nothing."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil
from distributed import Client, LocalCluster

from emla_cosim.base.progress import Progress
from tests.support.paths import ROOT
from tests.support.waiting import wait_for

CODE = os.pathsep.join([str(ROOT / "src"), str(ROOT / "orchestration"), str(ROOT)])


@contextmanager
def shared_cluster(threads: int = 2) -> Iterator[Client]:
    """A client of a Dask cluster with one worker, in a process of its own."""
    with (
        LocalCluster(
            n_workers=1, threads_per_worker=threads, dashboard_address="127.0.0.1:0", silence_logs=50
        ) as cluster,
        Client(cluster, set_as_default=False) as client,
    ):  # fmt: skip
        yield client


@dataclass
class Outside:
    """A scheduler and workers as processes, each with its own folder, home and temporary files."""

    folder: Path
    address: str = ""
    scheduler: Any = None
    workers: list[Any] = field(default_factory=list)

    def process(self, name: str, *arguments: str, path: str = CODE) -> subprocess.Popen[bytes]:
        own = self.folder / name
        for place in (own, own / "home", own / "temporary"):
            place.mkdir()
        kept = {n: x for n, x in os.environ.items() if n in ("PATH", "LD_LIBRARY_PATH", "LANG", "SYSTEMROOT")}
        return subprocess.Popen(
            [sys.executable, "-m", *arguments],
            cwd=own, stdout=subprocess.DEVNULL, stderr=(own / "log").open("wb"),
            env={**kept, "PYTHONPATH": path, "HOME": str(own / "home"), "TMPDIR": str(own / "temporary"),
                 "POLARS_MAX_THREADS": "1"},
        )  # fmt: skip

    def kill_scheduler(self) -> None:
        self.scheduler.send_signal(signal.SIGKILL)

    def worker(self, *arguments: str, path: str = CODE) -> subprocess.Popen[bytes]:
        """Start a worker with one thread."""
        self.workers.append(
            self.process(
                f"worker-{len(self.workers)}", "distributed.cli.dask_worker", self.address, *arguments,
                "--nthreads", "1", "--no-dashboard", "--host", "127.0.0.1", path=path,
            )
        )  # fmt: skip
        return self.workers[-1]


@contextmanager
def outside_cluster(
    folder: Path, workers: int = 2, arguments: Sequence[str] = ("--no-nanny",)
) -> Iterator[Outside]:
    """The same, with its processes ended in the end."""
    found = Outside(folder)
    try:
        found.scheduler = found.process(
            "scheduler", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0",
            "--no-dashboard", "--scheduler-file", "where",
        )  # fmt: skip
        where = folder / "scheduler/where"
        wait_for(lambda: where.exists() and '"address"' in where.read_text())

        found.address = json.loads(where.read_text())["address"]
        for _ in range(workers):
            found.worker(*arguments)
        if workers:
            with Client(found.address, set_as_default=False) as client:
                client.wait_for_workers(workers, timeout=60)
        yield found
    finally:
        for process in filter(None, [*found.workers, found.scheduler]):
            for one in family(process):
                one.kill()
            process.wait()


def family(process: Any) -> list[psutil.Process]:
    """A process and all that it started, directly or not."""
    try:
        parent = psutil.Process(process.pid)
        return [parent, *parent.children(recursive=True)]
    except psutil.NoSuchProcess:
        return []


@dataclass
class At(Progress):
    """Calls something once, when so many variants are there."""

    variants: int
    call: Any
    there: int = 0
    counting: bool = False

    def begin(self, task: str, total: int, unit: str = "") -> None:
        self.there = 0
        self.counting = unit == "variants"

    def advance(self, count: int) -> None:
        self.there += count
        if self.counting and self.there >= self.variants and self.call is not None:
            call, self.call = self.call, None
            call()
