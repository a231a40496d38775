"""A command that is ended at any instant leaves whole files and no process, and can be repeated."""

import os
import re
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import polars
import psutil
import pytest
from click.testing import CliRunner

from emla_cosim.analyses.frame import session
from emla_cosim.analyses.variants.measures import STATUS
from emla_cosim.cli.app import app
from emla_cosim.master.stepping.checkpoint import load_checkpoint
from emla_cosim.views.output_folder import OutputFolder
from tests.support.clusters import family
from tests.support.commands import Emla, sentence
from tests.support.processes import call, start
from tests.support.processes import run as run_program
from tests.support.waiting import has_rows, wait_for
from tests.support.whole_files import assert_whole, names

needs_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="Windows has no `fork`, so no supervision.")

STOP_EARLY = ("--stop-time", "0.002")
STOP_TIME = "0.8"
OFTEN = "import emla_cosim.recorders.checkpoints as c; c.INTERVAL = 0.05\n"
"""Makes so many checkpoints that most runs have one."""
SLOWLY = """
import time
from emla_cosim.{module} import {owner} as owner
original = owner.{function}
def slow(*arguments, **named):
    open('begun', 'w').close(); time.sleep({seconds}); return original(*arguments, **named)
owner.{function} = slow
"""
FOLDER = {"module": "views.output_folder", "owner": "OutputFolder"}
PHASES = {
    "preparing": SLOWLY.format(module="run", owner="preparation", function="build", seconds=20),
    "stepping": "",
    "saving": SLOWLY.format(**FOLDER, function="save", seconds=2),
    "drawing": SLOWLY.format(**FOLDER, function="draw", seconds=3),
}
"""Code that makes a phase last; but for steps, it says in the file `begun` that it has begun."""


def run(fmus: Path, stop_time: str = STOP_TIME) -> tuple[object, ...]:
    return ("run", "lift", "--stop-time", stop_time, "--fmus", fmus, "--output", "out")


@pytest.fixture(scope="module")
def complete(fmu_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """results.csv of an undisturbed run."""
    folder = tmp_path_factory.mktemp("complete")
    process = start(folder, *run(fmu_folder), "--no-plots")
    assert process.communicate(timeout=300.0) and process.returncode == 0
    return (folder / "out/results.csv").read_bytes()


ENDS = [
    ("SIGKILL", False, "preparing"),
    ("SIGTERM", False, "preparing"),
    ("SIGINT", False, "stepping"),
    ("SIGHUP", False, "stepping"),
    ("SIGKILL", False, "stepping"),
    ("SIGKILL", True, "stepping"),
    ("SIGTERM", False, "saving"),
    ("SIGKILL", True, "saving"),
    ("SIGINT", False, "drawing"),
    ("SIGKILL", False, "drawing"),
]
"""The signal, whether the supervised child gets it, and the phase."""


@needs_fork
@pytest.mark.slow
@pytest.mark.parametrize(("name", "child", "phase"), ENDS)
def test_ended_run_leaves_whole_files_and_can_be_continued(
    name: str,
    child: bool,
    phase: str,
    complete: bytes,
    fmu_folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    is_stepping, out = phase == "stepping", tmp_path / "out"
    pace = ("--realtime", "0.2", "--checkpoint", "c") if is_stepping else ()
    process = start(tmp_path, *run(fmu_folder), *pace, code=OFTEN + PHASES[phase])
    has_begun = (lambda: has_rows(out / "results.csv")) if is_stepping else (tmp_path / "begun").exists
    wait_for(lambda: has_begun() or process.poll() is not None, 300.0)
    if not is_stepping:
        time.sleep(0.1)
    everyone = family(process)
    (everyone[1] if child else process).send_signal(getattr(signal, name))
    _, errors = process.communicate(timeout=300.0)
    assert not psutil.wait_procs(everyone, timeout=60.0)[1], "a process survives"

    killed = name == "SIGKILL" and not child
    check_message(process.returncode, errors, killed, name, phase)
    assert killed or not any((tmp_path / "temporary").iterdir())
    if out.exists():
        assert_whole(out, killed)
    if phase in ("saving", "drawing") and not killed:
        assert names(out) >= {"results.csv", "metrics.json", "run.json"}
    if killed:  # the next command removes what it left
        assert any((tmp_path / "temporary").iterdir())
        assert call(tmp_path, "--version")[0] == 0
        assert not any((tmp_path / "temporary").iterdir())

    monkeypatch.chdir(tmp_path)
    command = [*map(str, run(fmu_folder)), "--no-plots"]
    if (tmp_path / "c").exists() and load_checkpoint(tmp_path / "c").notes["time"] < float(STOP_TIME):
        command += ["--resume", "c"]
    second_run = CliRunner().invoke(app, command)
    assert second_run.exit_code == 0, second_run.output
    assert (out / "results.csv").read_bytes() == complete
    assert_whole(out)


def check_message(code: int, errors: str, killed: bool, name: str, phase: str) -> None:
    """There is one message, if a process is left to write it."""
    assert "Traceback" not in errors, errors
    messages = [x for x in errors.splitlines() if x.startswith(("Error:", "Interrupted."))]
    if killed:
        assert code == -signal.SIGKILL
    elif phase == "saving" and name != "SIGKILL":
        assert not messages or "interrupted" in messages[0]  # its files come first
    else:
        assert code == 1 and len(messages) == 1, errors
        words = {"preparing": "Interrupted.", "drawing": "the plots were interrupted"}
        stepping = "killed" if name == "SIGKILL" else r"interrupted at t = \S+ s\. The results so far are in"
        assert re.search(words.get(phase, stepping), messages[0])


@needs_fork
@pytest.mark.slow
@pytest.mark.parametrize("after", [0.0, 0.3, 0.8])
def test_signal_while_a_command_starts(after: float, fmu_folder: Path, tmp_path: Path) -> None:
    process = start(tmp_path, *run(fmu_folder, "0.01"), "--no-plots")
    # before it has a folder, it ends as any program does
    wait_for(lambda: any((tmp_path / "temporary").glob("emla-run-*")) or process.poll() is not None)
    time.sleep(after)
    process.send_signal(signal.SIGTERM)
    _, errors = process.communicate(timeout=300.0)
    assert process.returncode == 0 or (process.returncode == 1 and "nterrupted" in errors)
    assert "Traceback" not in errors
    assert not any((tmp_path / "temporary").iterdir())


@needs_fork
@pytest.mark.slow
def test_many_signals_are_one_request(fmu_folder: Path, tmp_path: Path) -> None:
    process = start(tmp_path, *run(fmu_folder, "1000"), "--no-plots", "--realtime", "1")
    wait_for(lambda: has_rows(tmp_path / "out/results.csv") or process.poll() is not None, 300.0)
    for _ in range(10):
        process.send_signal(signal.SIGTERM)
    _, errors = process.communicate(timeout=300.0)
    assert process.returncode == 1 and "Traceback" not in errors
    assert errors.count("interrupted at t = ") == 1


def test_signal_while_plots_are_drawn_ends_them(
    emla: Emla, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    draw, drawn = OutputFolder.draw, list[str]()

    def send_signal(self: OutputFolder, name: str, figure: Any) -> Path:
        drawn.append(name)
        if len(drawn) == 2:
            signal.raise_signal(signal.SIGTERM)
        return draw(self, name, figure)

    monkeypatch.setattr(OutputFolder, "draw", send_signal)
    message = sentence(emla("run", "lift", *STOP_EARLY, "--output", "out"), 1)
    assert message == "Error: the plots were interrupted. The results so far are in out."
    assert len(drawn) == 2
    assert names(tmp_path / "out") == {"results.csv", "metrics.json", "run.json"}


def test_signal_while_files_are_saved_waits_for_them(
    emla: Emla, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save = OutputFolder.save

    def send_signal(*arguments: Any, **options: Any) -> Any:
        signal.raise_signal(signal.SIGTERM)
        return save(*arguments, **options)

    monkeypatch.setattr(OutputFolder, "save", send_signal)
    result = emla("run", "lift", *STOP_EARLY, "--no-plots", "--output", "out")
    assert "Traceback" not in result.stderr
    assert names(tmp_path / "out") == {"results.csv", "metrics.json", "run.json"}
    assert '"status": "completed"' in (tmp_path / "out/run.json").read_text()


@pytest.mark.usefixtures("on_one_cluster")
@pytest.mark.slow
def test_sweep_without_a_finished_variant_is_interrupted(
    emla: Emla, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    @contextmanager
    def interrupt_at_once() -> Iterator[Any]:
        yield lambda: True

    monkeypatch.setattr(session, "catch_interrupts", interrupt_at_once)
    vary = ("--vary", "lift.plant.motor.R_s=0.1,0.2")
    result = emla("sweep", "lift", *vary, *STOP_EARLY, "--output", "out")
    assert "interrupted; the results so far are in out" in sentence(result, 1)
    table = polars.read_parquet(tmp_path / "out/variants.parquet")
    columns = {STATUS, "lift.plant.motor.R_s", "lift.position_error_m"}
    assert table.height == 0 and columns <= set(table.columns)


# ---- supervision -------------------------------------------------------------------------------


SUPERVISED = """
import os, sys
from emla_cosim.cli.supervisor import run_supervised
def rescue(how):
    {}
run_supervised(os.abort, rescue)
"""


@needs_fork
@pytest.mark.parametrize(
    ("rescue", "message"),
    [
        ("sys.stderr.write(f'Error: {how}.')", "Error: SIGABRT."),
        ("os.abort()", "Error: the run ended: SIGABRT. What it computed could not be saved: SIGABRT."),
        ("raise MemoryError", "Error: the run ended: SIGABRT. What it computed could not be saved: "),
    ],
)
def test_end_of_a_supervised_process_is_reported(rescue: str, message: str, tmp_path: Path) -> None:
    process = run_program(sys.executable, "-c", SUPERVISED.format(rescue), cwd=tmp_path)
    assert process.returncode == 1 and "Traceback" not in process.stderr
    assert process.stderr.splitlines()[-1].startswith(message)


WITHOUT_PROCESSES = """
import os
def fork(): raise BlockingIOError(11, 'Resource temporarily unavailable')
os.fork = fork
"""
WITHOUT_FOLDER = """
import os
mkdir = os.mkdir
def refuse(path, *more, **how):
    if 'emla-run-' in str(path): raise OSError(28, 'No space left on device')
    return mkdir(path, *more, **how)
os.mkdir = refuse
"""


@needs_fork
@pytest.mark.slow
@pytest.mark.parametrize("code", [WITHOUT_PROCESSES, WITHOUT_FOLDER], ids=["processes", "temporary folder"])
def test_command_runs_without_supervision(code: str, fmu_folder: Path, tmp_path: Path) -> None:
    """Files of others in the folder for temporary files stay."""
    save = "open(os.path.join(os.environ['TMPDIR'], 'mine'), 'w').close()\n"
    process = start(tmp_path, *run(fmu_folder, "0.01"), "--no-plots", code=code + save)
    assert process.communicate(timeout=300.0) and process.returncode == 0
    assert names(tmp_path / "out") == {"results.csv", "metrics.json", "run.json"}
    assert [p.name for p in (tmp_path / "temporary").iterdir()] == ["mine"]
