"""Faults of the machine, interrupts and limits: exit code 1, one error message, nothing half done."""

import errno
import os
import pickle
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import polars
import psutil
import pytest

import fmublock.cache as cache
from emla_cosim.base.errors import CommandError, CosimError, RunError, find_exit_code
from emla_cosim.sweeps import local_cluster, runner
from emla_cosim.sweeps.data import STATUS
from emla_cosim.views.output_folder import OutputFolder
from tests.support.commands import Emla, sentence
from tests.support.whole_files import names

R_S = "lift.plant.motor.R_s"
SHORT = ("--stop-time", "0.002")


def raised(error: CosimError, *causes: Exception) -> CosimError:
    """An error with these causes, the outermost first."""
    last: BaseException = error
    for cause in causes:
        last.__cause__ = cause
        last = cause
    return error


def test_the_machine_decides_the_exit_code() -> None:
    full, missing = OSError(errno.ENOSPC, "full"), FileNotFoundError(errno.ENOENT, "missing")
    assert find_exit_code(CommandError("x")) == 2
    assert find_exit_code(RunError("x")) == 1
    assert find_exit_code(raised(CommandError("x"), missing)) == 2
    assert find_exit_code(raised(CommandError("x"), full)) == 1
    assert find_exit_code(raised(CommandError("x"), CommandError("y"), full)) == 1


@pytest.mark.parametrize("error", [CommandError("x"), RunError("x")])
def test_the_exit_code_survives_the_way_from_another_process(error: CosimError) -> None:
    received = pickle.loads(pickle.dumps(raised(type(error)("x", name="y"), OSError(errno.EMFILE, "many"))))
    assert find_exit_code(received) == 1 and received.fields == {"name": "y"}
    assert find_exit_code(pickle.loads(pickle.dumps(error))) == find_exit_code(error)


@contextmanager
def interrupt_at_once() -> Iterator[Any]:
    yield lambda: True


@pytest.mark.usefixtures("on_one_cluster")
def test_a_sweep_without_a_finished_variant_is_interrupted(
    emla: Emla, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runner, "catch_interrupts", interrupt_at_once)
    command = ("sweep", "lift", "--vary", f"{R_S}=0.1,0.2", *SHORT, "--output", "out")
    assert "interrupted; the results so far are in out" in sentence(emla(*command), 1)
    table = polars.read_parquet(tmp_path / "out/variants.parquet")
    assert table.height == 0 and {STATUS, R_S, "lift.position_error_m"} <= set(table.columns)
    monkeypatch.undo()


def test_a_signal_while_plots_are_drawn_ends_them(
    emla: Emla, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    draw, drawn = OutputFolder.draw, list[str]()

    def signalled(self: OutputFolder, name: str, figure: Any) -> Path:
        drawn.append(name)
        if len(drawn) == 2:
            signal.raise_signal(signal.SIGTERM)
        return draw(self, name, figure)

    monkeypatch.setattr(OutputFolder, "draw", signalled)
    said = sentence(emla("run", "lift", *SHORT, "--output", "out"), 1)
    assert said == "Error: the plots were interrupted. The results so far are in out."
    assert len(drawn) == 2
    assert names(tmp_path / "out") == {"results.csv", "metrics.json", "run.json"}


def test_a_trajectory_on_a_full_disk_is_exit_code_1(emla: Emla, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, *_: Any) -> Any:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("emla_cosim.trajectories.file_writer.write_atomically", full)
    said = sentence(emla("trajectory", "--knots", "10", "--points", "5", "--output", "t.json"), 1)
    assert said == "Error: the trajectory 't.json' cannot be written: No space left on device."


def test_an_output_interval_beyond_all_bounds_is_an_error(emla: Emla) -> None:
    said = sentence(emla("run", "lift", *SHORT, "--output-interval", "1e308"), 2)
    assert "is not a whole number of steps" in said


@pytest.mark.skipif(sys.platform == "win32", reason="Windows does not use HOME.")
@pytest.mark.parametrize("home", [None, ""])
def test_zig_has_a_cache_folder_without_home(
    home: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "cache"))
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.delenv("HOME") if home is None else monkeypatch.setenv("HOME", home)
    cache._home_cache.cache_clear()
    try:
        folders = cache.tool_environment()
        assert (
            folders["ZIG_GLOBAL_CACHE_DIR"] == folders["ZIG_LOCAL_CACHE_DIR"] == str(tmp_path / "cache/zig")
        )
        environment = {**os.environ, **folders}
    finally:
        cache._home_cache.cache_clear()
    (tmp_path / "x.c").write_text("int f(void) { return 1; }\n")
    for how, code in ((environment, 0), ({**os.environ}, 1)):  # zig itself cannot do without
        command = [sys.executable, "-m", "ziglang", "cc", "-c", "x.c", "-o", "x.o"]
        done = subprocess.run(command, cwd=tmp_path, env=how, capture_output=True, check=False)
        if home is None:
            assert done.returncode == code, done.stderr


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="Leftovers are recognized by `/proc`.")
def test_the_next_command_removes_what_a_killed_one_left(fmu_folder: Path, tmp_path: Path) -> None:
    (tmp_path / "temporary").mkdir()
    environment = {**os.environ, "TMPDIR": str(tmp_path / "temporary")}
    emla = [sys.executable, "-m", "emla_cosim"]
    run = ["run", "lift", "--stop-time", "1000", "--realtime", "1", "--no-plots", "--fmus", str(fmu_folder)]
    with subprocess.Popen([*emla, *run, "--output", "out"], cwd=tmp_path, env=environment) as process:
        while not (tmp_path / "out/results.csv").exists():
            time.sleep(0.02)
        family = psutil.Process(process.pid).children(recursive=True)
        process.send_signal(signal.SIGKILL)
    psutil.wait_procs(family, timeout=10.0)
    assert list((tmp_path / "temporary").iterdir())
    subprocess.run([*emla, "--version"], env=environment, check=True, capture_output=True)
    assert not list((tmp_path / "temporary").iterdir())


@pytest.mark.skipif(sys.platform == "win32", reason="Windows does not use HOME.")
@pytest.mark.parametrize("home", [None, ""])
def test_commands_need_no_home(
    home: str | None, emla: Emla, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("HOME") if home is None else monkeypatch.setenv("HOME", home)
    assert emla("run", "lift", *SHORT, "--output", "out", "--no-plots").exit_code == 0
    assert emla("export", "lift", "x.ssp").exit_code == 0
    assert emla("info", "lift", "--json", "i.json").exit_code == 0
    assert emla("list").exit_code == 0
    assert names(tmp_path) == {"out", "x.ssp", "i.json"}


@pytest.mark.parametrize("most", [5, 8])
def test_a_few_open_files_are_enough_to_remove_the_temporary_folder(
    most: int, fmu_folder: Path, tmp_path: Path
) -> None:
    prlimit = pytest.importorskip("resource", reason="Windows has no such limit.").RLIMIT_NOFILE
    assert prlimit is not None
    (tmp_path / "temporary").mkdir()
    command = [sys.executable, "-m", "emla_cosim", "run", "lift", *SHORT, "--fmus", str(fmu_folder)]
    limited = ["sh", "-c", f'ulimit -n {most}; exec "$@"', "sh", *command, "--output", "out", "--no-plots"]
    environment = {**os.environ, "TMPDIR": str(tmp_path / "temporary")}
    done = subprocess.run(limited, cwd=tmp_path, env=environment, capture_output=True, check=False)
    assert done.returncode in (0, 1), done.stderr
    assert b"Traceback" not in done.stderr
    assert not list((tmp_path / "temporary").iterdir())


def test_the_cluster_of_this_machine_answers_nobody_over_http(machine: local_cluster.ClusterAddress) -> None:
    port = int(machine.address.rpartition(":")[2])
    served = 0
    for process in psutil.Process().children(recursive=True):
        for open_ in process.net_connections("inet"):
            if open_.status != psutil.CONN_LISTEN or open_.laddr.port == port:
                continue
            for page in ("status", "health", "info/main/workers.html", "json/counts.json"):
                try:
                    urllib.request.urlopen(f"http://127.0.0.1:{open_.laddr.port}/{page}", timeout=10.0)
                except urllib.error.HTTPError as error:
                    assert error.code == 404
                    served += 1
                except OSError:  # encrypted
                    continue
                else:
                    raise AssertionError(page)
    assert served >= 4
