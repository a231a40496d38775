"""Every write, fsync, rename, chmod and removal of a file fails once: code 1, one sentence, nothing lost.

Any thread, and any process that a command starts, may be the one whose call fails.
"""

import gc
import json
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, nullcontext
from importlib import import_module
from pathlib import Path

import polars
import pytest
from typer.testing import Result

from emla_cosim.sweeps.local_cluster import local_cluster
from tests.support.commands import Emla
from tests.support.few_figures import draw_few
from tests.support.injected_failures import CHANGES, Failures, new_failures
from tests.support.paths import SUPPORT
from tests.support.tiers import mostly_slow
from tests.support.whole_files import assert_whole

SHORT = ("--stop-time", "0.002")
R_S = "lift.plant.motor.R_s=0.1,0.2"
REPORTS = ("--json", "v.json", "--junit", "v.xml", "--html", "v.html")

COMMANDS = {
    "run": ("run", "lift", *SHORT, "--output", "out"),
    "checkpoint": ("run", "lift", *SHORT, "--output", "out", "--no-plots", "--checkpoint", "c"),
    "resume": ("run", "lift", "--stop-time", "0.004", "--output", "out", "--no-plots", "--resume", "before"),
    "parquet": ("run", "lift", *SHORT, "--output", "out", "--no-plots", "--output-format", "parquet"),
    "report": ("run", "lift", *SHORT, "--output", "out", "--no-plots", "--report"),
    "rerun": ("rerun", "before.json", "--output", "out", "--no-plots"),
    "package": ("run", "lift.ssp", *SHORT, "--output", "out", "--no-plots"),
    "plot": ("plot", "earlier", "--output", "p.png"),
    "export": ("export", "lift", "x.ssp"),
    "info": ("info", "lift", "--json", "i.json"),
    "build": ("build", "Reference", "--output", "built"),
    "build Python": ("build", "Reference", "--flavour", "python", "--output", "built"),
    "trajectory": ("trajectory", "--knots", "10", "--points", "5", "--output", "t.json"),
    "linearize": (
        *("linearize", "lift", "--open", "lift.controller.u_q->lift.plant.u_q", "--stop-time", "0.1"),
        *("--duration", "0.01", "--output", "out"),
    ),
    "verify": ("verify", "f/Reference.fmu", "--only", "archive.*", *REPORTS),
    "record": ("verify", "f/Reference.fmu", "--record", "references", "--stop-time", "0.01", "--overwrite"),
    "sweep": ("sweep", "lift", "--vary", R_S, *SHORT, "--signals", "lift.plant.x_L", "--output", "out"),
    "compare": ("compare", "lift", "--controllers", "rsba,foc", *SHORT, "--output", "out"),
    "tune": (
        *("tune", "lift", "--vary", "lift.controller.beta[1]=400:1600", "--evaluations", "3", "--training"),
        *(
            "1",
            "--validation",
            "1",
            "--objective",
            "lift.position_error_m",
            "--stop-time",
            "0.4",
            "--output",
            "out",
        ),
    ),
    "identify": (
        *("identify", "lift", "--measured", "earlier/results.csv:lift.plant.x_L=lift.plant.x_L", "--vary"),
        *("lift.plant.motor.J_m=0.1:0.4", "--evaluations", "2", *SHORT, "--no-plots", "--output", "out"),
    ),
    "completion": ("--install-completion",),
}
"""Commands that write, by name."""

WAYS = ("run", "parquet", "export", "plot")
"""Those of which every way to every place is tried: one function writes most files."""

MINE = b"years of work\n"


@pytest.fixture(scope="module")
def failures() -> Iterator[Failures]:
    found = new_failures()
    yield found
    found.disarm()


@pytest.fixture(scope="module")
def watched(failures: Failures) -> Iterator[None]:
    """Processes that are started notice failures, too."""
    place = str(SUPPORT / "injected")
    sys.path.insert(0, place)
    yield
    sys.path.remove(place)


@pytest.fixture
def own_cluster(watched: None) -> Iterator[object]:
    with ExitStack() as stack:
        made: list[object] = []

        def open_() -> object:
            if not made:
                made.append(stack.enter_context(local_cluster(1)))
            return made[0]

        yield open_


@pytest.fixture
def at_work(
    request: pytest.FixtureRequest,
    emla: Emla,
    own_cluster: object,
    failures: Failures,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> Emla:
    """Files that are there before, and the user's among them."""
    draw_few(monkeypatch)
    open_cluster = own_cluster
    monkeypatch.setattr(
        import_module("emla_cosim.sweeps.executor"),
        "local_cluster",
        lambda _: nullcontext(open_cluster()),  # type: ignore[operator]
    )
    for name in ("temporary", "out", "built", "references", "home", "f"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "mine.txt").write_bytes(MINE)
    (tmp_path / "home" / ".bashrc").write_bytes(MINE)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.setenv("SHELL", "/bin/bash")
    monkeypatch.setattr("shellingham.detect_shell", lambda: ("bash", "/bin/bash"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    if "build" in request.node.name:
        monkeypatch.setenv("EMLA_COSIM_CACHE", str(tmp_path / "cache"))
    monkeypatch.setenv("TMPDIR", str(tmp_path / "temporary"))
    return emla


def run_again(emla: Emla, what: str) -> Result:
    """Run a command; what it built before is not there any more."""
    if what.startswith("build"):
        for place in ("built/Reference", "cache"):
            shutil.rmtree(place, ignore_errors=True)
    result = emla(*COMMANDS[what])
    if isinstance(result.exception, SystemExit):
        result.exception, result.exc_info = None, None
    gc.collect()  # at its end a process removes its temporary folders
    return result


def prepare(emla: Emla, what: str, tmp_path: Path, fmus: Path) -> None:
    """Make what a command reads."""
    short = ("run", "lift", *SHORT, "--no-plots", "--output")
    if what in ("resume", "rerun", "plot", "identify"):
        assert emla(*short, "earlier", "--checkpoint", "before").exit_code == 0
        shutil.copy("earlier/run.json", "before.json")
    if what == "package":
        assert emla("export", "lift", "lift.ssp").exit_code == 0
    if what in ("verify", "record"):
        shutil.copy(next(fmus.rglob("Reference.fmu")), "f/Reference.fmu")


def snapshot(folder: Path) -> dict[str, bytes]:
    """The user's files: inputs and others."""
    names = ("mine.txt", "before", "before.json", "lift.ssp", "Reference.fmu")
    return {
        str(p.relative_to(folder)): p.read_bytes()
        for p in [*folder.glob("*"), *folder.glob("[!t]*/*")]
        if p.name in names and p.is_file()
    }


TABLES = {"run.json": "results.*", "sweep.json": "variants.parquet"}
"""What is whole if a record says so."""


def assert_claims(out: Path, whole: dict[str, bytes]) -> None:
    """A record that says `completed` lies beside the table that an undisturbed command makes."""
    for record, pattern in TABLES.items():
        if (out / record).exists() and json.loads((out / record).read_text())["status"] == "completed":
            for name, content in whole.items():
                if Path(name).match(pattern):
                    assert (out / name).exists() and same_table(out / name, content), name


def same_table(path: Path, content: bytes) -> bool:
    if path.suffix == ".parquet" and path.name.startswith("variants"):
        return (
            polars.read_parquet(path)
            .drop("provenance")
            .equals(polars.read_parquet(content).drop("provenance"))
        )
    return path.read_bytes() == content


CASES = [*((what, False) for what in COMMANDS), *((what, True) for what in WAYS)]
QUICK = [(what, False) for what in ("plot", "export", "info", "build Python", "completion")]


@pytest.mark.parametrize(("what", "deep"), mostly_slow(CASES, QUICK))
def test_every_change_on_the_disk_fails_once(
    what: str, deep: bool, at_work: Emla, failures: Failures, tmp_path: Path, fmu_folder: Path
) -> None:
    prepare(at_work, what, tmp_path, fmu_folder)
    mine = snapshot(tmp_path)
    before = run_again(at_work, what)
    assert before.exit_code == 0, before.output
    out = tmp_path / "out"
    whole = {p.name: p.read_bytes() for p in out.rglob("*") if p.is_file() and p.name != "mine.txt"}
    failures.forget()
    while True:
        failures.arm(tmp_path, CHANGES, deep)
        try:
            result = run_again(at_work, what)
        finally:
            failed = failures.disarm()
        if failed is None:
            break
        print(what, result.exit_code, failed, result.stderr.strip()[-300:])
        check_end(result, failed)
        if what == "verify":
            assert "failed archive" not in result.output, failed
        assert snapshot(tmp_path) == mine, failed
        check_files(tmp_path, failed, result.exit_code)
        assert_claims(out, whole)
    assert result.exit_code == 0, result.output
    assert_claims(out, whole)
    assert failures.count
    print(f"{what}: {failures.count} places failed")


def check_end(result: Result, failed: str) -> None:
    """Code 0, or code 1 with one sentence."""
    assert result.exception is None or isinstance(result.exception, SystemExit), failed
    assert "Traceback" not in result.output, failed
    lines = [line for line in result.stderr.splitlines() if line.startswith("Error:")]
    assert result.exit_code in (0, 1), (failed, result.stderr)
    assert len(lines) == result.exit_code, (failed, result.stderr)


def check_files(folder: Path, failed: str, code: int) -> None:
    """All files are whole; what was not ready is gone, unless its removal failed."""
    rest = failed.startswith(("os.remove", "os.rmdir"))
    bashrc = (folder / "home/.bashrc").read_bytes()
    assert bashrc.startswith(MINE), failed
    for name in ("out", "built", "references"):
        for path in (folder / name).rglob("mine.txt"):
            path.unlink()
        try:
            assert_whole(folder / name, killed=rest)
        finally:
            (folder / name).mkdir(exist_ok=True)
            (folder / name / "mine.txt").write_bytes(MINE)
    assert_whole_files = [p for p in folder.glob("*") if p.name.startswith(".unfinished")]
    assert rest or not assert_whole_files, failed
    names = [p.name for p in (folder / "temporary").iterdir()]
    left = [n for n in names if n != "mine.txt" and not n.startswith("emla-cluster-")]  # it runs on
    if rest:
        for name in left:
            shutil.rmtree(folder / "temporary" / name, ignore_errors=True)
    else:
        assert not left, (failed, left)
