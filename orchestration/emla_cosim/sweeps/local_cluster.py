"""A Dask cluster of this machine's cores, in processes apart from the one that asks for it.

They are apart since a program that calls `sweep` may not be one that can be imported again, as worker
processes are started, and so that all of it ends when that program does, however that ends. Nobody else
on this machine can talk to it: connections are encrypted, with keys made for it alone.
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

from ..base.errors import RunError
from ..sandbox.processes import count_cores, make_environment, watch_parent


class ClusterAddress(NamedTuple):
    """Where a scheduler is, and what it takes to talk to it."""

    address: str
    security: Any
    dashboard: str


_CONFIG = {
    "distributed.scheduler.allowed-failures": 0,  # it is `farm` that tries again
    "distributed.scheduler.worker-saturation": 1.0,
    "distributed.worker.profile.enabled": False,  # which looks at every frame all the time
    "distributed.worker.memory.target": False,  # nothing is worth spilling
    "distributed.worker.memory.spill": False,
}


@contextlib.contextmanager
def local_cluster(workers: int | None = None) -> Iterator[ClusterAddress]:
    """A cluster of so many worker processes with one thread each, by default one for each core.

    Raises RunError where it does not come up.
    """
    command = [sys.executable, "-m", __spec__.name, str(workers or 0)]
    with tempfile.TemporaryFile() as said:
        process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=said,
            env=make_environment(),
            start_new_session=True,  # Ctrl-C is for who asked for it
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
                process.stdin.close()  # which asks it to end
            try:
                process.wait(10.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            process.stdout.close()


def main() -> None:
    """Serve until standard input ends, or the parent is gone."""
    folder = tempfile.mkdtemp(prefix="emla-cluster-")
    watch_parent(os.getppid(), lambda: _remove_after_parent(folder))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    os.environ["TMPDIR"] = tempfile.tempdir = folder  # of the workers too, which can be killed
    os.environ.setdefault("POLARS_MAX_THREADS", "1")  # a worker has one core
    answer, sys.stdout = sys.stdout.buffer, sys.stderr  # nothing else may say anything there
    from dask.config import set as configure
    from distributed import LocalCluster, Security

    configure({**_CONFIG, "temporary-directory": folder})
    security = Security.temporary()
    with LocalCluster(
        n_workers=int(sys.argv[1]) or count_cores(),
        threads_per_worker=1,
        processes=True,
        host="127.0.0.1",
        dashboard_address="127.0.0.1:0",
        security=security,
        silence_logs=50,
        local_directory=folder,
    ) as made:
        cluster = cast(Any, made)
        pickle.dump((cluster.scheduler_address, security, cluster.dashboard_link), answer)
        answer.flush()
        sys.stdin.buffer.read()
    sys.stderr.flush()


def _remove_after_parent(folder: str) -> None:
    """The parent was killed: nobody needs this process, its workers and their files any more."""
    for worker in psutil.Process().children(recursive=True):
        with contextlib.suppress(psutil.Error):
            worker.kill()
    shutil.rmtree(folder, ignore_errors=True)
    os._exit(1)


if __name__ == "__main__":
    main()
