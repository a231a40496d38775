"""Count sweeps with variants that end processes: python -m benchmarks.killers --seed 1.

A sweep of 40 variants has one or three killers at random positions. On each cluster, all sweeps must end in
time, blame the killers alone, keep every other variant, and leave as many workers as there were.
"""

import argparse
import os
import random
import signal
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from distributed import Client, LocalCluster

from emla_cosim.analyses.sweep.runner import sweep
from emla_cosim.analyses.variants.measures import DIED, DONE
from tests.support.clusters import outside_cluster
from tests.support.faulty_systems import line_with_a_fault
from tests.support.hand_written_fmus import Fault, build_faulty_fmu

VARIANTS, LONGEST_S = 40, 180.0
STEP_SIZE, STOP_TIME = 0.001, 0.01

WAYS = (
    Fault.EXIT,
    Fault.SEGFAULT,
    Fault.ABORT,
    Fault.ORPHAN,
    Fault.SEGFAULT_GET_REAL,
    Fault.SEGFAULT_INITIALIZATION,
    Fault.SEGFAULT_TERMINATE,
    Fault.SEGFAULT_FREE,
)
"""How an FMU ends the process that runs it. Each killer draws one."""

LATE = (Fault.SEGFAULT_TERMINATE, Fault.SEGFAULT_FREE)
"""These end the process after the variant is done: it keeps its results, and no other may be blamed."""

CLUSTERS = ("here", "LocalCluster", "nanny", "no nanny")
"""This machine without Dask, Dask's own cluster, and `dask scheduler` with `dask worker`."""

ENDS = ("process", "worker")
"""What a killer ends: the process of its variant, as FMUs do, or the worker above, as no memory does."""

Scheduler = Client | str | None


def kill_worker(killing_variants: Sequence[int]) -> Any:
    """Return a metric, y at the end (a fiftieth of the number), that ends the worker of these variants."""

    def last(result: Any) -> float:
        import os
        import signal
        import time

        value = float(result["j.bad.y"][-1])
        if round(50.0 * value) in killing_variants:
            os.kill(os.getppid(), signal.SIGKILL)
            time.sleep(60.0)
        return value

    return last


@contextmanager
def open_cluster(name: str, workers: int) -> Iterator[Scheduler]:
    """Start a cluster with Dask's defaults; None is this machine."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="killers-")))
        if name == "here":
            yield None
        elif name == "LocalCluster":
            cluster = LocalCluster(
                n_workers=workers, threads_per_worker=1, dashboard_address="127.0.0.1:0",
                local_directory=str(folder), silence_logs=50,
            )  # fmt: skip
            yield stack.enter_context(Client(stack.enter_context(cluster), set_as_default=False))
        else:
            arguments = () if name == "nanny" else ("--no-nanny",)
            yield stack.enter_context(outside_cluster(folder, workers, arguments)).address


def count_threads(cluster: Scheduler, expected: int) -> int:
    """Return the threads of a cluster; wait until killed workers were started again."""
    with ExitStack() as stack:
        client = cluster
        if client is None:
            return expected
        if not isinstance(client, Client):
            client = stack.enter_context(Client(client, set_as_default=False))
        until = time.monotonic() + 30.0
        while (threads_now := _threads(client)) != expected and time.monotonic() < until:
            time.sleep(0.1)
        return threads_now


def _threads(client: Any) -> int:
    return sum(dict(client.nthreads()).values())


def sweep_once(cluster: Scheduler, fmu: Path, killers: int, ends: str, draw: random.Random) -> str:
    """Run one sweep; return what is wrong."""
    killing_variants = draw.sample(range(VARIANTS), killers)
    ways = {n: draw.choice(WAYS) for n in killing_variants}
    dying = [n for n in killing_variants if ends == "worker" or ways[n] not in LATE]
    at = draw.uniform(0.0, STOP_TIME - 1.5 * STEP_SIZE)
    has_signals = draw.random() < 0.5
    if ends == "process":
        varied, values = "j.bad.fault", [int(ways.get(n, Fault.NONE)) for n in range(VARIANTS)]
    else:
        varied, values = "j.bad.b", [n / 100 for n in range(VARIANTS)]
    result = sweep(
        line_with_a_fault(fmu, Fault.NONE, at, a=0.0),
        {"run": {"of": [varied], "distribution": "values", "values": values}},
        metrics={"y": kill_worker(killing_variants if ends == "worker" else [])},
        signals=["j.bad.y"] if has_signals else None,
        scheduler=cluster,
        stop_time=STOP_TIME,
        step_size=STEP_SIZE,
    )
    return "; ".join(find_wrong(result, dying, has_signals))


def find_wrong(result: Any, dying: Sequence[int], has_signals: bool) -> Iterator[str]:
    """Compare the table and the signals with what must come out."""
    table = result.variants
    if table["variant"].to_list() != list(range(VARIANTS)) or not result.complete:
        yield f"only {table['variant'].to_list()}"
    for number, status, problem in table.select("variant", "status", "problem").rows():
        if status != (DIED if number in dying else DONE):
            yield f"variant {number} is {status}: {problem}"
    if has_signals and set(result.series.collect()["variant"]) != set(range(VARIANTS)) - set(dying):
        yield "signals are missing"


def on_alarm(*_: Any) -> None:
    """Raise TimeoutError."""
    raise TimeoutError(f"no end after {LONGEST_S:g} s")


def main() -> None:
    """Sweep, and print a row for each cluster."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--clusters", nargs="*", choices=CLUSTERS, default=CLUSTERS)
    parser.add_argument("--killers", type=int, nargs="*", default=[1, 3])
    parser.add_argument("--ends", nargs="*", choices=ENDS, default=ENDS[:1])
    arguments = parser.parse_args()
    signal.signal(signal.SIGALRM, on_alarm)
    print(
        "| Cluster | Killers | end their | Sweeps | right | s each |\n|---|---|---|---|---|---|", flush=True
    )
    with tempfile.TemporaryDirectory(prefix="killers-") as folder:
        os.environ["EMLA_COSIM_CACHE"] = str(Path(folder, "cache"))
        fmu = build_faulty_fmu(Path(folder))
        for name in arguments.clusters:
            for killers in arguments.killers:
                for ends in arguments.ends if name != "here" else ENDS[:1]:  # the worker is this process
                    count_right(name, killers, ends, arguments, fmu)


def count_right(name: str, killers: int, ends: str, arguments: argparse.Namespace, fmu: Path) -> None:
    """Run the sweeps of one cluster; print its row, and what was wrong."""
    draw = random.Random(f"{arguments.seed} {name} {killers} {ends}")
    right, wrong, start = 0, list[str](), time.monotonic()
    with open_cluster(name, arguments.workers) as cluster:
        threads = count_threads(cluster, arguments.workers)
        for number in range(arguments.runs):
            signal.alarm(int(LONGEST_S))
            try:
                problems = sweep_once(cluster, fmu, killers, ends, draw)
            except Exception as error:
                problems = repr(error)
            signal.alarm(0)
            threads_left = count_threads(cluster, threads)
            if threads_left != threads:
                problems = f"{problems}; {threads_left} of {threads} threads are left"
            right += not problems
            wrong += [f"{name}, {killers}, {ends}, {number}: {problems}"] if problems else []
    each = (time.monotonic() - start) / arguments.runs
    print(f"| {name} | {killers} | {ends} | {arguments.runs} | {right} | {each:.1f} |", flush=True)
    for line in wrong:
        print(line, flush=True)


if __name__ == "__main__":
    main()
