"""A Dask cluster on this machine, in a process of its own.

It has the scheduler and one worker, which runs variants in further processes, one for each of its threads. In
a process of its own, the cluster also ends with the program, even if that is killed. Other users of the
machine cannot connect: connections are encrypted with temporary keys.
"""

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from functools import partial
from typing import Any, NamedTuple, cast

import psutil

from fmublock.leftovers import make_temporary_folder

from ...base.channel import Channel
from ...base.errors import RunError
from ...base.process import Child, ChildEndedError, count_cores, silence
from .idle_processes import start_processes

_CLOSE_S = 10.0
"""Seconds that the cluster may take to end and to remove its files."""


class ClusterAddress(NamedTuple):
    """Address and security of a scheduler."""

    address: str
    security: Any


_CONFIG = {
    "distributed.scheduler.http.routes": [],  # the dashboard would answer all local users
    "distributed.worker.http.routes": [],
    "distributed.scheduler.worker-saturation": 1.0,
    "distributed.worker.profile.enabled": False,  # sampling costs time
    "distributed.worker.memory.target": False,  # there is nothing to spill
    "distributed.worker.memory.spill": False,
    "distributed.admin.tick.interval": "1s",  # Dask looks 50 times a second whether its loop is late
    "distributed.admin.system-monitor.interval": "10s",  # only the dashboard shows it
    "distributed.scheduler.work-stealing": False,  # there is one worker
    "distributed.scheduler.active-memory-manager.start": False,
    "distributed.diagnostics.nvml": False,
}


@contextlib.contextmanager
def local_cluster(workers: int | None = None) -> Iterator[ClusterAddress]:
    """Start a cluster that runs variants in `workers` processes; default: one for each core.

    Raises:
        RunError: The cluster does not start.
    """
    child = Child(_serve, workers or count_cores())
    try:
        try:
            answer = child.receive()
        except ChildEndedError as error:
            answer = f"its process ended ({error})"
        if not isinstance(answer, ClusterAddress):
            raise RunError(f"no cluster could be started on this machine: {answer}.")
        yield answer
    finally:
        child.close(_CLOSE_S)


def _serve(channel: Channel, threads: int) -> None:
    """Run a cluster until the parent closes the channel. Send its address, or why there is none."""
    silence()
    folder = str(make_temporary_folder("cluster"))
    channel.at_end_of_parent = partial(_remove, folder)
    os.environ["TMPDIR"] = tempfile.tempdir = folder  # also for the workers, which may be killed
    os.environ.setdefault("POLARS_MAX_THREADS", "1")  # a worker has one core
    with contextlib.suppress(OSError):  # the worker tries again, and reports it
        start_processes(threads)
    try:
        with _start(threads, folder) as (address, security):
            channel.send(ClusterAddress(address, security))
            for _ in channel.requests():
                pass
    except Exception as error:
        channel.send(f"{type(error).__name__}: {error}")
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@contextlib.contextmanager
def _start(threads: int, folder: str) -> Iterator[tuple[str, Any]]:
    """Start scheduler and worker, and yield address and security."""
    from dask.config import set as configure
    from distributed import LocalCluster, Security

    configure({**_CONFIG, "temporary-directory": folder})
    security = Security.temporary()
    with LocalCluster(
        n_workers=1,
        threads_per_worker=threads,
        processes=False,
        protocol="tls://",
        host="127.0.0.1",
        memory_limit=0,  # variants run in other processes
        dashboard_address="127.0.0.1:0",
        scheduler_kwargs={"dashboard": False},
        security=security,
        silence_logs=50,
        local_directory=folder,
    ) as made:
        yield cast(Any, made).scheduler_address, security


def _remove(folder: str) -> None:
    """Kill the workers and remove their files, after the parent was killed."""
    for worker in psutil.Process().children(recursive=True):
        with contextlib.suppress(psutil.Error):
            worker.kill()
    shutil.rmtree(folder, ignore_errors=True)
