"""A Dask cluster on this machine, in a process of its own.

It has the scheduler and one worker, which runs variants in further processes, one for each of its threads. In
a process of its own, the cluster also ends with the program, even if that is killed. Other users of the
machine cannot connect: connections are encrypted with temporary keys.
"""

import atexit
import contextlib
import os
import pickle
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from typing import Any, NamedTuple, cast

import psutil

from fmublock.leftovers import make_temporary_folder

from ..base.errors import RunError
from ..sandbox.processes import count_cores, make_environment, watch_parent
from .idle_processes import start_processes


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
    command = [sys.executable, "-m", __spec__.name, str(workers or 0)]
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=said,
            env=make_environment(),
            start_new_session=True,  # Ctrl-C is for the caller only
        )
        assert process.stdin is not None and process.stdout is not None
        try:
            try:
                place = ClusterAddress(*pickle.load(process.stdout))
            except Exception as error:
                said.seek(0)
                last = said.read().decode(errors="replace").strip().splitlines()[-1:] or ["it said nothing"]
                raise RunError(f"no cluster could be started on this machine: {last[0]}.") from error
            yield place
        finally:
            with contextlib.suppress(OSError):
                process.stdin.close()  # makes it end
            try:
                process.wait(10.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            process.stdout.close()


def main() -> None:
    """Serve until standard input ends or the parent process is gone."""
    folder = str(make_temporary_folder("cluster"))
    watch_parent(os.getppid(), lambda: _remove_after_parent(folder))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    os.environ["TMPDIR"] = tempfile.tempdir = folder  # also for the workers, which may be killed
    os.environ.setdefault("POLARS_MAX_THREADS", "1")  # a worker has one core
    answer, sys.stdout = sys.stdout.buffer, sys.stderr  # nothing else may write to standard output
    threads = int(sys.argv[1]) or count_cores()
    with contextlib.suppress(OSError):  # the worker tries again, and reports it
        start_processes(threads)
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
        cluster = cast(Any, made)
        pickle.dump((cluster.scheduler_address, security), answer)
        answer.flush()
        sys.stdin.buffer.read()
    sys.stderr.flush()


def _remove_after_parent(folder: str) -> None:
    """Kill the workers, remove their files and exit, after the parent was killed."""
    for worker in psutil.Process().children(recursive=True):
        with contextlib.suppress(psutil.Error):
            worker.kill()
    shutil.rmtree(folder, ignore_errors=True)
    os._exit(1)


if __name__ == "__main__":
    main()
