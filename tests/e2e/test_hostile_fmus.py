"""FMUs that attack files and processes change no file of the user and no result of another FMU."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import psutil
import pytest

import emla_cosim as ec
from fmu_verify import confinement
from fmu_verify.check import Verdict
from fmu_verify.confinement import can_confine, confine, list_confinement_gaps
from fmu_verify.examination import list_unexamined
from fmu_verify.report_files import REPORT_FILES
from fmu_verify.subprocess_run import in_fresh_process
from tests.support.broken.examining import examine
from tests.support.broken.wide import build_wide_fmu
from tests.support.clusters import family
from tests.support.waiting import wait_for

ATTACKS = (
    "step:remove_home",
    "step:write_home",
    "step:write_victim",
    "step:remove_victim",
    "step:move_victim",
    "step:truncate_victim",
    "step:link_victim",
    "load:remove_victim",
    "unload:write_victim",
    "step:kill_all",
)
needs_landlock = pytest.mark.skipif(not can_confine(), reason="This system cannot confine a process.")


@pytest.mark.slow
@needs_landlock
def test_no_file_of_the_user_is_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    home, elsewhere = tmp_path / "home", tmp_path / "elsewhere"
    for folder in (home, elsewhere):
        folder.mkdir()
        (folder / "thesis.txt").write_text("the only copy")
    monkeypatch.setenv("HOME", str(home))
    fmus = {}
    for attack in ATTACKS:
        folder = tmp_path / attack.replace(":", "-")
        folder.mkdir()
        fmus[attack] = build_wide_fmu(folder, attack, victim=elsewhere / "thesis.txt")
    fmus["good"] = build_wide_fmu(tmp_path)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    report = ec.verify(fmus, only=["run.completes", "process.files", "process.unload"])
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before
    assert report["good"].passed
    (killed,) = report["step:kill_all"].of(Verdict.FAILED)  # the first check that does a step
    assert "It ended the process of emla verify" in killed.sentence
    assert "removes files from the home folder" in report["step:remove_home"]["process.files"].sentence
    for examined in report.examined:
        assert not [line for line in examined.not_examined if line.startswith("Files outside")]


@pytest.mark.slow
@needs_landlock
def test_recording_protects_other_files_of_its_folder(tmp_path: Path) -> None:
    folder = tmp_path / "references"
    folder.mkdir()
    victim = folder / "Other_ref.csv"
    victim.write_text("time,x\n")
    report = ec.verify(
        build_wide_fmu(tmp_path, "step:write_victim", victim=victim), record=ec.Recording(folder)
    )
    assert report.passed, report.failures
    assert victim.read_text() == "time,x\n"
    assert (folder / "Wide_ref.csv").is_file()


def _confined(folder: Path, outside: Path) -> list[str]:
    """Return what a confined process could do outside of its folder."""
    confine([folder])
    (folder / "mine").write_text("allowed")
    succeeded = []
    for name, do in {
        "write": lambda: outside.write_text("x"),
        "remove": outside.unlink,
        "rename": lambda: outside.rename(folder / "stolen"),
        "empty": lambda: os.truncate(outside, 0),
        "make": lambda: (outside.parent / "new").mkdir(),
        "signal": lambda: os.kill(os.getppid(), 0),
    }.items():
        with suppress(OSError):
            do()
            succeeded.append(name)
    return succeeded


@needs_landlock
def test_confined_process_reaches_nothing_outside(tmp_path: Path) -> None:
    (folder := tmp_path / "scratch").mkdir()
    (outside := tmp_path / "other").write_text("content")
    allowed = (
        ["signal"] if any(line.startswith("Other processes") for line in list_confinement_gaps()) else []
    )
    assert in_fresh_process(_confined, folder, outside) == allowed
    assert (folder / "mine").read_text() == "allowed"
    assert outside.read_text() == "content"


def test_machine_that_cannot_confine_reports_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ran = {f.check: f for f in examine(build_wide_fmu(tmp_path), "run.completes", apart=()).findings}
    monkeypatch.setattr(confinement, "_read_version", lambda: 0)
    assert not confine([tmp_path])
    subject: Any = SimpleNamespace(folder=tmp_path, known_version=2)
    for findings in (ran, {}):
        is_reported = any(line.startswith("Files outside") for line in list_unexamined(subject, findings))
        assert is_reported == bool(findings)


@pytest.mark.skipif(sys.platform != "linux", reason="Only Linux tells who started a process.")
def test_processes_in_other_sessions_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("EMLA_MARK", str(tmp_path))
    ec.verify(build_wide_fmu(tmp_path, "step:orphan"), only=["run.completes"])
    marked = []
    for process in psutil.process_iter():
        with suppress(psutil.Error):
            if process.pid != os.getpid() and process.environ().get("EMLA_MARK") == str(tmp_path):
                marked.append(process)
    assert not marked


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP], ids=lambda n: n.name)
def test_interruption_keeps_finished_findings(tmp_path: Path, number: signal.Signals) -> None:
    """The second FMU never returns from a step; the first one is done by then."""
    finished = build_wide_fmu(tmp_path, name="Done")
    hanging = build_wide_fmu(tmp_path, "step:hang", name="Hanging")
    files = {kind: tmp_path / f"report.{kind}" for kind in REPORT_FILES}
    command = [sys.executable, "-m", "emla_cosim", "verify", str(finished), str(hanging), "--seconds", "99"]
    command += ["--only", "run.completes", *(f"--{kind}={f}" for kind, f in files.items())]
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env={**os.environ, "TMPDIR": str(tmp_path)},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    assert process.stdout is not None
    _wait_until_it_hangs(process, tmp_path)
    everyone = family(process)
    process.send_signal(number)
    message, _ = process.communicate(timeout=60)
    assert process.returncode == 1, message
    assert not psutil.wait_procs(everyone, timeout=60.0)[1], "a process survives"
    assert not list(tmp_path.glob("emla-*")), "temporary files are left"
    assert b"interrupted before all checks were done" in message
    report = json.loads(files["json"].read_text())
    assert (report["complete"], report["passed"]) == (False, False)
    first, second = report["examined"]
    assert first["passed"] and [f["verdict"] for f in first["findings"]] == ["passed"]
    assert "interrupted" in second["objections"][0]
    assert "interrupted" in files["junit"].read_text()
    assert "Interrupted: " in files["html"].read_text()
    assert "incomplete" in files["badge"].read_text()
    (run,) = json.loads(files["sarif"].read_text())["runs"]
    assert not run["invocations"][0]["executionSuccessful"]


def _wait_until_it_hangs(process: subprocess.Popen[bytes], folder: Path) -> None:
    """Wait until the first FMU was unpacked and removed again, and the second one is unpacked."""
    unpacked: set[str] = set()

    def is_at_the_second() -> bool:
        assert process.poll() is None
        present = {path.stem for path in folder.glob("emla-*/emla-verify-*/emla-verify-*/fmu/binaries/*/*")}
        unpacked.update(present)
        return "Done" in unpacked and present == {"Hanging"}

    wait_for(is_at_the_second, 90.0)
    time.sleep(0.5)
