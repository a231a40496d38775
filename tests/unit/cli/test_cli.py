"""The `emla` command: the files that it leaves, and one error message with exit code 2 for each mistake."""

import json
import re
import zipfile
from pathlib import Path

import numpy as np
import polars
import pytest

from emla_cosim.fmu.models import PLATFORMS
from emla_cosim.run.scenarios.scenario_file import SCENARIOS
from emla_cosim.study.figures import JOINT_FIGURES
from fmublock.platforms import host_platform
from tests.support.commands import Emla, sentence
from tests.support.whole_files import names

TABLES = {"results.csv", "metrics.json", "run.json"}
PICTURES = {f"{name}.png" for name in JOINT_FIGURES}
ORDER = "lift.plant,lift.observer,lift.controller,lift.reference,lift.disturbance"


def test_run_writes_table_metrics_record_and_pictures(emla: Emla, tmp_path: Path) -> None:
    result = emla("run", "lift", "--stop-time", "0.4", "--set", "lift.plant.motor.R_s=0.2")
    assert result.exit_code == 0, result.output
    assert "position error" in result.stdout and "lift" in result.stdout
    folder = tmp_path / "results" / "lift"
    assert names(folder) == TABLES | PICTURES
    frame = polars.read_csv(folder / "results.csv")
    assert frame.columns[0] == "time" and "lift.plant.x_L" in frame.columns
    assert frame["time"].to_numpy() == pytest.approx(np.arange(401) * 1e-3)
    metrics = json.loads((folder / "metrics.json").read_text())
    assert metrics["run"]["steps"] == 4000
    record = json.loads((folder / "run.json").read_text())
    assert record["status"] == "completed"
    assert record["settings"]["step_size_s"] == 1e-4
    assert record["settings"]["output_interval_s"] == pytest.approx(1e-3, rel=1e-12)
    plant = record["components"]["lift.plant"]
    assert plant["parameters"]["motor.R_s"] == "0.2" and len(plant["sha256"]) == 64
    assert all((folder / name).read_bytes().startswith(b"\x89PNG") for name in PICTURES)
    # the next run removes the pictures of this one, and no other file
    (folder / "mine.txt").write_text("keep")
    assert emla("run", "lift", "--stop-time", "0.01", "--no-plots").exit_code == 0
    assert names(folder) == TABLES | {"mine.txt"}
    before = {p.name: p.read_bytes() for p in folder.iterdir()}
    sentence(emla("run", "lift", "--set", "lift.plant.x=1"), 2)
    assert {p.name: p.read_bytes() for p in folder.iterdir()} == before


def test_run_too_short_to_judge(emla: Emla) -> None:
    options = emla("run", "lift", "--stop-time", "0.3", "--no-plots").stdout
    assert options.startswith("Too short to judge: that takes more than 0.3 s.\n")
    assert "held   " not in options and "not settled" not in options
    longer = emla("run", "lift", "--stop-time", "0.31", "--no-plots").stdout
    assert "Too short" not in longer and longer.startswith("lift, 0.31 s simulated")


def test_sweeps_of_strong_coupling_are_shown(emla: Emla) -> None:
    output = emla("run", "lift", "--stop-time", "0.01", "--algorithm", "strong", "--no-plots").stdout
    assert re.search(r"One loop agreed after [\d.]+ sweeps a step", output)


def test_options_reach_the_run(emla: Emla, tmp_path: Path) -> None:
    options = (
        "--step-size 2e-5 --stop-time 0.01 --output-interval 2e-3 --gains robust --no-plots --output out"
    )
    values = "--set lift.plant.use_commanded_current=true --step-multiple lift.controller=5"
    result = emla("run", "lift", "--order", ORDER, *options.split(), *values.split())
    assert result.exit_code == 0, result.output
    record = json.loads((tmp_path / "out/run.json").read_text())
    settings = record["settings"]
    assert (settings["step_size_s"], settings["output_interval_s"]) == (2e-5, 2e-3)
    assert (settings["gains"], settings["order"]) == ("robust", ORDER.split(","))
    metrics = json.loads((tmp_path / "out/metrics.json").read_text(), parse_constant=pytest.fail)
    assert metrics["joints"]["lift"]["position_error_m"] is None  # as errors count from 0.3 s on
    assert settings["step_multiples"] == {"lift.controller": 5}
    assert record["components"]["lift.plant"]["parameters"]["use_commanded_current"] == "true"
    assert len(polars.read_csv(tmp_path / "out/results.csv")) == 6


def test_list_names_everything(emla: Emla) -> None:
    result = emla("list")
    assert result.exit_code == 0
    for name in (*SCENARIOS, "EmlaPlant", "RsbaController", "native", "gauss-seidel"):
        assert name in result.stdout


@pytest.mark.parametrize(
    ("options", "platforms"),
    [(["--platform", "linux64"], {"linux64"}), pytest.param([], set(PLATFORMS), marks=pytest.mark.slow)],
)
def test_build_writes_one_fmu_for_these_platforms(
    options: list[str], platforms: set[str], emla: Emla, tmp_path: Path
) -> None:
    result = emla("build", "Reference", "--output", "out", *options)
    assert result.exit_code == 0 and "Reference.fmu" in result.stdout, result.output
    (path,) = tmp_path.rglob("*.fmu")
    assert path == tmp_path / "out/Reference/Reference.fmu"
    with zipfile.ZipFile(path) as archive:
        assert {n.split("/")[1] for n in archive.namelist() if n.startswith("binaries/")} == platforms


# ---- mistakes ----------------------------------------------------------------------------------------

MISTAKES = [
    ("run nosuch", "no scenario 'nosuch'", "study", "lift"),
    ("run lift --extrapolation cubic", "no extrapolation 'cubic'", "none, master and fmu"),
    ("run lift --order lift.plant,,", "missing: lift.reference", "unknown or named twice: ''"),
    ("run lift --set lift.plant.start.x_L=wide", "lift.plant.start.x_L = wide is not a number"),
    ("run lift --flavour java", "no flavour 'java'", "native and python"),
    ("run lift --controller robust", "'robust' is a set of gains, not a controller", "--gains robust"),
    ("run lift --gains pid", "no set of gains 'pid'", "damped, compensated, robust, published and compliant"),
    ("run lift --output-format xls", "no output format 'xls'", "csv and parquet"),
    ("run lift --animate", "'lift' cannot be animated", "an animation needs a machine"),
    ("build Engine", "no model 'Engine'", "EmlaPlant"),
    ("build Reference --platform amiga", "no platform 'amiga'", "linux64"),
    ("build Reference --flavour java", "no flavour 'java'"),
    ("build --flavour python --platform win64", "leave out --platform"),
]  # fmt: skip


@pytest.mark.parametrize(("command", "words"), [(command, words) for command, *words in MISTAKES])
def test_mistake_in_a_command(emla: Emla, command: str, words: list[str]) -> None:
    text = sentence(emla(*command.split()), 2)
    for word in words:
        assert word in text


@pytest.mark.parametrize(
    "options",
    [
        "--stop-time -1", "--step-size 3e-4 --stop-time 1e-3", "--output-interval 1.5e-4",
        "--coupling-tolerance 1e-6", "--realtime 0",
    ],
)  # fmt: skip
def test_mistakes_are_reported_before_anything_is_built(options: str, emla: Emla, tmp_path: Path) -> None:
    sentence(emla("run", "lift", "--fmus", "mine", *options.split()), 2)
    assert list(tmp_path.iterdir()) == []


def test_unusable_fmus_are_named(emla: Emla, fmu_folder: Path, tmp_path: Path) -> None:
    plant, reference = (fmu_folder / name / f"{name}.fmu" for name in ("EmlaPlant", "Reference"))
    Path("cut.fmu").write_bytes(plant.read_bytes()[:9999])
    Path("text.fmu").write_text("not an FMU")
    with zipfile.ZipFile("empty.fmu", "w") as archive:
        archive.writestr("readme.txt", "no model description")
    with zipfile.ZipFile(plant) as good, zipfile.ZipFile("win.fmu", "w") as archive:
        for name in good.namelist():
            archive.writestr(name.replace(host_platform(), "win32"), good.read(name))
    unreadable = {
        name: f"'{name}' is not an FMU that can be read" for name in ("cut.fmu", "text.fmu", "empty.fmu")
    }
    messages = {
        "win.fmu": f"has no binary for {host_platform()}, only for ",
        str(reference): "Reference.fmu' cannot replace lift.plant: the input F_L [N] is missing",
        "gone.fmu": "no FMU file 'gone.fmu'",
    }
    for name, words in {**unreadable, **messages}.items():
        assert words in sentence(emla("run", "lift", "--replace", f"lift.plant={name}"), 2)


def test_folders_that_cannot_be_written(emla: Emla, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    text = sentence(emla("run", "lift", "--output", "file/below"), 2)
    assert f"output folder '{Path('file/below')}' cannot be written" in text
    text = sentence(emla("build", "Reference", "--output", "file"), 2)
    assert f"the FMU '{Path('file/Reference/Reference.fmu')}' cannot be written" in text


# ---- runs that end early -----------------------------------------------------------------------------


def test_failed_run_keeps_its_results(emla: Emla, tmp_path: Path) -> None:
    """An observer gain of 1e300 overflows; the FMU reports the variable and the time."""
    options = ("--set", "lift.observer.alpha_2=1e300", "--output-interval", "1e-4", "--output", "out")
    text = sentence(emla("run", "lift", "--stop-time", "0.1", *options), 1)
    assert "the run ended at t = " in text and "lift.observer answered doStep" in text
    assert "discarded: " in text and "The results so far are in out." in text
    frame = polars.read_csv(tmp_path / "out/results.csv")
    assert len(frame) >= 1 and np.isfinite(frame.to_numpy()).all()
    record = json.loads((tmp_path / "out/run.json").read_text())
    assert record["status"].startswith("the run ended at")
    assert json.loads((tmp_path / "out/metrics.json").read_text())["run"]["steps"] == len(frame) - 1
