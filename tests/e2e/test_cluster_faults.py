"""A sweep has every variant once, although variants, workers, its scheduler or its caller end."""

import os
import random
import re
import shutil
import signal
import socket
import subprocess
import sys
import types
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import polars
import psutil
import pytest
from distributed import Client, LocalCluster

from emla_cosim.analyses.execution import dask_workers, variant_processes
from emla_cosim.analyses.sweep.result import read_sweep
from emla_cosim.analyses.sweep.runner import sweep
from emla_cosim.base.errors import CommandError, RunError
from emla_cosim.base.progress import Progress
from emla_cosim.recorders.metrics import METRICS
from emla_cosim.system.model import System
from tests.support.clusters import CODE, At, family, outside_cluster
from tests.support.faulty_systems import line_with_a_fault
from tests.support.hand_written_fmus import Fault
from tests.support.paths import ROOT
from tests.support.processes import run
from tests.support.waiting import wait_for

RUN: dict[str, Any] = {"stop_time": 1.0, "step_size": 0.1}


@pytest.fixture
def system(faulty_fmu: Path) -> System:
    """A line of FMUs of which `j.bad` fails as its parameter says."""
    return line_with_a_fault(faulty_fmu, Fault.NONE, 0.45)


def runs_with(faults: Sequence[Fault]) -> dict[str, Any]:
    """The factor `run`, whose values are these faults."""
    return {"run": {"of": ["j.bad.fault"], "distribution": "values", "values": [int(f) for f in faults]}}


def killing(flag: Path, value: float) -> Any:
    """A metric, y in the end, that ends its process where y is this value, if it did not so before."""

    def kills(result: Any) -> float:
        import contextlib
        import os
        import signal
        import time

        time.sleep(0.02)  # so that a chunk does not hold them all
        last = float(result["j.bad.y"][-1])
        with contextlib.suppress(FileExistsError):
            if abs(last - value) < 1e-9:
                flag.touch(exist_ok=False)
                os.kill(os.getpid(), signal.SIGKILL)
        return last

    return kills


def numbers(result: Any) -> list[int]:
    return result.variants["variant"].to_list()


@pytest.mark.slow
def test_variant_that_ends_its_process_is_reported(system: System, tmp_path: Path) -> None:
    """One variant's FMU ends every process that it comes to; another's process is killed once."""
    faults = [Fault.NONE] * 2 + [Fault.SEGFAULT] + [Fault.NONE] * 2
    metrics = {"y": killing(tmp_path / "flag", 3.0)}
    result = sweep(system, runs_with(faults), metrics=metrics, **RUN)
    assert (tmp_path / "flag").exists()
    assert numbers(result) == list(range(5)) and result.complete
    assert result.variants["status"].to_list() == ["done"] * 2 + ["died"] + ["done"] * 2
    assert "its process ended 2 times (SIGSEGV): an FMU crashed it" in result.variants["problem"][2]
    assert result.variants["y"].to_list() == pytest.approx([3.0] * 2 + [None] + [3.0] * 2)


def command(fmus: Path, *more: str) -> list[str]:
    return [
        sys.executable, "-m", "emla_cosim", "sweep", "lift", "--vary", "lift.plant.motor.R_s=0.1:0.2:100",
        "--metric", "lift.torque_peak_N_m", "--signals", "lift.plant.x_L", "--stop-time", "0.1",
        "--fmus", str(fmus), "--no-plots", "--output", "out", *more,
    ]  # fmt: skip


@pytest.fixture(scope="module")
def undisturbed(fmu_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("undisturbed")
    lift(fmu_folder, folder / "out")
    return folder / "out"


def lift(fmus: Path, output: Path, **more: Any) -> Any:
    """The sweep of `command`."""
    options: dict[str, Any] = {"metrics": ["lift.torque_peak_N_m"], "signals": ["lift.plant.x_L"]}
    vary = {"lift.plant.motor.R_s": "0.1:0.2:100"}
    return sweep("lift", vary, **options, stop_time=0.1, fmus=fmus, output=output, **more)


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="Windows does not have the signals of POSIX.")
@pytest.mark.parametrize("way", ["Ctrl-C", "caller"])
def test_ended_sweep_leaves_nothing_and_can_be_continued(
    way: str, fmu_folder: Path, undisturbed: Path, tmp_path: Path
) -> None:
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    environment = {**os.environ, "TMPDIR": str(temporary)}
    process = subprocess.Popen(
        command(fmu_folder, "--workers", "2"), cwd=tmp_path, env=environment, text=True,
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
    )  # fmt: skip
    out = tmp_path / "out"
    try:
        wait_for(lambda: len(list(out.glob("parts/[0-9]*.parquet"))) >= 3 or process.poll() is not None)
        everybody = family(process)
    finally:
        if way == "Ctrl-C":
            process.send_signal(signal.SIGINT)
        else:
            process.kill()
    errors = process.communicate(timeout=300)[1]
    assert not psutil.wait_procs(everybody, timeout=60)[1], "a process survives"
    if way == "Ctrl-C":
        assert process.returncode == 1
        assert "Error: interrupted; the results so far are in out. Continue with --resume." in errors
    partial, complete = read_sweep(out), read_sweep(undisturbed)
    there = partial.variants["variant"].to_list()
    assert 3 <= len(there) < 100 and not partial.complete
    assert partial.variants.equals(complete.variants.filter(polars.col("variant").is_in(there)))
    assert partial.series is not None and complete.series is not None
    expected = complete.series.filter(polars.col("variant").is_in(there))
    assert partial.series.collect().equals(expected.collect())
    assert not list(temporary.rglob("emla-variants-*"))
    if way == "caller":  # its own folder stays until the next command
        run(sys.executable, "-m", "emla_cosim", "list", env=environment, check=True)
    assert not list(temporary.iterdir())

    unfinished = next(n for n in range(99, -1, -1) if not (out / f"parts/{n:09d}.parquet").exists())
    shutil.copy(next(out.glob("series/*.parquet")), out / f"series/{unfinished:09d}.parquet")  # killed before
    resumed = lift(fmu_folder, out, resume=True)
    assert resumed.complete and numbers(resumed) == list(range(100))
    assert (out / "variants.parquet").read_bytes() == (undisturbed / "variants.parquet").read_bytes()
    assert resumed.series is not None and (before := read_sweep(undisturbed).series) is not None
    assert resumed.series.collect().equals(before.collect())
    assert not list(out.glob("parts")) and not list(out.rglob(".*"))


@pytest.mark.slow
def test_killed_caller_leaves_nothing_on_workers(cluster: Client, fmu_folder: Path, tmp_path: Path) -> None:
    address = cluster.scheduler_info()["address"]
    process = subprocess.Popen(
        command(fmu_folder, "--scheduler", address), cwd=tmp_path,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        wait_for(lambda: any(tmp_path.glob("out/parts/[0-9]*.parquet")) or process.poll() is not None)
        assert sum(cluster.run(count_variant_processes).values()) == 2
    finally:
        for member in family(process):
            member.kill()
        process.wait()
    wait_for(lambda: sum(cluster.run(count_variant_processes).values()) == 0)

    def list_folders(dask_worker: Any) -> int:
        return len(list(Path(dask_worker.local_directory).glob("emla-variants-*")))

    wait_for(lambda: sum(cluster.run(list_folders).values()) == 0)


@pytest.mark.slow
def test_sweep_survives_the_loss_of_worker_and_scheduler(system: System, tmp_path: Path) -> None:
    """A worker of it is killed, then the scheduler; this machine continues with the rest."""
    plan: dict[str, Any] = {
        "vary": {"j.bad.b": "0.1:0.5:40"},
        "metrics": {"y": killing(tmp_path / "flag", 2.0 + 2.0 * (0.1 + 0.4 * 20 / 39))},
        **RUN,
    }
    expected = sweep(system, **plan, output=tmp_path / "there")
    (tmp_path / "flag").unlink()
    with outside_cluster(tmp_path) as outside:
        during: list[Any] = []
        unpacked = set[Path]()

        def kill_worker() -> None:
            during.append(read_sweep(tmp_path / "here"))
            unpacked.update(files_of_fmus(tmp_path / "worker-0"))
            outside.workers[0].kill()

        result = sweep(
            system, **plan, scheduler=outside.address, output=tmp_path / "here", progress=At(5, kill_worker)
        )
        assert [w.poll() is None for w in outside.workers].count(True) == 1, "no worker was killed"
        assert result.variants.equals(expected.variants) and numbers(result) == list(range(40))
        running = during[0].variants
        assert 0 < running.height < 40 and not during[0].complete
        assert running.equals(
            expected.variants.filter(expected.variants["variant"].is_in(numbers(during[0])))
        )
        assert len(unpacked) >= 3 and {DASK in file.parts for file in unpacked} == {True}
        for name in ("worker-0", "worker-1"):  # killed, and at the end of the sweep
            wait_for(lambda name=name: not files_of_fmus(tmp_path / name))
        with pytest.raises(RunError, match=r"^the scheduler at tcp://127\.0\.0\.1:\d+ .*\.$") as caught:
            sweep(
                system, **plan, scheduler=outside.address, output=tmp_path / "early", patience=4.0,
                progress=At(10, outside.scheduler.kill),
            )  # fmt: skip
        assert "\n" not in str(caught.value)
    partial = read_sweep(tmp_path / "early")
    assert 10 <= partial.variants.height < 40, caught.value
    resumed = sweep(system, **plan, output=tmp_path / "early", resume=True)
    assert resumed.variants.equals(expected.variants)
    resumed_file, expected_file = (
        (tmp_path / n / "variants.parquet").read_bytes() for n in ("early", "there")
    )
    assert resumed_file == expected_file


DASK = "dask-scratch-space"
"""The folder of Dask in which workers have their local directories."""


def files_of_fmus(folder: Path) -> set[Path]:
    """FMUs, and what is unpacked from them; folders may vanish meanwhile."""
    files = {Path(at, name) for at, _, names in os.walk(folder) for name in names}
    libraries = {p for p in files if p.suffix == ".so" and not p.name.startswith("stepper-")}
    return libraries | {p for p in files if p.name == "modelDescription.xml" or p.suffix == ".fmu"}


@pytest.mark.slow
def test_chunk_of_long_variants_returns_early(system: System) -> None:
    """Long variants after many short ones: no process keeps those that another one could run."""

    def process_of(result: Any) -> float:
        import os
        import time

        time.sleep(0.5 if result["j.bad.y"][-1] > 3.0 else 0.0)
        return float(os.getpid())

    vary = {"j.bad.b": [0.1] * 200 + [0.9] * 8}
    result = sweep(system, vary, metrics={"process": process_of}, workers=2, **RUN)
    processes = result.variants["process"].to_list()[200:]
    assert len(set(processes)) == 2 and sorted(map(processes.count, set(processes)))[0] >= 2


def test_unreachable_scheduler_is_reported(
    system: System, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(dask_workers, "_CONNECT_S", 0.5)
    with socket.socket() as closed:
        closed.bind(("127.0.0.1", 0))
        port = closed.getsockname()[1]
    for address in (f"tcp://127.0.0.1:{port}", "nonsense://x", "", "tcp://", "tcp://[::1"):
        with pytest.raises(RunError, match=re.escape(f"no scheduler answers at '{address}': ")):
            sweep(system, {"j.bad.b": [0.1]}, scheduler=address, output=tmp_path / "out", **RUN)
    assert not (tmp_path / "out").exists()


class Notes(Progress):
    """Keeps what is noted."""

    def __init__(self) -> None:
        self.notes: list[str] = []

    def note(self, sentence: str) -> None:
        self.notes.append(sentence)


@pytest.mark.slow
def test_scheduler_without_workers_is_waited_for(system: System, tmp_path: Path) -> None:
    """It is said what is waited for; an adaptive cluster starts workers for what waits."""
    plan: dict[str, Any] = {"vary": {"j.bad.b": "0.1:0.5:6"}, **RUN}
    progress = Notes()
    with (
        LocalCluster(
            n_workers=0, threads_per_worker=1, processes=False, protocol="tcp://",
            dashboard_address="127.0.0.1:0", local_directory=str(tmp_path),
        ) as adaptive,
        Client(adaptive, set_as_default=False) as client,
    ):  # fmt: skip
        with pytest.raises(RunError, match=r"had no workers for 1\.5 s; start workers, or wait longer with"):
            sweep(system, **plan, scheduler=client, output=tmp_path / "out", patience=1.5, progress=progress)
        assert not (tmp_path / "out").exists()
        waiting = f"Waiting for workers: the scheduler at {adaptive.scheduler_address} has none."
        assert [waiting in note for note in progress.notes].count(True) == 1
        adaptive.adapt(minimum=0, maximum=2, interval="100ms")
        assert sweep(system, **plan, scheduler=client).variants["status"].to_list() == ["done"] * 6


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["here", "Dask"])
def test_hanging_variant_is_named_and_ended(
    kind: str, request: pytest.FixtureRequest, system: System, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is named while it runs, and ended in the end, also on resume. Ctrl-C ends it as well."""
    progress, scheduler = Notes(), None
    monkeypatch.setattr(variant_processes, "_SLOW_S", 0.5)
    if kind == "Dask":
        scheduler = request.getfixturevalue("cluster")
        scheduler.run(set_slow_s, 0.5)
    faults = [int(Fault.HANG if n in (3, 7) else Fault.NONE) for n in range(12)]
    plan: dict[str, Any] = {"vary": {"j.bad.fault": faults}, "metrics": ["y = last(j.bad.y)"], **RUN}
    out, stopping = tmp_path / "out", At(3, lambda: signal.raise_signal(signal.SIGINT))
    partial = sweep(system, **plan, scheduler=scheduler, output=out, progress=stopping)
    assert not partial.complete and not {3, 7} & set(numbers(partial))
    if scheduler is not None:
        wait_for(lambda: sum(scheduler.run(count_variant_processes).values()) == 0)
    assert count_variant_processes() == 0
    more: dict[str, Any] = {"resume": True, "timeout": "3 s", "progress": progress}
    result = sweep(system, **plan, scheduler=scheduler, output=out, **more)
    assert result.variants["status"].to_list() == ["timed out" if n in (3, 7) else "done" for n in range(12)]
    assert result.variants["problem"][3] == "it took more than 3 s; see --timeout."
    assert any(re.match(r"Still running: .*variant [37] for \d+ s", note) for note in progress.notes), (
        progress.notes
    )
    if scheduler is not None:
        scheduler.run(set_slow_s, 10.0)


def count_variant_processes() -> int:
    """Return how many children of this process run variants."""
    count = 0
    for child in psutil.Process().children():
        with suppress(psutil.Error):  # it has just ended
            count += "emla_cosim.analyses.execution.variant_processes:run_variants" in child.cmdline()
    return count


def set_slow_s(seconds: float) -> None:
    variant_processes._SLOW_S = seconds


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "killers"), [("here", 1), ("nanny", 3), ("no nanny", 3)])
def test_workers_survive_variants_that_end_processes(
    kind: str, killers: int, system: System, tmp_path: Path
) -> None:
    """The scheduler has Dask's defaults, and would send what ends a worker to three others."""
    killing_variants = random.Random(killers).sample(range(5, 40), killers)
    faults = [Fault.ABORT if n in killing_variants else Fault.NONE for n in range(40)]
    faults[:3] = [Fault.SEGFAULT_TERMINATE] * 3  # ends the process of the next variant
    with ExitStack() as stack:
        scheduler: Any = None
        if kind != "here":
            more = () if kind == "nanny" else ("--no-nanny",)
            scheduler = stack.enter_context(outside_cluster(tmp_path, arguments=more)).address
        results: dict[str, Any] = {"metrics": ["y = last(j.bad.y)"], "signals": ["j.bad.y"]}
        result = sweep(system, runs_with(faults), scheduler=scheduler, **results, **RUN)
        if kind != "here":
            with Client(scheduler, set_as_default=False) as client:
                assert sum(dict(client.nthreads()).values()) == 2
    assert result.variants["status"].to_list() == [
        "died" if n in killing_variants else "done" for n in range(40)
    ]
    assert result.series is not None
    assert set(result.series.collect()["variant"]) == set(range(40)) - set(killing_variants)


@pytest.mark.slow
def test_worker_without_the_package_is_reported(system: System, tmp_path: Path) -> None:
    """It joins all the same, and what it lacks is said: other projects may use the cluster."""
    (tmp_path / "other/emla_cosim").mkdir(parents=True)
    (tmp_path / "other/emla_cosim/__init__.py").write_text("raise ImportError('no emla_cosim here')")
    with outside_cluster(tmp_path, workers=0) as outside:
        outside.worker("--no-nanny", path=f"{tmp_path / 'other'}{os.pathsep}{CODE}")
        with pytest.raises(RunError, match="cannot run this: no emla_cosim here; install the same versions"):
            sweep(system, {"j.bad.b": [0.1]}, scheduler=outside.address, **RUN)
        assert outside.workers[0].poll() is None


SCRIPT = """
@dataclass
class Ceiling(ec.Recorder):
    ceiling: float = ec.option(1.0, help="Highest position that is allowed, in m.")

    def begin(self, layout, state=None):
        self.column = 1 + layout.names.index("lift.plant.x_L")

    def write(self, rows):
        if rows[:, self.column].max() > self.ceiling:
            raise ValueError("too high")


@dataclass
class Rows(ec.Metrics):
    layout: ec.RunLayout
    count: int = 0

    def write(self, rows):
        self.count += len(rows)

    def figures(self):
        return {"table": {"rows": self.count}}

    def state_dict(self):
        return self.count

    def load_state_dict(self, memory):
        self.count = memory


ec.RECORDERS["ceiling"] = Ceiling
ec.METRICS["rows"] = Rows

if __name__ == "__main__":
    vary = {"plants": ["*.plant", "lift.*"], "ceiling": [0.1, 1.0]}
    options = {"algorithm": "plants-first", "stop_time": 0.01, "fmus": fmus}
    found = ec.sweep("lift", vary, scheduler=address, **options)
    print(found.variants["status"].to_list(), found.variants["table.rows"].to_list())
"""
"""Registers a recorder and a metric, after the algorithm of a recipe, and uses all three."""


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["here", "Dask"])
def test_definitions_of_a_script_run_on_workers(
    kind: str, request: pytest.FixtureRequest, fmu_folder: Path, tmp_path: Path
) -> None:
    """The algorithm of docs/recipes.md, whose options are fields of a dataclass."""
    page = (ROOT / "docs/recipes.md").read_text(encoding="utf-8")
    recipe = re.search(r"```python\n(from dataclasses .*?)with ec.load", page, re.DOTALL)
    assert recipe is not None and "PlantsFirst" in recipe[1]
    address = None
    if kind == "Dask":
        address = request.getfixturevalue("cluster").scheduler_info()["address"]
    lines = [f"address, fmus = {address!r}, {str(fmu_folder)!r}"]
    (tmp_path / "script.py").write_text("\n".join([*lines, recipe[1], SCRIPT]))
    process = run(sys.executable, "script.py", cwd=tmp_path, environment={"PYTHONPATH": CODE}, timeout=300)
    assert process.returncode == 0, process.stderr
    assert process.stdout.strip() == "['failed', 'done', 'failed', 'done'] [None, 101.0, None, 101.0]"


@pytest.mark.slow
def test_worker_of_another_version_is_refused(
    cluster: Client, system: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is refused, and the cluster remains as good as it was."""
    with monkeypatch.context() as patched, pytest.raises(CommandError) as caught:
        patched.setattr(dask_workers, "version", lambda _: "0.0.1")
        sweep(system, {"j.bad.b": [0.1]}, scheduler=cluster, **RUN)
    assert re.search(r"has emla-cosim [\w.+-]+, not 0\.0\.1; install that", str(caught.value))
    plugins: Any = cluster.run_on_scheduler(lambda dask_scheduler: list(dask_scheduler.worker_plugins))
    assert not [name for name in plugins if "emla" in name], "new workers would be refused as well"
    assert sweep(system, {"j.bad.b": [0.1]}, scheduler=cluster, **RUN).variants["status"].item() == "done"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("here", "another process cannot run this: .*only_here"),
        ("Dask", "cannot run this: .*only_here.*; install the same versions"),
    ],
)
def test_modules_that_workers_lack_are_reported(
    kind: str, message: str, request: pytest.FixtureRequest, system: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A metric of a module that only the caller has."""
    cluster = request.getfixturevalue("cluster") if kind == "Dask" else None
    module = types.ModuleType("only_here")
    exec("def metric(result):\n    return 1.0", module.__dict__)
    monkeypatch.setitem(sys.modules, "only_here", module)
    with pytest.raises(RunError, match=message):
        sweep(system, {"j.bad.b": [0.1]}, metrics=[module.metric], scheduler=cluster, **RUN)
    with monkeypatch.context() as patched:
        patched.setitem(METRICS, "mine", module.metric)
        with pytest.raises(RunError, match=message):
            sweep(system, {"j.bad.b": [0.1]}, scheduler=cluster, **RUN)
    assert sweep(system, {"j.bad.b": [0.1]}, scheduler=cluster, **RUN).complete
