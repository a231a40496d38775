"""No command replaces a file that emla did not write, and a folder takes one command at a time."""

import json
import os
import re
import shutil
import stat
import subprocess
import sys
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

import emla_cosim as ec
import fmublock.files
from emla_cosim.analyses.sweep.folder import SweepFolder
from emla_cosim.base.errors import CommandError
from emla_cosim.base.folder_lock import exclusive_lock
from emla_cosim.cli.app import COMMANDS
from emla_cosim.fmu.file import UnsafeArchiveError, unpack
from emla_cosim.fmu.models import FMU_FOLDER, check_build_path
from emla_cosim.run.options import list_options
from emla_cosim.views.output_folder import OutputFolder
from emla_cosim.views.plots.pictures import FIGURES
from fmublock.__main__ import main as fmublock_main
from fmublock.files import UNFINISHED, NotAFileError, real_place
from fmublock.platforms import host_platform
from tests.support import toy
from tests.support.commands import Emla, sentence
from tests.support.tiers import mostly_slow
from tests.support.toy_fmu import copy_toy
from tests.support.whole_files import names

USER_TEXT = "years of work\n"
STOP_TIME = ("--stop-time", "0.002")
RUN = ("run", "lift", *STOP_TIME)
QUICK = (*RUN, "--no-plots", "--output", "out")
SWEEP = ("sweep", "lift", "--vary", "lift.plant.motor.R_s=0.1,0.2", *STOP_TIME)
COMPARE = ("compare", "lift", "--controllers", "foc", *STOP_TIME)
CERTIFY = ("compare", "lift", "--gains", "robust", "--table", "certificate", *STOP_TIME)
TUNE = (
    *("tune", "lift", "--vary", "lift.controller.beta[1]=200:4000", "--objective", "lift.position_error_m"),
    *("--evaluations", "4", "--validation", "0", *STOP_TIME),
)
FIRST = (*RUN, "--no-plots", "--output", "first")
IDENTIFY = (
    *("identify", "lift", "--measured", "first/results.csv:lift.plant.x_L=lift.plant.x_L"),
    *("--vary", "lift.plant.motor.J_m=0.1:0.4", "--evaluations", "2", *STOP_TIME),
)
VERIFY = ("verify", "read.fmu", "--only", "archive")
SIZE = ("size", "prototype", "--stop-time", "0.05", "--lead-in", "350ms")
LINEARIZE = ("linearize", "lift", "--open", "lift.controller.u_q->lift.plant.u_q", "--stop-time", "0.1")
TRAJECTORY = ("trajectory", "--knots", "10", "--points", "5")
RUN_FILES = ["results.csv", "metrics.json", "run.json", *(f"{name}.png" for name in FIGURES)]


@dataclass(frozen=True)
class Attempt:
    """A command whose output is named by an option.

    Attributes:
        arguments: The command without the option.
        option: The option, empty if the output is an argument.
        files: What it writes into the folder; none if the option names a file.
        suffix: The end that the name must have.
        after: Whether the command reads the folder `first` of a run.
        code: The exit code of the command when it may write.
    """

    arguments: Sequence[str]
    option: str
    files: Sequence[str] = ()
    suffix: str = ""
    after: bool = False
    code: int = 0

    def with_output(self, output: Path) -> list[str]:
        return [*self.arguments, *filter(None, [self.option]), str(output)]


FMUS = ("--fmus", ["EmlaPlant/EmlaPlant.fmu"])

ATTEMPTS: dict[str, Attempt] = {
    "run output": Attempt(RUN, "--output", RUN_FILES),
    "run output report": Attempt((*RUN, "--no-plots", "--report"), "--output", ["report.html"]),
    "run output parquet": Attempt(
        (*RUN, "--no-plots", "--output-format", "parquet"), "--output", ["results.parquet"]
    ),
    "run checkpoint": Attempt((*RUN, "--no-plots", "--output", "o"), "--checkpoint"),
    "run fmus": Attempt((*RUN, "--output", "o"), *FMUS),
    "build output": Attempt(
        ("build", "Reference", "--platform", host_platform()), "--output", ["Reference/Reference.fmu"]
    ),
    "rerun output": Attempt(("rerun", "first"), "--output", RUN_FILES, after=True),
    "rerun checkpoint": Attempt(("rerun", "first", "--output", "o"), "--checkpoint", after=True),
    "info json": Attempt(("info", "lift"), "--json"),
    "plot output": Attempt(("plot", "first"), "--output", suffix=".png", after=True),
    "sweep output": Attempt(
        SWEEP, "--output", ["variants.parquet", "sweep.json", "worst.txt", "figures.png"]
    ),
    "compare output": Attempt(
        COMPARE, "--output", ["comparison.csv", "comparison.md", "comparison.json", "comparison-errors.png"]
    ),
    "compare output certificate": Attempt(CERTIFY, "--output", ["certificate.csv", "certificate.md"]),
    "tune output": Attempt(TUNE, "--output", ["best.toml", "tune.json", "history.csv", "tuning.png"], code=1),
    "identify output": Attempt(
        IDENTIFY,
        "--output",
        ["identified.toml", "identify.json", "samples.csv", "fit.png", "certainty.png"],
        after=True,
    ),
    "trajectory output": Attempt(TRAJECTORY, "--output"),
    "size output": Attempt(
        SIZE,
        "--output",
        [
            "size.json",
            "limits.csv",
            "cycles.csv",
            "prototype.png",
            "prototype-motion.png",
            "prototype-limits.png",
        ],
    ),
    "linearize output": Attempt(
        LINEARIZE, "--output", ["linearize.json", "responses.csv", "bode.png", "nyquist.png"]
    ),
    "verify junit": Attempt(VERIFY, "--junit"),
    "verify json": Attempt(VERIFY, "--json"),
    "verify html": Attempt(VERIFY, "--html"),
    "verify sarif": Attempt(VERIFY, "--sarif"),
    "verify badge": Attempt(VERIFY, "--badge"),
    "verify record": Attempt(
        ("verify", "read.fmu"), "--record", ["read_ref.csv", "read_ref.opt", "read_ref.toml"]
    ),
    "export file": Attempt(("export", "lift"), "", suffix=".ssp"),
}
"""By command and option, and what else decides which files are written."""


READ = ("fmus", "margins", "reference", "resume", "trajectory")
"""Options that name what a command reads."""


def test_every_option_that_names_an_output_is_in_the_table() -> None:
    aliases = {"rerun": "run", "tune": "sweep"}
    written = {
        f"{command} {option.name}"
        for command in COMMANDS
        for option in list_options(aliases.get(command, command)).values()
        if option.text_type is Path and not option.is_repeatable and option.name not in READ
    }
    assert written <= ATTEMPTS.keys()


# ---- files of the user -------------------------------------------------------------------------


def state(folder: Path) -> dict[Path, tuple[int, bytes]]:
    """What everything in a folder is, and its content."""
    states = {}
    for path in folder.rglob("*"):
        kind = stat.S_IFMT(path.lstat().st_mode)
        content = path.read_bytes() if kind == stat.S_IFREG else b""
        states[path] = (kind, str(path.readlink()).encode() if kind == stat.S_IFLNK else content)
    return states


def assert_unchanged(folder: Path, before: dict[Path, tuple[int, bytes]]) -> None:
    """Everything is as it was; new folders are empty."""
    after = state(folder)
    assert {path: after.get(path) for path in before} == before
    assert all(path.is_dir() for path in after.keys() - before.keys())


def prepare(attempt: Attempt, emla: Emla, folder: Path) -> Path:
    """Make what a command reads, and return the path of its output."""
    copy_toy(folder / "read.fmu")
    assert not attempt.after or emla(*FIRST).exit_code == 0
    return folder / f"place{attempt.suffix}"


FEW = ["run output", "run checkpoint", "build output", "verify json", "export file", "sweep output"]


@pytest.mark.parametrize("name", mostly_slow(ATTEMPTS, FEW))
def test_user_file_is_neither_replaced_nor_removed(name: str, emla: Emla, tmp_path: Path) -> None:
    attempt = ATTEMPTS[name]
    output = prepare(attempt, emla, tmp_path)
    target = output / attempt.files[0] if attempt.files else output
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(USER_TEXT)
    before = state(tmp_path)
    message = sentence(emla(*attempt.with_output(output)), 2)
    assert "--overwrite" in message and len(message) < 600
    assert_unchanged(tmp_path, before)


REPLACED = [n for n, a in ATTEMPTS.items() if a.option != "--fmus"]


@pytest.mark.usefixtures("on_one_cluster")
@pytest.mark.parametrize("name", mostly_slow(REPLACED, ["run output", "run checkpoint", "export file"]))
def test_overwrite_replaces_user_files_and_own_files_need_no_option(
    name: str, emla: Emla, tmp_path: Path
) -> None:
    attempt = ATTEMPTS[name]
    output = prepare(attempt, emla, tmp_path)
    files = [output / file for file in attempt.files] or [output]
    for file in files:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(USER_TEXT)
    copy = tmp_path / "copy"
    os.link(files[0], copy)
    result = emla(*attempt.with_output(output), "--overwrite")
    assert result.exit_code == attempt.code, result.output
    assert copy.read_text() == USER_TEXT, "another name of the file has new content"
    unwritten = {"worst.txt"} | {f"{n}.png" for n in FIGURES}  # which not every command has
    assert all(f.read_text("latin-1") != USER_TEXT for f in files if f.exists() and f.name not in unwritten)
    if attempt.option == "--record":
        return  # reference files need the option each time
    thesis = (output if attempt.files else tmp_path) / "thesis.txt"
    thesis.write_text(USER_TEXT)
    assert emla(*attempt.with_output(output)).exit_code == attempt.code
    assert thesis.read_text() == USER_TEXT


@pytest.mark.parametrize("picture", ["forces-and-speeds", "positions-and-accelerations", "path"])
def test_picture_beside_a_trajectory_is_not_replaced(picture: str, emla: Emla, tmp_path: Path) -> None:
    file = tmp_path / f"place-{picture}.png"
    file.write_text(USER_TEXT)
    message = sentence(emla(*TRAJECTORY, "--output", "place.json"), 2)
    assert f"{file.name}' was not written by emla" in message
    assert file.read_text() == USER_TEXT and not (tmp_path / "place.json").exists()


# ---- the folder of a run -----------------------------------------------------------------------


def test_run_replaces_and_removes_its_own_files_only(emla: Emla, tmp_path: Path) -> None:
    """Hidden files that only look like unfinished ones stay, and pictures of an earlier run go."""
    out = tmp_path / "out"
    assert emla(*RUN, "--output", "out").exit_code == 0
    assert any(out.glob("*.png"))
    (out / "metrics.json").write_text("changed by hand")
    for name in ("thesis.txt", ".unfinished-thesis.txt"):
        (out / name).write_text(USER_TEXT)
    (out / ".unfinished-abcdefgh").write_text("of a killed run")
    (out / ".unfinished-abcdefgi").symlink_to(out / "thesis.txt")
    (out / ".emla.json").write_text('{\n "format": "emla-output",\n "version": 1}')  # of an earlier version
    assert emla(*QUICK).exit_code == 0
    assert json.loads((out / "metrics.json").read_text())["run"]["steps"] == 20
    user_files = {"thesis.txt", ".unfinished-thesis.txt", ".unfinished-abcdefgi"}
    assert names(out) == {"results.csv", "metrics.json", "run.json", *user_files}
    assert all((out / name).read_text() == USER_TEXT for name in user_files)


@pytest.mark.usefixtures("on_one_cluster")
def test_folder_without_a_record_is_refused(emla: Emla, tmp_path: Path) -> None:
    assert emla(*QUICK).exit_code == 0
    (tmp_path / "out/run.json").unlink()
    before = state(tmp_path)
    assert sentence(emla(*QUICK), 2) == (
        "Error: the output folder 'out' has 'results.csv', which was not written by emla. Choose another "
        "output folder, or use --overwrite."
    )
    assert state(tmp_path) == before
    assert emla(*QUICK, "--overwrite").exit_code == 0
    assert emla(*SWEEP, "--output", "out").exit_code == 0, "other results of emla"
    assert {"run.json", "sweep.json"} < names(tmp_path / "out")


def test_result_of_python_replaces_its_own_files_only(fmu_folder: Path, tmp_path: Path) -> None:
    with ec.load("lift", stop_time=0.002, fmus=fmu_folder).prepare() as simulation:
        result = simulation.run()
    for _ in range(2):
        result.save(tmp_path / "out", plots=False)
    (tmp_path / "other").mkdir()
    (tmp_path / "other/errors.png").write_text(USER_TEXT)
    with pytest.raises(CommandError, match=r"has 'errors\.png', which was not written by emla"):
        result.save(tmp_path / "other")
    result.save(tmp_path / "other", overwrite=True)


@pytest.mark.parametrize("kind", [ec.CsvFile, ec.ParquetFile])
def test_table_of_python_replaces_its_own_file_only(
    kind: type[ec.CsvFile | ec.ParquetFile], fmu_folder: Path, tmp_path: Path
) -> None:
    end = kind.__name__[:-4].lower()
    path, second, notes = (tmp_path / name for name in (f"t.{end}", f"second.{end}", "notes.txt"))
    with ec.load("lift", stop_time=0.002, fmus=fmu_folder).prepare() as simulation:
        path.write_text(USER_TEXT)
        with pytest.raises(CommandError, match=f"t.{end}' was not written by emla"):
            simulation.run(recorders=[kind(path)])
        assert path.read_text() == USER_TEXT
        simulation.run(recorders=[kind(path, overwrite=True)])
        for stop_time in (0.001, 0.002):
            simulation.run(recorders=[kind(path), kind(second)], stop_time=stop_time)
        assert path.read_bytes() == second.read_bytes()
        notes.write_text(USER_TEXT)
        (tmp_path / "run.json").write_text('{"scenario": "lift", "status": "completed"}')
        with pytest.raises(CommandError, match=r"notes\.txt' was not written by emla"):
            simulation.run(recorders=[kind(notes)])
        path.unlink()
        path.symlink_to(notes)
        with pytest.raises(ec.CosimError, match="link"):
            simulation.run(recorders=[kind(path, overwrite=True)])
    assert path.is_symlink() and notes.read_text() == USER_TEXT


# ---- one command per folder --------------------------------------------------------------------

FOLDERS = {
    "run": QUICK,
    "sweep": (*SWEEP, "--output", "out"),
    "compare": (*COMPARE, "--output", "out"),
    "tune": (*TUNE, "--output", "out"),
    "size": ("size", "lift", *STOP_TIME, "--output", "out"),
    "linearize": ("linearize", "lift", "--open", "lift", "--stop-time", "0.01", "--output", "out"),
}


@pytest.mark.usefixtures("on_one_cluster")
@pytest.mark.parametrize("command", mostly_slow(FOLDERS, ["run"]))
def test_folder_takes_one_command_at_a_time(command: str, emla: Emla, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "other").mkdir()
    with exclusive_lock(tmp_path / "other"), exclusive_lock(tmp_path / "out"):
        before = state(tmp_path)
        assert json.loads((tmp_path / "out/.running.json").read_text())["process"] == os.getpid()
        message = sentence(emla(*FOLDERS[command]), 2)
        assert re.search(rf"another run writes to '.*out', process {os.getpid()} since 20", message)
        assert state(tmp_path) == before
    assert not list((tmp_path / "out").iterdir())


needs_proc = pytest.mark.skipif(sys.platform != "linux", reason="Only Linux tells when a process started.")


@pytest.mark.parametrize("fork", ["", pytest.param("ctypes.CDLL(None).fork(); ", marks=needs_proc)])
def test_lock_of_a_killed_command_is_taken_over(fork: str, emla: Emla, tmp_path: Path) -> None:
    """Also if a process that its FMU started, unnoticed by Python, still has the lock open."""
    out = tmp_path / "out"
    out.mkdir()
    code = (
        "import ctypes, sys; from pathlib import Path\n"
        "from emla_cosim.base.folder_lock import exclusive_lock as e\n"
        f"with e(Path(sys.argv[1])): print('held', flush=True); {fork}sys.stdin.read()"
    )
    command, pipe = [sys.executable, "-c", code, str(out)], subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as holder:
        assert holder.stdout is not None and holder.stdout.readline() == "held\n"
        assert f"process {holder.pid} since 20" in sentence(emla(*QUICK), 2)
        holder.kill()
        holder.wait()
        assert (out / ".running").exists()
        assert emla(*QUICK).exit_code == 0
    assert names(out) == {"results.csv", "metrics.json", "run.json"}


@pytest.mark.slow
def test_two_commands_with_one_file_leave_it_whole(fmu_folder: Path, tmp_path: Path) -> None:
    call = [sys.executable, "-m", "emla_cosim", "export", "lift", "x.ssp", "--fmus", str(fmu_folder)]
    pipe = subprocess.PIPE
    processes = [subprocess.Popen(call, cwd=tmp_path, stdout=pipe, stderr=pipe) for _ in range(2)]
    errors = [process.communicate(timeout=300)[1].decode() for process in processes]
    assert [process.returncode for process in processes] == [0, 0], errors
    with zipfile.ZipFile(tmp_path / "x.ssp") as archive:
        assert archive.testzip() is None
    assert [p.name for p in tmp_path.iterdir()] == ["x.ssp"]


# ---- files and folders that change while a command runs ----------------------------------------


def remove(out: Path, user_folder: Path) -> None:
    out.rename(out.with_name("moved"))


def replace_by_link(out: Path, user_folder: Path) -> None:
    remove(out, user_folder)
    out.symlink_to(user_folder, target_is_directory=True)


def replace_by_folder(out: Path, user_folder: Path) -> None:
    remove(out, user_folder)
    user_folder.rename(out)


CHANGES: list[tuple[Sequence[str], type[Any], str, Callable[[Path, Path], None]]] = [
    (QUICK, OutputFolder, "keep", remove),
    (QUICK, OutputFolder, "keep", replace_by_link),
    ((*RUN, "--output", "out"), OutputFolder, "draw", replace_by_folder),
    ((*SWEEP, "--output", "out"), SweepFolder, "finish", replace_by_link),
]
"""A command, the method before which its folder changes, and how."""


@pytest.mark.usefixtures("on_one_cluster")
@pytest.mark.parametrize(("command", "owner", "method", "change"), mostly_slow(CHANGES, CHANGES[1:2]))
def test_folder_that_changes_during_a_command(
    command: Sequence[str],
    owner: type[Any],
    method: str,
    change: Callable[[Path, Path], None],
    emla: Emla,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    out, user_folder = tmp_path / "out", tmp_path / "mine"
    user_folder.mkdir()
    files = ("metrics.json", "run.json", "results.csv", "variants.parquet", "sweep.json", "tracking.png")
    for name in files:
        (user_folder / name).write_text(USER_TEXT)
    original, changed = getattr(owner, method), list[bool]()

    def change_once(self: Any, *arguments: Any, **options: Any) -> Any:
        if not changed:
            changed.append(True)
            change(out, user_folder)
        return original(self, *arguments, **options)

    monkeypatch.setattr(owner, method, change_once)
    assert sentence(emla(*command), 1)
    folder = out if change is replace_by_folder else user_folder
    assert {p.name for p in folder.iterdir()} == set(files)
    assert all((folder / name).read_text() == USER_TEXT for name in files)
    assert change is not replace_by_link or out.is_symlink()


APPEARING = {
    "c": (*QUICK, "--checkpoint", "c"),
    "x.ssp": ("export", "lift", "x.ssp"),
    "i.json": ("info", "lift", "--json", "i.json"),
    "built/Reference/Reference.fmu": ("build", "Reference", "--output", "built"),
}
"""Commands by the file that appears."""


@pytest.mark.parametrize("file", mostly_slow(APPEARING, ["x.ssp"]))
def test_file_that_appears_during_a_command_stays(
    file: str, emla: Emla, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The user writes it just before the command gives its own file the name."""
    original, path, has_appeared = os.fsync, tmp_path / file, list[bool]()

    def fsync(handle: int) -> None:
        if not has_appeared:
            has_appeared.append(True)
            path.write_text(USER_TEXT)
        original(handle)

    monkeypatch.setattr(fmublock.files.os, "fsync", fsync)
    message = sentence(emla(*APPEARING[file]), 1)
    assert "appeared while emla ran" in message or "was not built by" in message
    assert (tmp_path / file).read_text() == USER_TEXT
    assert not [p for p in tmp_path.rglob("*") if p.name.startswith(UNFINISHED)]
    has_appeared.clear()
    assert emla(*APPEARING[file], "--overwrite").exit_code == 0 and has_appeared
    assert (tmp_path / file).read_bytes() != USER_TEXT.encode()


def test_file_that_appears_while_a_run_is_prepared_stays(
    emla: Emla, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begin = OutputFolder.begin

    def late(self: OutputFolder, *arguments: Any, **options: Any) -> None:
        (tmp_path / "out/run.json").write_text(USER_TEXT)
        begin(self, *arguments, **options)

    monkeypatch.setattr(OutputFolder, "begin", late)
    assert "has 'run.json', which was not" in sentence(emla(*QUICK), 2)
    assert (tmp_path / "out/run.json").read_text() == USER_TEXT


@pytest.mark.parametrize("replaced", [False, True])
def test_table_that_is_removed_during_a_run_is_reported(
    replaced: bool, fmu_folder: Path, tmp_path: Path
) -> None:
    path = tmp_path / "results.csv"

    class Removing(ec.Recorder):
        def write(self, rows: Any) -> None:
            path.unlink()
            if replaced:
                path.write_text(USER_TEXT)

    with (
        ec.load("lift", stop_time=0.01, fmus=fmu_folder).prepare() as simulation,
        pytest.raises(ec.RunError, match="removed or replaced while the run wrote to it"),
    ):
        simulation.run(recorders=[ec.CsvFile(path), Removing()])
    assert not replaced or path.read_text() == USER_TEXT


# ---- names -------------------------------------------------------------------------------------


def test_conflicting_names_are_refused(emla: Emla, tmp_path: Path, faulty_fmu: Path) -> None:
    """Also if two names differ only in case. Refused before anything is computed."""
    (tmp_path / "my.toml").write_text('system = "lift"\nstop_time = 0.002\nplots = false\n')
    (tmp_path / "endless.toml").symlink_to("/dev/zero")
    assert emla("export", "lift", "x.ssp").exit_code == 0
    (tmp_path / "link.ssp").symlink_to("x.ssp")
    for name in ("Faulty.fmu", "f/FAULTY.fmu"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copy(faulty_fmu, tmp_path / name)
    source = Path(toy.__file__).read_text()
    for name in ("b.py", "c.py"):
        (tmp_path / name).write_text(f"{source}\n\nclass toy(Toy):\n    pass\n")
    before, n = state(tmp_path), "n" * 300
    for command, words in (
        ((*QUICK, "--checkpoint", "out/results.csv"), "is also a file of the results"),
        ((*QUICK, "--checkpoint", "out/../out/run.json"), "is also a file of the results"),
        ((*QUICK, "--checkpoint", "out/RUN.json"), "is also a file of the results"),
        (("run", "my.toml", "--checkpoint", "my.toml"), "the checkpoint 'my.toml' is also the scenario"),
        (("run", "x.ssp", *STOP_TIME, "--checkpoint", "link.ssp"), "'link.ssp' cannot be written: it is a"),
        ((*RUN, "--replace", "lift.plant=x.ssp", "--checkpoint", "x.ssp"), "is also the FMU"),
        (("export", "x.ssp", "x.ssp"), "the package 'x.ssp' is also the scenario"),
        (
            ("verify", "Faulty.fmu", "--json", "r", "--html", "R"),
            "report 'R' is also the JSON report 'r'",
        ),
        (("verify", "Faulty.fmu", "f/FAULTY.fmu", "--record", "r"), "two FMUs have the name FAULTY"),
        (("build", "b.py:Toy", "b.py:toy"), "the FMUs of 'b.py:Toy' and 'b.py:toy' have the same name"),
        (("build", "b.py:Toy", "c.py:Toy"), "the FMUs of 'b.py:Toy' and 'c.py:Toy' have the same name"),
        (("trajectory", "--output", "x.PNG"), "must not end in .png"),
        (("run", "endless.toml"), "it is a device"),
        ((*QUICK, "--checkpoint", n), "the checkpoint"),
        ((*RUN, "--no-plots", "--output", n), "the output folder"),
        (("export", "lift", f"{n}.ssp"), "cannot be written"),
    ):
        assert words in sentence(emla(*command), 2)
        shutil.rmtree(tmp_path / "out", ignore_errors=True)
    assert_unchanged(tmp_path, before)


def test_links_to_folders_are_followed_and_links_to_files_are_not(emla: Emla, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "out").symlink_to("elsewhere")
    assert emla(*QUICK, "--checkpoint", "out/c").exit_code == 0
    assert names(tmp_path / "elsewhere") == {"results.csv", "metrics.json", "run.json", "c"}
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    with pytest.raises(OSError):
        real_place(tmp_path / "a")
    assert real_place(tmp_path / "out" / "new") == (tmp_path / "elsewhere" / "new").resolve()
    for name, words in (("out", "a symbolic link"), ("a", "a symbolic link"), ("elsewhere/..", "a folder")):
        with pytest.raises(NotAFileError, match=f"it is {words}"):
            real_place(tmp_path / name)


def test_paths_are_relative_to_where_a_simulation_was_prepared(
    fmu_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("here", "elsewhere"):
        (tmp_path / name).mkdir()
    (tmp_path / "elsewhere" / "c").write_text(USER_TEXT)
    monkeypatch.chdir(tmp_path / "here")

    class MovingRecorder(ec.Recorder):
        def pause(self, run: Any) -> None:
            os.chdir(tmp_path / "elsewhere")  # as an FMU may do

    with ec.load("lift", stop_time=0.002).prepare(fmus=fmu_folder) as simulation:
        simulation.run(checkpoint="c", recorders=[MovingRecorder(), ec.TimeSeries()])
        simulation.run(checkpoint="c", stop_time=0.003)
        assert simulation.run(resume="c", stop_time=0.004).simulated_s == pytest.approx(0.001)
        (tmp_path / "elsewhere" / "sub").mkdir()
        with pytest.raises(CommandError, match="the checkpoint 'sub/c' cannot be written: there is no"):
            simulation.run(checkpoint="sub/c")
        with pytest.raises(CommandError, match=r"the checkpoint .* cannot be written: .*null"):
            simulation.run(checkpoint="x\0y")
    assert (tmp_path / "here" / "c").exists()
    assert (tmp_path / "elsewhere" / "c").read_text() == USER_TEXT


def test_file_system_that_ignores_case(emla: Emla, tmp_path: Path, faulty_fmu: Path) -> None:
    (tmp_path / "case").touch()
    if not (tmp_path / "CASE").exists():
        pytest.skip("Names of files that differ only in case are different here.")
    shutil.copy(faulty_fmu, "Faulty.fmu")
    Path("out").mkdir()
    for user_file, command in (
        ("out/Results.csv", QUICK),
        ("OUT/Variants.parquet", (*SWEEP, "--output", "out")),
        ("X.SSP", ("export", "lift", "x.ssp")),
        ("I.json", ("info", "lift", "--json", "i.json")),
        ("V.json", ("verify", "Faulty.fmu", "--only", "archive", "--json", "v.json")),
        ("reference", ("build", "Reference", "--platform", "linux64", "--output", ".")),
    ):
        Path(user_file).write_text(USER_TEXT)
        sentence(emla(*command), 2)
        assert Path(user_file).read_text() == USER_TEXT
        Path(user_file).unlink()
    assert emla(*QUICK).exit_code == 0
    before = names(Path("out"))
    assert emla(*QUICK[:-1], "OUT").exit_code == 0
    assert names(Path("out")) == before
    with zipfile.ZipFile("a.zip", "w") as archive:
        archive.writestr("resources/Pump.fmu", b"one")
        archive.writestr("resources/pump.fmu", b"another")
    with pytest.raises(UnsafeArchiveError, match="names differ only in case"):
        unpack(tmp_path / "a.zip", tmp_path / "unpacked")


# ---- FMUs --------------------------------------------------------------------------------------


def test_user_fmus_are_not_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    user_fmu = FMU_FOLDER / "Reference" / "Reference.fmu"
    user_fmu.parent.mkdir(parents=True)
    user_fmu.write_bytes(b"PK of another tool")
    with pytest.raises(CommandError, match=r"'fmus/Reference/Reference.fmu' was not written by emla"):
        check_build_path("Reference", "native")
    check_build_path("Reference", "native", overwrite=True)
    check_build_path("Controller", "native")

    shutil.copy(toy.__file__, "toy.py")
    command = ["build", "toy.py:Toy"]
    Path("Toy.fmu").write_text(USER_TEXT)
    assert fmublock_main(command) == 2
    assert "'Toy.fmu' was not built by fmublock" in capsys.readouterr().err
    assert Path("Toy.fmu").read_text() == USER_TEXT
    for more in (["--overwrite"], []):
        assert fmublock_main([*command, *more]) == 0
    Path("Toy.fmu").rename("elsewhere.fmu")
    Path("Toy.fmu").symlink_to("elsewhere.fmu")
    assert fmublock_main([*command, "--overwrite"]) == 2
