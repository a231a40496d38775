"""The `emla` command: what it leaves behind, and one clear sentence for whatever is wrong."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest
from typer.testing import CliRunner

from emla_cosim.cli.app import app
from emla_cosim.fmu.models import PLATFORMS
from emla_cosim.run.scenarios.built_in import SCENARIOS
from emla_cosim.study.figures import JOINT_FIGURES
from tests.support.commands import Emla, sentence
from tests.support.whole_files import names

PICTURES = {f"{name}.png" for name in JOINT_FIGURES}
ORDER = "lift.plant,lift.observer,lift.controller,lift.reference,lift.disturbance"


@pytest.mark.drawn
def test_run_leaves_data_metrics_record_and_pictures(emla: Emla, tmp_path: Path) -> None:
    result = emla("run", "lift", "--stop-time", "0.4", "--set", "lift.plant.motor.R_s=0.2")
    assert result.exit_code == 0, result.output
    assert "position error" in result.stdout and "lift" in result.stdout
    folder = tmp_path / "results" / "lift"
    assert names(folder) == {"results.csv", "metrics.json", "run.json", *PICTURES}
    frame = polars.read_csv(folder / "results.csv")
    assert frame.columns[0] == "time"
    assert "lift.plant.x_L" in frame.columns
    assert frame["time"].to_numpy() == pytest.approx(np.arange(401) * 1e-3)
    metrics = json.loads((folder / "metrics.json").read_text())
    assert set(metrics) == {"joints", "signals", "coupling", "run"}
    assert set(metrics["joints"]["lift"]) == {
        "held", "reason", "trip", "limits_touched", "excursions", "oscillation",
        "settling_time_s", "evaluated_from_s", "convergence_time_s",
        "position_error_m", "following_error_m", "following_error_rms_m",
        "standstill_error_m", "standstill_error_rms_m",
        "velocity_error_m_s", "torque_effort_N_m", "torque_peak_N_m",
        "observer_position_error_m", "saturated_fraction", "saturated_after_settling",
    }  # fmt: skip
    assert metrics["run"]["steps"] == 4000
    record = json.loads((folder / "run.json").read_text())
    assert record["status"] == "completed"
    assert record["settings"]["step_size_s"] == 1e-4
    assert record["settings"]["output_interval_s"] == pytest.approx(1e-3, rel=1e-12)
    assert record["components"]["lift.plant"]["parameters"]["motor.R_s"] == "0.2"
    assert len(record["components"]["lift.plant"]["sha256"]) == 64
    assert all((folder / name).read_bytes().startswith(b"\x89PNG") for name in PICTURES)


def test_a_run_too_short_to_judge_says_so(emla: Emla) -> None:
    short = emla("run", "lift", "--stop-time", "0.3", "--no-plots").stdout
    assert short.startswith("Too short to judge: that takes more than 0.3 s.\n")
    assert "held   " not in short and "not settled" not in short
    longer = emla("run", "lift", "--stop-time", "0.31", "--no-plots").stdout
    assert "Too short" not in longer and longer.startswith("lift, 0.31 s simulated")


def test_a_run_can_be_repeated_to_the_last_bit(emla: Emla, tmp_path: Path) -> None:
    for name in ("a", "b"):
        assert emla("run", "tilt", "--stop-time", "0.05", "--no-plots", "--output", name).exit_code == 0
    assert (tmp_path / "a/results.csv").read_bytes() == (tmp_path / "b/results.csv").read_bytes()


def test_both_flavours_give_the_same_rows(emla: Emla, python_fmu_folder: Path, tmp_path: Path) -> None:
    for flavour in ("native", "python"):
        options = ("--stop-time", "0.02", "--no-plots", "--output", flavour, "--flavour", flavour)
        result = emla("run", "study", *options)
        assert result.exit_code == 0, result.output
    assert (tmp_path / "native/results.csv").read_bytes() == (tmp_path / "python/results.csv").read_bytes()


def test_an_earlier_run_leaves_nothing_behind(emla: Emla, tmp_path: Path) -> None:
    assert emla("run", "lift", "--stop-time", "0.01", "--output", "out").exit_code == 0
    (tmp_path / "out" / "mine.txt").write_text("keep")
    assert emla("run", "lift", "--stop-time", "0.01", "--no-plots", "--output", "out").exit_code == 0
    assert names(tmp_path / "out") == {
        "results.csv", "metrics.json", "run.json", "mine.txt",
    }  # fmt: skip


def test_a_wrong_command_leaves_an_earlier_run_alone(emla: Emla, tmp_path: Path) -> None:
    assert emla("run", "lift", "--stop-time", "0.01", "--no-plots", "--output", "out").exit_code == 0
    before = {p.name: p.read_bytes() for p in (tmp_path / "out").iterdir()}
    sentence(emla("run", "lift", "--set", "lift.plant.x=1", "--output", "out"), 2)
    assert {p.name: p.read_bytes() for p in (tmp_path / "out").iterdir()} == before


def test_settings_reach_the_run(emla: Emla, tmp_path: Path) -> None:
    options = [
        "--algorithm",
        "jacobi",
        "--step-size",
        "2e-5",
        "--stop-time",
        "0.01",
        "--output-interval",
        "2e-3",
    ]
    result = emla("run", "lift", *options, "--gains", "robust", "--no-plots", "--output", "out")
    assert result.exit_code == 0, result.output
    settings = json.loads((tmp_path / "out/run.json").read_text())["settings"]
    assert (settings["algorithm"], settings["step_size_s"], settings["output_interval_s"]) == (
        "jacobi",
        2e-5,
        2e-3,
    )
    assert len(polars.read_csv(tmp_path / "out/results.csv")) == 6


def stepping(folder: Path) -> Any:
    """The part of run.json that says how the steps were made."""
    return json.loads((folder / "run.json").read_text())["stepping"]


def test_the_record_names_the_order_and_what_was_late(emla: Emla, tmp_path: Path) -> None:
    for options in ((), ("--order", ORDER)):
        assert emla("run", "lift", "--stop-time", "0.001", "--no-plots", *options).exit_code == 0
        record = stepping(tmp_path / "results/lift")
        place = {name: i for i, name in enumerate(record["order"])}
        connections = json.loads((tmp_path / "results/lift/run.json").read_text())["connections"]
        ends = {x: [_component(end, place) for end in x.split(" -> ")] for x in connections}
        assert record["late_connections"] == [x for x, (a, b) in ends.items() if place[a] >= place[b]]
        assert 0 < len(record["late_connections"]) < len(connections)
    assert ",".join(record["order"]) == ORDER
    assert "lift.reference.x_d -> lift.controller.x_d" in record["late_connections"]


def _component(variable: str, components: Iterable[str]) -> str:
    """Names of variables may have dots as well."""
    (name,) = (c for c in components if variable.startswith(f"{c}."))
    return name


def test_the_record_of_other_algorithms(emla: Emla, tmp_path: Path) -> None:
    for algorithm in ("jacobi", "strong"):
        options = ("--algorithm", algorithm, "--stop-time", "0.001", "--no-plots", "--output", algorithm)
        assert emla("run", "lift", *options).exit_code == 0
    jacobi, strong = stepping(tmp_path / "jacobi"), stepping(tmp_path / "strong")
    connections = json.loads((tmp_path / "jacobi/run.json").read_text())["connections"]
    assert jacobi["late_connections"] == connections and jacobi["compiled"]
    assert strong["late_connections"] == [] and strong["compiled"]
    assert [sorted(loop) for loop in strong["loops"]] == [
        ["lift.controller", "lift.disturbance", "lift.observer", "lift.plant"]
    ]
    assert strong["sweeps_over_loops"] >= strong["steps"] == 10


def test_booleans_are_set_by_name(emla: Emla, tmp_path: Path) -> None:
    settings = ["lift.plant.use_commanded_current=true", "lift.controller.limit_current=false"]
    options = [x for s in settings for x in ("--set", s)]
    result = emla("run", "lift", "--stop-time", "0.001", "--no-plots", *options)
    assert result.exit_code == 0, result.output


def test_a_component_can_be_replaced_by_another_fmu(
    emla: Emla, python_fmu_folder: Path, tmp_path: Path
) -> None:
    other = python_fmu_folder / "EmlaPlant" / "python" / "EmlaPlant.fmu"
    options = ("--stop-time", "0.01", "--no-plots")
    assert emla("run", "lift", *options, "--output", "ours").exit_code == 0
    result = emla("run", "lift", *options, "--output", "other", "--replace", f"lift.plant={other}")
    assert result.exit_code == 0, result.output
    assert (tmp_path / "ours/results.csv").read_bytes() == (tmp_path / "other/results.csv").read_bytes()
    record = json.loads((tmp_path / "other/run.json").read_text())
    assert record["components"]["lift.plant"]["fmu"] == str(other)


def test_list_names_everything(emla: Emla) -> None:
    result = emla("list")
    assert result.exit_code == 0
    for name in (*SCENARIOS, "EmlaPlant", "RsbaController", "native", "gauss-seidel"):
        assert name in result.stdout


def test_build_writes_the_fmus_asked_for(emla: Emla, tmp_path: Path) -> None:
    result = emla("build", "Reference", "--output", "out")
    assert result.exit_code == 0, result.output
    assert [p.relative_to(tmp_path) for p in tmp_path.rglob("*.fmu")] == [Path("out/Reference/Reference.fmu")]
    assert "Reference.fmu" in result.stdout


def test_build_makes_binaries_for_every_platform_unless_told_otherwise(emla: Emla, tmp_path: Path) -> None:
    for options, expected in (([], set(PLATFORMS)), (["--platform", "win64"], {"win64"})):
        result = emla("build", "Reference", "--output", f"out{len(options)}", *options)
        assert result.exit_code == 0, result.output
        with zipfile.ZipFile(tmp_path / f"out{len(options)}/Reference/Reference.fmu") as archive:
            assert {n.split("/")[1] for n in archive.namelist() if n.startswith("binaries/")} == expected


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["run", "nosuch"], ["no scenario 'nosuch'", "study", "lift"]),
        (
            ["run", "lift", "--algorithm", "euler"],
            ["no algorithm 'euler'", "jacobi, gauss-seidel and strong"],
        ),
        (
            ["run", "lift", "--extrapolation", "cubic"],
            ["no extrapolation 'cubic'", "none, master and fmu"],
        ),
        (["run", "lift", "--coupling-tolerance", "0"], ["coupling tolerance 0 must be between 0 and 1"]),
        (["run", "lift", "--coupling-tolerance", "nan"], ["coupling tolerance nan must be"]),
        (["run", "lift", "--error-tolerance", "0"], ["error tolerance 0 must be between 0 and 1"]),
        (["run", "lift", "--error-tolerance", "1.5"], ["error tolerance 1.5 must be between 0 and 1"]),
        (["run", "lift", "--realtime", "0"], ["real-time factor 0 must be a positive number"]),
        (
            ["run", "lift", "--order", "lift.pump"],
            ["missing: lift.reference", "unknown or named twice: lift.pump"],
        ),
        (
            ["run", "lift", "--order", "lift.plant,,"],
            ["missing: lift.reference", "unknown or named twice: ''"],
        ),
        (["run", "lift", "--order", f"{ORDER},lift.plant"], ["once (unknown or named twice: lift.plant)."]),
        (["run", "lift", "--order", ORDER.removeprefix("lift.plant,")], ["once (missing: lift.plant)."]),
        (["run", "lift", "--step-multiple", "lift.pump=2"], ["no component 'lift.pump'"]),
        (["run", "lift", "--step-multiple", "lift.plant=0"], ["step multiple 0 of lift.plant", "at least 1"]),
        (["run", "lift", "--step-multiple", "lift.plant=-2"], ["multiple -2 of lift.plant", "at least 1"]),
        (
            ["run", "lift", "--step-multiple", "lift.plant=2.5"],
            ["--step-multiple lift.plant=2.5 is not a whole number."],
        ),
        (["run", "lift", "--step-multiple", "lift.plant"], ["--step-multiple lift.plant", "NAME=VALUE"]),
        (
            ["run", "lift", "--step-multiple", "lift.pump=2", "--algorithm", "strong"],
            ["no component 'lift.pump'"],
        ),
        (
            ["run", "lift", "--step-multiple", "lift.plant=2", "--error-tolerance", "0.1"],
            ["step multiples need fixed steps"],
        ),
        (["run", "lift", "--flavour", "java"], ["no flavour 'java'", "native and python"]),
        (
            ["run", "lift", "--controller", "pid"],
            ["no controller 'pid'", "rsba, foc, cac and anatc, or write"],
        ),
        (
            ["run", "lift", "--controller", "robust"],
            ["'robust' is a set of gains, not a controller", "--gains robust"],
        ),
        (
            ["run", "lift", "--gains", "pid"],
            ["no set of gains 'pid'", "damped, compensated, robust, published and compliant"],
        ),
        (
            ["run", "lift", "--coupling-tolerance", "1e-6"],
            ["the algorithm gauss-seidel has no coupling tolerance; strong has."],
        ),
        (["run", "lift", "--output-format", "xls"], ["no output format 'xls'", "csv and parquet"]),
        (["run", "lift", "--set", "arm.plant.start.x_L=1"], ["no component 'arm.plant'", "lift.plant"]),
        (["run", "lift", "--set", "lift.motor.x=1"], ["no component 'lift.motor'", "lift.plant"]),
        (["run", "lift", "--set", "lift.plant.R_s=1"], ["lift.plant has no variable 'R_s'", "motor.R_s"]),
        (
            ["run", "lift", "--set", "lift.plant=1"],
            ["'lift.plant' is not a variable", "write it as lift.reference.VARIABLE"],
        ),
        (["run", "lift", "--set", "lift.plant.start.x_L"], ["--set lift.plant.start.x_L", "NAME=VALUE"]),
        (
            ["run", "lift", "--set", "lift.plant.start.x_L=wide"],
            ["lift.plant.start.x_L = wide is not a number"],
        ),
        (["run", "lift", "--set", "lift.plant.start.x_L=nan"], ["lift.plant.start.x_L = nan m", "finite"]),
        (["run", "lift", "--set", "lift.plant.motor.N_p=2.5"], ["motor.N_p = 2.5 is not a whole number"]),
        (["run", "lift", "--set", "lift.plant.motor.R_s=-1"], ["motor.R_s = -1 Ohm", "at least 0 Ohm"]),
        (["run", "lift", "--set", "lift.plant.gearbox.eta_GB=2"], ["eta_GB = 2", "at most 1"]),
        (["run", "lift", "--set", "lift.plant.tau_m=1"], ["lift.plant.tau_m is computed"]),
        (["run", "lift", "--set", "lift.plant.x_L=1"], ["plant.x_L is computed", "did you mean start.x_L?"]),
        (
            ["run", "lift", "--set", "lift.plant.u_q=1"],
            ["lift.plant.u_q cannot be set", "lift.controller.u_q"],
        ),
        (
            ["run", "lift", "--set", "lift.plant.sensor.seed=99999999999"],
            ["sensor.seed", "at most 2147483646"],
        ),
        (["run", "lift", "--set", "lift.observer.use_model=maybe"], ["= maybe is not a Boolean"]),
        (["run", "lift", "--stop-time", "0"], ["stop time 0 s"]),
        (["run", "lift", "--stop-time", "-1"], ["stop time -1 s"]),
        (["run", "lift", "--step-size", "0"], ["step size 0 s", "positive"]),
        (["run", "lift", "--step-size", "nan"], ["step size nan s", "positive"]),
        (
            ["run", "lift", "--step-size", "3e-4", "--stop-time", "1e-3"],
            ["not a whole number of steps", "0.0009 s"],
        ),
        (
            ["run", "lift", "--output-interval", "1.5e-4"],
            ["output interval 0.00015 s", "whole number of steps"],
        ),
        (["run", "lift", "--output-interval", "-1"], ["output interval -1 s", "positive"]),
        (["run", "lift", "--replace", "lift.plant=gone.fmu"], ["no FMU file 'gone.fmu'"]),
        (["run", "lift", "--replace", "lift.pump=gone.fmu"], ["no component 'lift.pump'"]),
        (["run", "lift", "--replace", "lift.plant"], ["--replace lift.plant", "NAME=VALUE"]),
        (["run", "lift", "--animate"], ["'lift' cannot be animated", "an animation needs a manipulator"]),
        (["build", "Engine"], ["no model 'Engine'", "EmlaPlant"]),
        (["build", "Reference", "--platform", "amiga"], ["no platform 'amiga'", "linux64"]),
        (["build", "Reference", "--flavour", "java"], ["no flavour 'java'"]),
        (["build", "--flavour", "python", "--platform", "win64"], ["leave out --platform"]),
    ],
    ids=lambda x: " ".join(x[1:]) if x and x[0] in ("run", "build") else "",
)
def test_a_wrong_command_gets_one_sentence(emla: Emla, arguments: list[str], words: list[str]) -> None:
    text = sentence(emla(*arguments), 2)
    for word in words:
        assert word in text


@pytest.mark.parametrize(
    "wrong",
    [
        ["--stop-time", "-1"],
        ["--step-size", "3e-4", "--stop-time", "1e-3"],
        ["--output-interval", "1.5e-4"],
        ["--coupling-tolerance", "1e-6"],
        ["--realtime", "0"],
    ],
    ids=" ".join,
)
def test_what_is_wrong_with_any_system_is_told_before_anything_is_built(
    wrong: list[str], emla: Emla, tmp_path: Path
) -> None:
    sentence(emla("run", "lift", "--fmus", "mine", *wrong), 2)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "arguments", [["run", "lift", "--stop-time", "soon"], ["run"], ["fly"], ["run", "lift", "--fast"]]
)
def test_what_the_option_parser_refuses_exits_with_2_too(emla: Emla, arguments: list[str]) -> None:
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2
    assert "Traceback" not in result.output


def test_a_corrupt_fmu_is_named(emla: Emla, fmu_folder: Path, tmp_path: Path) -> None:
    good = (fmu_folder / "EmlaPlant" / "EmlaPlant.fmu").read_bytes()
    (tmp_path / "cut.fmu").write_bytes(good[: len(good) // 2])
    (tmp_path / "text.fmu").write_text("not an FMU")
    with zipfile.ZipFile(tmp_path / "empty.fmu", "w") as archive:
        archive.writestr("readme.txt", "no model description")
    for name in ("cut.fmu", "text.fmu", "empty.fmu"):
        text = sentence(emla("run", "lift", "--replace", f"lift.plant={name}"), 2)
        assert f"'{name}' is not an FMU that can be read" in text


def test_an_fmu_that_does_not_fit_is_explained(emla: Emla, fmu_folder: Path) -> None:
    other = fmu_folder / "Reference" / "Reference.fmu"
    text = sentence(emla("run", "lift", "--replace", f"lift.plant={other}"), 2)
    assert "Reference.fmu' cannot replace lift.plant: the input F_L [N] is missing" in text


def test_an_fmu_without_a_binary_for_this_machine_is_explained(
    emla: Emla, fmu_folder: Path, tmp_path: Path
) -> None:
    original, other = fmu_folder / "EmlaPlant" / "EmlaPlant.fmu", tmp_path / "win.fmu"
    with zipfile.ZipFile(original) as good, zipfile.ZipFile(other, "w") as archive:
        for name in good.namelist():
            archive.writestr(name.replace("linux64", "win32"), good.read(name))
    text = sentence(emla("run", "lift", "--replace", "lift.plant=win.fmu"), 2)
    assert "has no binary for linux64, only for win32" in text


def test_an_output_folder_that_cannot_be_written(emla: Emla, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    text = sentence(emla("run", "lift", "--output", "file/below"), 2)
    assert "output folder 'file/below' cannot be written" in text


def test_a_folder_for_fmus_that_cannot_be_written(emla: Emla, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    text = sentence(emla("build", "Reference", "--output", "file"), 2)
    assert "the FMU 'file/Reference/Reference.fmu' cannot be written" in text


def test_a_run_that_fails_keeps_what_was_computed(emla: Emla, tmp_path: Path) -> None:
    """A position of 1e308 m overflows soon; the plant says which variable and when."""
    options = ("--set", "lift.observer.alpha_2=1e300", "--output-interval", "1e-4", "--output", "out")
    text = sentence(emla("run", "lift", "--stop-time", "0.1", *options), 1)
    assert "the run ended at t = " in text and "lift.observer answered doStep" in text
    assert "discarded: " in text and "The results so far are in out." in text
    frame = polars.read_csv(tmp_path / "out/results.csv")
    assert len(frame) >= 1 and np.isfinite(frame.to_numpy()).all()
    record = json.loads((tmp_path / "out/run.json").read_text())
    assert record["status"].startswith("the run ended at")
    assert json.loads((tmp_path / "out/metrics.json").read_text())["run"]["steps"] == len(frame) - 1


def _start(arguments: list[str], folder: Path, limit: int | None = None) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "emla_cosim", *arguments]
    if limit is not None:
        command = ["prlimit", f"--fsize={limit}", *command]
    return subprocess.Popen(
        command, cwd=folder, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=os.environ
    )


def test_ctrl_c_keeps_what_was_computed(fmu_folder: Path, tmp_path: Path) -> None:
    arguments = ["run", "lift", "--stop-time", "1000", "--fmus", str(fmu_folder), "--output", "out"]
    process = _start(arguments, tmp_path)
    results = tmp_path / "out" / "results.csv"
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and (not results.exists() or results.stat().st_size < 100_000):
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 1, errors
    assert "interrupted at t = " in errors and "Traceback" not in errors
    frame = polars.read_csv(results)
    assert np.isfinite(frame.to_numpy()).all()
    metrics = json.loads((tmp_path / "out/metrics.json").read_text())
    # the row of the last step is there, decimation notwithstanding
    assert frame["time"][-1] == pytest.approx(metrics["run"]["steps"] * 1e-4)
    assert json.loads((tmp_path / "out/run.json").read_text())["status"].startswith("interrupted")


@pytest.mark.skipif(
    shutil.which("prlimit") is None,
    reason="There is no `prlimit`, which limits the size of files, on this machine.",
)
def test_a_full_disk_ends_the_run_with_a_sentence(fmu_folder: Path, tmp_path: Path) -> None:
    """A limit of 200 kB per file stands in for the full disk."""
    arguments = ["run", "lift", "--stop-time", "2", "--fmus", str(fmu_folder), "--output", "out"]
    process = _start(arguments, tmp_path, limit=200_000)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 1, errors
    assert "Traceback" not in errors
    assert "results.csv cannot be written: File too large" in errors
    size = (tmp_path / "out/results.csv").stat().st_size
    assert 100_000 < size <= 200_000
    assert json.loads((tmp_path / "out/metrics.json").read_text())["run"]["steps"] > 0
