"""No command replaces a file that emla did not write: each option that names an output is tried."""

import json
import os
import shutil
import stat
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import Any, get_args

import pytest

import emla_cosim as ec
from emla_cosim.base.errors import CommandError
from emla_cosim.base.ownership import MANIFEST, OutputFiles, has_entries
from emla_cosim.cli.app import COMMANDS
from emla_cosim.cli.commands.options import with_options
from emla_cosim.comparison.certificates import CertificateFolder
from emla_cosim.comparison.folder import CompareFolder
from emla_cosim.fmu.models import FMU_FOLDER, check_build_path
from emla_cosim.run.options import list_options
from emla_cosim.sandbox.locking import exclusive_lock
from emla_cosim.sweeps.folder import SweepFolder
from emla_cosim.tuning.folder import TuneFolder
from emla_cosim.views.animation import ANIMATIONS
from emla_cosim.views.folder import Folder
from emla_cosim.views.output_folder import OutputFolder
from emla_cosim.views.plots.pictures import FIGURES
from fmublock import build
from fmublock.__main__ import main as fmublock_main
from fmublock.platforms import host_platform
from tests.support import toy
from tests.support.commands import Emla, sentence

WORK = "years of work\n"
SHORT = ("--stop-time", "0.002")
RUN = ("run", "lift", *SHORT)
SWEEP = ("sweep", "lift", "--vary", "lift.plant.motor.R_s=0.1,0.2", *SHORT)
COMPARE = ("compare", "lift", "--controllers", "foc", *SHORT)
CERTIFY = ("compare", "lift", "--gains", "robust", "--table", "certificate", *SHORT)
TUNE = ("tune", "lift", "--vary", "lift.controller.beta[1]=200:4000", "--objective", "lift.position_error_m")
TUNE = (*TUNE, "--evaluations", "4", "--validation", "0", *SHORT)
FIRST = (*RUN, "--output", "first")
IDENTIFY = ("identify", "lift", "--measured", "first/results.csv:lift.plant.x_L=lift.plant.x_L")
IDENTIFY = (*IDENTIFY, "--vary", "lift.plant.motor.J_m=0.1:0.4", "--evaluations", "2", *SHORT)
VERIFY = ("verify", "read.fmu", "--only", "archive")
SIZE = ("size", "prototype", "--stop-time", "0.05", "--lead-in", "350ms")
LINEARIZE = ("linearize", "lift", "--open", "lift.controller.u_q->lift.plant.u_q", "--stop-time", "0.1")
TRAJECTORY = ("trajectory", "--knots", "10", "--points", "5")

PICTURES = [f"{name}.png" for name in FIGURES]
FILMS = [f"{name}.gif" for name in ANIMATIONS]
RUN_FILES = ["results.csv", "metrics.json", "run.json", MANIFEST, *PICTURES]


@dataclass(frozen=True)
class Attempt:
    """A command whose output is named by an option, and the files that it would write there.

    `files` are relative to a folder that is named; none of an option that names a file. `before` are
    commands that make what the command reads.
    """

    arguments: Sequence[str]
    option: str
    files: Sequence[str] = ()
    suffix: str = ""
    before: Sequence[Sequence[str]] = ()
    replaces: bool = True
    """Whether --overwrite is tried: some commands take too long."""
    code: int = 0
    """How the command ends where it may write."""

    def named(self, place: str) -> list[str]:
        return [*self.arguments, self.option, place] if self.option else [*self.arguments, place]


FMUS = {"files": ["EmlaPlant/EmlaPlant.fmu"], "replaces": False}
RECORDED = ["read_ref.csv", "read_ref.opt", "read_ref.toml"]

ATTEMPTS: dict[str, list[Attempt]] = {
    "build output": [
        Attempt(
            ("build", "Reference", "--platform", host_platform()), "--output", ["Reference/Reference.fmu"]
        )
    ],
    "run output": [
        Attempt(RUN, "--output", RUN_FILES),
        Attempt((*RUN, "--no-plots", "--report"), "--output", ["report.html"]),
        Attempt((*RUN, "--no-plots", "--output-format", "parquet"), "--output", ["results.parquet"]),
        Attempt(("run", "hdrm-replay", *SHORT, "--animate"), "--output", FILMS, replaces=False),
    ],
    "run fmus": [Attempt((*RUN, "--output", "o"), "--fmus", **FMUS)],
    "run checkpoint": [Attempt((*RUN, "--no-plots", "--output", "o"), "--checkpoint")],
    "rerun output": [
        Attempt(("rerun", "first"), "--output", RUN_FILES, before=[(*RUN, "--output", "first")]),
    ],
    "rerun fmus": [
        Attempt(("rerun", "first", "--output", "o"), "--fmus", before=[(*RUN, "--output", "first")], **FMUS)
    ],
    "rerun checkpoint": [
        Attempt(("rerun", "first", "--output", "o"), "--checkpoint", before=[(*RUN, "--output", "first")])
    ],
    "info json": [Attempt(("info", "lift"), "--json")],
    "info fmus": [Attempt(("info", "lift"), "--fmus", **FMUS)],
    "plot output": [
        Attempt(("plot", "first"), "--output", suffix=".png", before=[(*RUN, "--output", "first")])
    ],
    "sweep output": [
        Attempt(SWEEP, "--output", ["variants.parquet", "sweep.json", "worst.txt", "figures.png", MANIFEST]),
    ],
    "sweep fmus": [Attempt((*SWEEP, "--output", "o"), "--fmus", **FMUS)],
    "compare output": [
        Attempt(
            COMPARE,
            "--output",
            ["comparison.csv", "comparison.md", "comparison.json", "comparison-errors.png", MANIFEST],
        ),
        Attempt(CERTIFY, "--output", ["certificate.csv", "certificate.md"]),
    ],
    "compare fmus": [Attempt((*COMPARE, "--output", "o"), "--fmus", **FMUS)],
    "tune output": [
        Attempt(TUNE, "--output", ["best.toml", "tune.json", "history.csv", "tuning.png", MANIFEST], code=1),
    ],
    "tune fmus": [Attempt((*TUNE, "--output", "o"), "--fmus", **FMUS)],
    "identify output": [
        Attempt(
            IDENTIFY,
            "--output",
            ["identified.toml", "identify.json", "samples.csv", "fit.png", "certainty.png", MANIFEST],
            before=[FIRST],
        ),
        Attempt((*IDENTIFY, "--report"), "--output", ["identify.html"], before=[FIRST]),
    ],
    "identify fmus": [Attempt((*IDENTIFY, "--output", "o"), "--fmus", **FMUS, before=[FIRST])],
    "trajectory output": [Attempt(TRAJECTORY, "--output")],
    "size output": [
        Attempt(SIZE, "--output", ["size.json", "limits.csv", "cycles.csv", "prototype.png", MANIFEST]),
        Attempt((*SIZE, "--report"), "--output", ["size.html"]),
    ],
    "size fmus": [Attempt((*SIZE, "--no-plots", "--output", "o"), "--fmus", **FMUS)],
    "linearize output": [
        Attempt(
            LINEARIZE, "--output", ["linearize.json", "responses.csv", "bode.png", "nyquist.png", MANIFEST]
        )
    ],
    "linearize fmus": [Attempt((*LINEARIZE, "--no-plots", "--output", "o"), "--fmus", **FMUS)],
    "verify junit": [Attempt(VERIFY, "--junit")],
    "verify json": [Attempt(VERIFY, "--json")],
    "verify html": [Attempt(VERIFY, "--html")],
    "verify record": [Attempt(("verify", "read.fmu"), "--record", RECORDED)],
    "export file": [Attempt(("export", "lift"), "", suffix=".ssp")],
    "export fmus": [Attempt(("export", "lift", "x.ssp"), "--fmus", **FMUS)],
}
"""By command and parameter; more than one where other options decide what is written."""

READ = {
    *("rerun run", "plot runs", "trajectory problem"),
    *("verify reference", "verify input_", "run reference", "rerun reference"),
}
"""Paths that are only read and that are not in the table of options, by command and parameter."""

BESIDE_TRAJECTORY = ("place-forces-and-speeds.png", "place-positions-and-accelerations.png", "place-path.png")


def paths_of_commands() -> set[str]:
    """All parameters that are paths, by command and name."""
    found = set[str]()
    for name in COMMANDS:
        module = import_module(f"emla_cosim.cli.commands.{name}")
        if (taken := getattr(module, "OPTIONS", None)) is not None:
            parameters = signature(with_options(module.command, taken), eval_str=True).parameters
            found |= {f"{name} {p.name}" for p in parameters.values() if is_path(p.annotation)}
    return found


def is_path(kind: Any) -> bool:
    return kind is Path or any(map(is_path, get_args(kind)))


def test_every_option_that_names_an_output_is_tried() -> None:
    known = {
        f"{c} {o.name}" for c in (*COMMANDS,) for o in list_options(command_of(c)).values() if o.about.writes
    }
    assert known <= ATTEMPTS.keys()
    reading = {o.name for o in list_options().values() if not o.about.writes}
    left = {path for path in paths_of_commands() - READ if path.split()[1] not in reading}
    assert left == ATTEMPTS.keys()


def command_of(name: str) -> str:
    """The name by which the table of options knows a command."""
    return {"rerun": "run", "tune": "sweep"}.get(name, name)


# ---- what is somebody else's -----------------------------------------------------------------------


def a_file(place: Path, outside: Path) -> None:
    place.write_text(WORK)


def a_link(place: Path, outside: Path) -> None:
    place.symlink_to(outside)


def a_dangling_link(place: Path, outside: Path) -> None:
    place.symlink_to(outside.with_name("gone"))


def a_pipe(place: Path, outside: Path) -> None:
    os.mkfifo(place)


def a_folder(place: Path, outside: Path) -> None:
    place.mkdir()
    (place / "thesis.txt").write_text(WORK)


Make = Callable[[Path, Path], None]
KINDS: list[Make] = [a_file, a_link, a_dangling_link, a_pipe, a_folder]


def state(folder: Path) -> dict[Path, tuple[int, bytes]]:
    """What everything in a folder is, and its content."""
    found = {}
    for path in folder.rglob("*"):
        kind = stat.S_IFMT(path.lstat().st_mode)
        content = path.read_bytes() if kind == stat.S_IFREG else b""
        found[path] = (kind, str(path.readlink()).encode() if kind == stat.S_IFLNK else content)
    return found


CASES = [
    pytest.param(attempt, file, id=f"{name} {file or 'itself'}")
    for name, attempts in ATTEMPTS.items()
    for attempt in attempts
    for file in (*attempt.files, *([""] if attempt is attempts[0] else []))
]


@pytest.mark.parametrize(("attempt", "file"), CASES)
def test_what_is_somebody_elses_is_neither_replaced_nor_removed(
    attempt: Attempt, file: str, emla: Emla, tmp_path: Path, toy_file: bytes
) -> None:
    """Neither a file, nor what a link leads to, nor the link, nor anything else."""
    (tmp_path / "read.fmu").write_bytes(toy_file)
    for before in attempt.before:
        assert emla(*before, "--no-plots").exit_code == 0
    for make in KINDS if file in ("", *attempt.files[:1]) else KINDS[:2]:
        folder = tmp_path / make.__name__
        outside = folder / "outside"
        named = folder / f"place{attempt.suffix}"
        place = named / file if file else named
        place.parent.mkdir(parents=True)
        outside.write_text(WORK)
        make(place, outside)
        if not file and attempt.files and make is a_folder:
            continue  # a folder that is named may have other files
        before = state(folder)
        arguments = attempt.named(str(named))
        for more in ((),) if make is a_file else ((), ("--overwrite",)):
            said = sentence(emla(*arguments, *more), 2)
            assert len(said) < 600
            after = state(folder)
            assert {path: after.get(path) for path in before} == before, (make, more)
            if make is a_file and (file or not attempt.files):
                assert "--overwrite" in said


REPLACED = [
    pytest.param(attempt, id=f"{name} {i}")
    for name, attempts in ATTEMPTS.items()
    for i, attempt in enumerate(attempts)
    if attempt.replaces
]


@pytest.mark.usefixtures("on_one_cluster")
@pytest.mark.parametrize("attempt", REPLACED)
def test_overwrite_replaces_regular_files_and_ours_are_replaced_without(
    attempt: Attempt, emla: Emla, tmp_path: Path, toy_file: bytes
) -> None:
    (tmp_path / "read.fmu").write_bytes(toy_file)
    for before in attempt.before:
        assert emla(*before, "--no-plots").exit_code == 0
    named = tmp_path / f"place{attempt.suffix}"
    files = [named / file for file in attempt.files] or [named]
    for file in files:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(WORK)
    copy = tmp_path / "copy"
    os.link(files[0], copy)
    ended = emla(*attempt.named(str(named)), "--overwrite")
    assert ended.exit_code == attempt.code, ended.output
    assert copy.read_text() == WORK, "what has another name stays, too"
    unwritten = {"worst.txt"} | set(PICTURES)  # which not every command has
    assert all(f.read_bytes() != WORK.encode() for f in files if f.exists() and f.name not in unwritten)
    if "--record" in attempt.option:
        return  # reference files are only replaced with the option
    (named if attempt.files else tmp_path).joinpath("thesis.txt").write_text(WORK)
    again = emla(*attempt.named(str(named)))
    assert again.exit_code == attempt.code, again.output
    assert (named if attempt.files else tmp_path).joinpath("thesis.txt").read_text() == WORK


def test_pictures_beside_a_trajectory_are_not_replaced(emla: Emla, tmp_path: Path) -> None:
    for name in BESIDE_TRAJECTORY:
        (tmp_path / name).write_text(WORK)
        assert f"{name}' was not written by emla" in sentence(emla(*TRAJECTORY, "--output", "place.json"), 2)
        assert (tmp_path / name).read_text() == WORK
        (tmp_path / name).unlink()
    assert not (tmp_path / "place.json").exists()


@pytest.fixture(scope="session")
def toy_file(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """An FMU that takes no time to be examined."""
    path = tmp_path_factory.mktemp("toy") / "Toy.fmu"
    build(toy.Toy, path)
    return path.read_bytes()


# ---- the folder of a run ---------------------------------------------------------------------------


def test_a_run_removes_and_replaces_its_own_files_only(emla: Emla, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    for name in ("report.html", "errors.png", "results.parquet", "thesis.txt"):
        (out / name).write_text(WORK)
    for _ in range(2):
        assert emla(*RUN, "--no-plots", "--output", "out").exit_code == 0
    for name in ("report.html", "errors.png", "results.parquet", "thesis.txt"):
        assert (out / name).read_text() == WORK
    listed = json.loads((out / MANIFEST).read_text())
    assert listed["format"] == "emla-output"
    assert listed["files"].keys() == {"results.csv", "metrics.json", "run.json"}


def test_pictures_of_an_earlier_run_go_with_the_next(emla: Emla, tmp_path: Path) -> None:
    assert emla(*RUN, "--output", "out").exit_code == 0
    drawn = {p.name for p in (tmp_path / "out").glob("*.png")}
    assert drawn
    assert emla(*RUN, "--output", "out", "--no-plots").exit_code == 0
    assert not any((tmp_path / "out").glob("*.png"))


def test_a_file_that_was_changed_is_not_replaced(emla: Emla, tmp_path: Path) -> None:
    assert emla(*RUN, "--no-plots", "--output", "out").exit_code == 0
    with (tmp_path / "out/metrics.json").open("a") as stream:
        stream.write("\n")
    said = sentence(emla(*RUN, "--no-plots", "--output", "out"), 2)
    assert said == (
        "Error: 'out/metrics.json' was changed since emla wrote it. Choose another output folder, or use "
        "--overwrite."
    )
    assert emla(*RUN, "--no-plots", "--output", "out", "--overwrite").exit_code == 0


def test_a_folder_of_an_earlier_version_is_recognized(emla: Emla, tmp_path: Path) -> None:
    assert emla(*RUN, "--output", "out").exit_code == 0
    (tmp_path / "out" / MANIFEST).unlink()
    assert emla(*RUN, "--output", "out", "--no-plots").exit_code == 0
    assert not any((tmp_path / "out").glob("*.png"))
    for name in (MANIFEST, "run.json"):
        (tmp_path / "out" / name).unlink()
    before = state(tmp_path / "out")
    said = sentence(emla(*RUN, "--output", "out"), 2)
    assert said == (
        "Error: 'out/results.csv' was not written by emla. Choose another output folder, or use --overwrite."
    )
    assert state(tmp_path / "out") == before


@pytest.mark.parametrize(
    ("kind", "records"),
    [
        (SweepFolder, {"sweep.json": {"identity": {}, "status": "completed"}}),
        (TuneFolder, {"tune.json": {"plan": {}, "best": {}, "runs": 3}}),
        (CompareFolder, {"comparison.json": {"entrants": [], "runs": []}}),
        (CertificateFolder, {"certificate.csv": "gains,figure,unit,lift\n"}),
    ],
)
def test_folders_of_earlier_versions_are_recognized(
    kind: type[Folder], records: Mapping[str, Any], tmp_path: Path
) -> None:
    for name in (*kind.files, *kind.pictures):
        (tmp_path / name).write_text(WORK)
    with pytest.raises(CommandError, match="was not written by emla"):
        kind(tmp_path)
    for name, content in records.items():
        (tmp_path / name).write_text(content if isinstance(content, str) else json.dumps(content))
    folder = kind(tmp_path)
    folder.check_files((*kind.files, *kind.pictures))


def test_a_result_is_saved_over_its_own_files_only(fmu_folder: Path, tmp_path: Path) -> None:
    with ec.load("lift", stop_time=0.002, fmus=fmu_folder).prepare() as simulation:
        result = simulation.run()
    result.save(tmp_path / "out", plots=False)
    result.save(tmp_path / "out", plots=False)
    (tmp_path / "out/errors.png").write_text(WORK)
    result.save(tmp_path / "out", plots=False)
    with pytest.raises(CommandError, match=r"errors\.png' was not written by emla"):
        result.save(tmp_path / "out")
    result.save(tmp_path / "out", overwrite=True)


def test_a_file_that_comes_while_a_run_is_prepared_stays(
    emla: Emla, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clear = OutputFolder.check

    def late(self: OutputFolder) -> None:
        if (tmp_path / "out/.running").exists():
            (tmp_path / "out/run.json").write_text(WORK)
        clear(self)

    monkeypatch.setattr(OutputFolder, "check", late)
    assert "run.json' was not" in sentence(emla(*RUN, "--no-plots", "--output", "out"), 2)
    assert (tmp_path / "out/run.json").read_text() == WORK


# ---- the lock, the manifest, what was not complete ---------------------------------------------------


@pytest.mark.parametrize("name", [".running", ".running.json", MANIFEST])
@pytest.mark.parametrize("make", KINDS)
def test_hidden_files_are_nobody_elses(name: str, make: Make, emla: Emla, tmp_path: Path) -> None:
    out, outside = tmp_path / "out", tmp_path / "outside"
    out.mkdir()
    outside.write_text(WORK)
    make(out / name, outside)
    before = state(tmp_path)
    for command in (RUN, SWEEP):
        said = sentence(emla(*command, "--no-plots", "--output", "out"), 2)
        assert name in said
        assert state(tmp_path) == before


def test_a_lock_that_a_killed_run_left_is_taken_over(tmp_path: Path) -> None:
    (tmp_path / ".running").touch()
    (tmp_path / ".running.json").write_text('{"process": 1, "began": "2026-01-01T00:00:00+00:00"}')
    with exclusive_lock(tmp_path):
        assert json.loads((tmp_path / ".running.json").read_text())["process"] == os.getpid()
    assert not list(tmp_path.iterdir())


def test_only_names_of_ours_are_unfinished(emla: Emla, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / ".unfinished-thesis.txt").write_text(WORK)
    (out / ".unfinished-abcdefgh").write_text("half")
    (out / ".unfinished-abcdefgi").symlink_to(out / ".unfinished-thesis.txt")
    assert emla(*RUN, "--no-plots", "--output", "out").exit_code == 0
    assert (out / ".unfinished-thesis.txt").read_text() == WORK
    assert not (out / ".unfinished-abcdefgh").exists()
    assert (out / ".unfinished-abcdefgi").is_symlink()


def test_a_folder_of_parts_is_a_folder_of_a_run(emla: Emla, tmp_path: Path) -> None:
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside/000000.parquet").write_text(WORK)
    (tmp_path / "out").mkdir()
    (tmp_path / "out/results.parquet.parts").symlink_to(tmp_path / "outside")
    before = state(tmp_path)
    for more in ((), ("--overwrite",)):
        arguments = (*RUN, "--no-plots", "--output-format", "parquet", "--output", "out", *more)
        assert "is not a folder of a run; move it away" in sentence(emla(*arguments), 2)
        assert state(tmp_path) == before


def test_files_are_claimed_before_and_settled_after_they_are_written(tmp_path: Path) -> None:
    files = OutputFiles(tmp_path, tmp_path, "r.json", has_entries("x"), ["r.json", "a"])
    files.claim(["a", "r.json"])
    (tmp_path / "a").write_text("half of it")
    files.check(["a"], "the file")  # a killed command left it
    files.settle()
    assert json.loads((tmp_path / MANIFEST).read_text())["files"].keys() == {"a"}
    files.check(["a"], "the file")
    (tmp_path / "a").write_text("the other half")
    with pytest.raises(CommandError, match="was changed since emla wrote it"):
        files.check(["a"], "the file")
    files.remove(["a"])
    assert (tmp_path / "a").exists()
    OutputFiles(tmp_path, tmp_path, "r.json", has_entries("x"), ["a"], overwrite=True).remove(["a"], ["a"])
    assert not (tmp_path / "a").exists()


# ---- FMUs ------------------------------------------------------------------------------------------


def test_fmus_in_the_present_folder_are_not_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    mine = FMU_FOLDER / "Reference" / "Reference.fmu"
    mine.parent.mkdir(parents=True)
    mine.write_bytes(b"PK of another tool")
    with pytest.raises(CommandError, match=r"'fmus/Reference/Reference.fmu' was not written by emla"):
        check_build_path("Reference", "native")
    check_build_path("Reference", "native", overwrite=True)
    check_build_path("Controller", "native")


def test_fmublock_replaces_its_own_fmus_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copy(toy.__file__, "toy.py")
    Path("Toy.fmu").write_text(WORK)
    assert fmublock_main(["build", "toy.py:Toy"]) == 2
    assert "'Toy.fmu' was not built by fmublock" in capsys.readouterr().err
    assert Path("Toy.fmu").read_text() == WORK
    for more in (["--overwrite"], []):
        assert fmublock_main(["build", "toy.py:Toy", *more]) == 0
    Path("Toy.fmu").rename("elsewhere.fmu")
    Path("Toy.fmu").symlink_to("elsewhere.fmu")
    assert fmublock_main(["build", "toy.py:Toy", "--overwrite"]) == 2
