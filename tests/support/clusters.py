"""Dask clusters for tests: the one of a machine, shared, and one of processes that share nothing."""

import json
import os
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
        folder = self.folder / name
        for subfolder in (folder, folder / "home", folder / "temporary"):
            subfolder.mkdir()
        passed_on = ("PATH", "LD_LIBRARY_PATH", "LANG", "SYSTEMROOT")
        environment = {name: value for name, value in os.environ.items() if name in passed_on}
        environment |= {"PYTHONPATH": path, "POLARS_MAX_THREADS": "1"}
        environment |= {"HOME": str(folder / "home"), "TMPDIR": str(folder / "temporary")}
        command, log = [sys.executable, "-m", *arguments], (folder / "log").open("wb")
        return subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, stderr=log, env=environment)

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
    cluster = Outside(folder)
    try:
        cluster.scheduler = cluster.process(
            "scheduler", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0",
            "--no-dashboard", "--scheduler-file", "where",
        )  # fmt: skip
        where = folder / "scheduler/where"
        wait_for(lambda: where.exists() and '"address"' in where.read_text())

        cluster.address = json.loads(where.read_text())["address"]
        for _ in range(workers):
            cluster.worker(*arguments)
        if workers:
            with Client(cluster.address, set_as_default=False) as client:
                client.wait_for_workers(workers, timeout=60)
        yield cluster
    finally:
        for process in filter(None, [*cluster.workers, cluster.scheduler]):
            for member in family(process):
                member.kill()
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
