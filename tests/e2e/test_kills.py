"""A run that is ended at any instant leaves whole files, no process, and can be continued or repeated.

To end more runs than CI does:

    EMLA_KILLS=60 pytest -m "" -s tests/e2e/test_kills.py
"""

import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import psutil
import pytest
from typer.testing import CliRunner, Result

from emla_cosim.cli.app import app
from emla_cosim.master.stepping.checkpoint import load_checkpoint
from tests.support.tiers import mostly_slow
from tests.support.whole_files import assert_whole

pytestmark = pytest.mark.skipif(
    not hasattr(os, "fork"), reason="Windows has no `fork`, and so no guard to be killed."
)

KILLS = int(os.environ.get("EMLA_KILLS", "10"))
STEPPING_S = 0.8
"""Time that is simulated, and that it takes, in s."""

OFTEN = (
    "import emla_cosim.recorders.checkpoints as checkpoints; checkpoints.INTERVAL = 0.05\n"
    "from emla_cosim.cli.program import main; main()"
)
"""The command with so many checkpoints that most runs have one."""


@dataclass(frozen=True)
class Way:
    """How a run is ended: the signal, and whether the guard or its child gets it."""

    name: str
    to_child: bool = False


WAYS = [Way("SIGKILL"), Way("SIGKILL", to_child=True), Way("SIGTERM"), Way("SIGINT"), Way("SIGHUP")]

PHASES = ("starting", "stepping", "writing", "drawing")


@dataclass(frozen=True)
class Undisturbed:
    """A run that nobody ended: its results, and how long each phase took in s."""

    results: bytes
    lasted: dict[str, float]


def arguments(fmus: Path) -> list[str]:
    return ["run", "lift", "--stop-time", str(STEPPING_S), "--fmus", str(fmus), "--output", "out"]


def started(fmus: Path, folder: Path, checkpoint: bool) -> subprocess.Popen[str]:
    """A run with plots as a person calls it, its temporary files in the folder."""
    (folder / "temporary").mkdir()
    how, more = (["-c", OFTEN], ["--checkpoint", "c"]) if checkpoint else (["-m", "emla_cosim"], [])
    return subprocess.Popen(
        [sys.executable, *how, *arguments(fmus), "--realtime", "1", *more],
        cwd=folder, text=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
        env={**os.environ, "TMPDIR": str(folder / "temporary")},
    )  # fmt: skip


def phase(folder: Path) -> str:
    """Where a run is, by what it has left."""
    out = folder / "out"
    if any(out.glob("*.png")) or (out / "run.json").exists():
        return "drawing"
    if (out / "metrics.json").exists() or any(out.glob(".unfinished-*")):
        return "writing"
    return "stepping" if (out / "results.csv").exists() else "starting"


def followed(process: subprocess.Popen[str], folder: Path, until: Callable[[str, float], bool]) -> str:
    """Look at a run until it ends or a phase has lasted so long; the phase."""
    present, since = "starting", time.monotonic()
    while process.poll() is None:
        if (now := phase(folder)) != present:
            present, since = now, time.monotonic()
        if until(present, time.monotonic() - since):
            return present
        time.sleep(0.001)
    return "over"


@pytest.fixture(scope="module")
def undisturbed(fmu_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Undisturbed:
    folder = tmp_path_factory.mktemp("undisturbed")
    lasted = dict.fromkeys(PHASES, 0.0)
    process = started(fmu_folder, folder, checkpoint=False)

    def note(present: str, seconds: float) -> bool:
        lasted[present] = seconds
        return False

    followed(process, folder, note)
    assert process.communicate()[1].count("Error") == 0 and process.returncode == 0
    assert assert_whole(folder / "out") == 12  # with the manifest
    return Undisturbed((folder / "out/results.csv").read_bytes(), lasted)


@pytest.fixture(scope="module")
def counts() -> Iterator[Counter[str]]:
    found = Counter[str]()
    yield found
    print(f"\n{KILLS} runs ended early; " + "; ".join(f"{n} x {what}" for what, n in sorted(found.items())))


def instant(number: int) -> tuple[str, float]:
    """The phase in which a run is ended, and what part of it is over then; they are spread evenly."""
    wanted = ("starting", "stepping", "stepping", "writing", "drawing")[number % 5]
    return wanted, (number // 5 * 0.618 + 0.1 * (number % 5)) % 1.0


@pytest.mark.parametrize("number", mostly_slow(range(KILLS), range(min(KILLS, 5))))
def test_a_run_that_is_ended_at_any_instant(
    number: int, undisturbed: Undisturbed, fmu_folder: Path, counts: Counter[str], tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    wanted, part = instant(number)
    way, checkpoint = WAYS[(number + number // 5) % len(WAYS)], number % 2 == 1 and wanted != "starting"
    after = part * undisturbed.lasted[wanted]
    process = started(fmu_folder, tmp_path, checkpoint)
    order = (*PHASES, "over")
    reached = followed(
        process,
        tmp_path,
        lambda present, seconds: (
            order.index(present) > order.index(wanted) or (present == wanted and seconds >= after)
        ),
    )
    family = end(process, way)
    _, errors = process.communicate(timeout=60.0)
    assert not psutil.wait_procs(family, timeout=10.0)[1], "a process survives"
    counts[f"{way.name}{' of the child' * way.to_child} while {reached}"] += 1

    # a child that has locked its folder and told nothing yet leaves the lock's files, which lock nothing
    killed = way.name == "SIGKILL" and (not way.to_child or reached == "starting")
    assert_whole(tmp_path / "out", killed) if (tmp_path / "out").exists() else None
    check_end(process.returncode, errors, way, reached)
    assert killed or not any((tmp_path / "temporary").iterdir())

    monkeypatch.chdir(tmp_path)
    counts[again(fmu_folder, tmp_path)] += 1
    assert (tmp_path / "out/results.csv").read_bytes() == undisturbed.results
    assert_whole(tmp_path / "out", killed)


def end(process: subprocess.Popen[str], way: Way) -> list[psutil.Process]:
    """Send the signal; all processes of the run."""
    try:
        parent = psutil.Process(process.pid)
        children = parent.children(recursive=True)
    except psutil.NoSuchProcess:
        return []
    number = getattr(signal, way.name)
    if way.to_child and children:
        children[0].send_signal(number)
    else:
        process.send_signal(number)
    return children


def check_end(code: int, errors: str, way: Way, reached: str) -> None:
    """It says so in one sentence, if anybody is left to say it."""
    assert "Traceback" not in errors, errors
    sentences = [x for x in errors.splitlines() if x.startswith(("Error:", "Interrupted."))]
    if code == 0:
        assert not sentences
    elif code == 1:
        assert len(sentences) == 1, errors
    else:  # Python itself was not there yet, or nobody can catch it
        assert code == -getattr(signal, way.name), errors
        assert way.name == "SIGKILL" or reached == "starting"


def again(fmus: Path, folder: Path) -> str:
    """Continue the run from its checkpoint, or repeat it where there is none; what was done."""
    command = [*arguments(fmus), "--no-plots"]
    if not (folder / "c").exists():
        assert (done := CliRunner().invoke(app, command)).exit_code == 0, done.output
        return "repeated"
    if load_checkpoint(folder / "c").notes["time"] >= STEPPING_S:
        return "complete"
    done: Result = CliRunner().invoke(app, [*command, "--resume", "c"])
    assert done.exit_code == 0, done.output
    return "continued"
