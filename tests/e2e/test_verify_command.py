"""`emla verify` and `ec.verify`: arguments, output and exit codes."""

import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import fmpy
import psutil
import pytest
from fmpy import read_model_description

import emla_cosim as ec
from emla_cosim.base.errors import CommandError
from emla_cosim.cli.commands import verify as commands_verify
from emla_cosim.fmu.models import FLAVOURS, MODELS, build, fmu_path
from fmu_verify.catalogue import CHECKS, DYNAMIC
from fmu_verify.check import Verdict
from fmu_verify.examination import select_checks
from fmu_verify.settings import Settings
from fmublock import Block
from tests.support.broken.dynamic import build_good_fmu
from tests.support.broken.editing import setting, with_files
from tests.support.broken.static import LIBRARY
from tests.support.commands import Emla, sentence


@pytest.fixture
def plant(fmu_folder: Path) -> str:
    return str(fmu_folder / "EmlaPlant" / "EmlaPlant.fmu")


@pytest.mark.slow
def test_exit_codes_of_good_and_bad_fmus(plant: str, tmp_path: Path, emla: Emla) -> None:
    assert emla("verify", plant, "--only", "run").exit_code == 0
    bad = tmp_path / "bad.fmu"
    bad.write_bytes(b"PK no zip")
    result = emla("verify", plant, str(bad), "--only", "archive.safe")
    assert sentence(result, 1) == "Error: 1 check failed."
    assert "bad.fmu: failed archive.safe" in result.stdout
    assert "FMI 2.0.4, " in result.stdout


def test_groups_and_patterns_select_checks() -> None:
    groups = {c.group for c in CHECKS}
    for group in groups:
        assert {c.group for c in select_checks(Settings(only=[group]))} == {group}
        assert {c.group for c in select_checks(Settings(skip=[group]))} == groups - {group}
    assert {c.name for c in select_checks(Settings(only=["*.safe"]))} == {"archive.safe"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "there is nothing to verify; name at least one FMU."),
        (["nowhere.fmu"], "the FMU file 'nowhere.fmu' does not exist."),
        (["."], "the folder '.' has no FMU and no SSP."),
        (["x" * 300 + ".fmu"], "does not exist"),
        (["PLANT", "--only", "run.complete"], "did you mean run.completes"),
        (["PLANT", "--skip", "zzz"], "there is no check 'zzz'; `emla verify --list` lists all checks."),
        (["PLANT", "--only", "run", "--skip", "run.*"], "`only` and `skip` select no check."),
        (["PLANT", "--seconds", "0"], "'seconds' is 0; it must be greater than 0 and less than 1e9."),
        (["PLANT", "--memory", "nan"], "'memory' is nan; it must be greater than 0 and less than 1e9."),
        (["PLANT", "--tolerance", "a"], "--tolerance a cannot be read"),
        (["PLANT", "--reference", "nowhere"], "the folder of references 'nowhere' does not exist."),
    ],
)
def test_invalid_arguments(arguments: list[str], message: str, plant: str, emla: Emla) -> None:
    words = [plant if a == "PLANT" else a for a in arguments]
    assert message in sentence(emla("verify", *words), 2)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"paths": [3]}, "must be"),
        ({"only": "q"}, "there is no check 'q'"),
        ({"only": [3]}, "only"),
        ({"seconds": -1}, "'seconds' is -1"),
        ({"tolerance": -1.0}, "tolerance"),
        ({"tolerance": "x"}, "tolerance"),
        ({"only": "archive", "must_run": "run"}, "'run' must run, but"),
        ({"fail_on": "x"}, "there is no value of fail-on 'x'"),
    ],
)
def test_invalid_arguments_of_the_function(wrong: dict[str, Any], message: str, plant: str) -> None:
    with pytest.raises(CommandError, match=message):
        ec.verify(**{"paths": plant, **wrong})


def test_report_has_selected_checks_of_fmus_by_path_name_and_label(plant: str) -> None:
    """Checks that a selected one needs run, but are not reported."""
    report = ec.verify({"mine": plant}, only="run.finite")
    (examined,) = report.examined
    assert report["mine"] is report[plant] is report["EmlaPlant.fmu"] is examined
    with pytest.raises(KeyError):
        report["other"]
    assert [finding.check for finding in examined.findings] == ["run.finite"]
    assert report.counts == {Verdict.PASSED: 1}
    assert examined.facts["SHA-256"] == hashlib.sha256(Path(plant).read_bytes()).hexdigest()


def test_folders_of_fmus_and_git_lfs_pointers(plant: str, tmp_path: Path) -> None:
    folder = tmp_path / "many"
    (folder / "deep").mkdir(parents=True)
    (folder / "deep" / "Plant.fmu").write_bytes(Path(plant).read_bytes())
    (folder / "Stored.fmu").write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n")
    report = ec.verify(folder, only="archive.safe")
    assert [examined.label for examined in report.examined] == [
        f"{folder}/Stored.fmu",
        f"{folder}/deep/Plant.fmu",
    ]
    assert report["Stored.fmu"]["archive.safe"].sentence == "The file is a pointer of Git LFS, not the FMU."
    assert report["Plant.fmu"].passed


def test_list_has_all_checks(emla: Emla) -> None:
    output = emla("verify", "--list").stdout
    assert all(c.name in output for c in CHECKS)


@pytest.mark.slow
def test_options_decide_what_fails(tmp_path: Path, emla: Emla) -> None:
    setting("//DefaultExperiment", stepSize="0")(tmp_path)
    warns = ("verify", "Toy.fmu", "--only", "description.experiment")
    assert emla(*warns).exit_code == 0
    assert emla(*warns, "--fail-on", "warning").exit_code == 1
    result = emla("verify", "Toy.fmu", "--only", "archive", "--only", "reference", "--must-run", "reference")
    assert result.exit_code == 1
    assert "--must-run reference: reference.agrees was skipped." in result.stdout


@pytest.mark.slow
def test_all_reports_name_an_fmu_that_cannot_run(tmp_path: Path, emla: Emla) -> None:
    other_platform = LIBRARY.replace(fmpy.platform, "lin64")
    with_files(lambda files: files.update({other_platform: files.pop(LIBRARY)}))(tmp_path)
    result = emla("verify", "Toy.fmu", "--json", "r.json", "--junit", "r.xml", "--html", "r.html")
    assert "1 FMU did not pass for other reasons." in sentence(result, 1)
    assert (
        f"could not run. binaries.loads: It has no binary for {fmpy.platform}, only for lin64"
        in result.stdout
    )
    report = json.loads((tmp_path / "r.json").read_text())
    assert not report["passed"]
    assert any("It has no binary for" in gap for gap in report["examined"][0]["not_examined"])
    assert int(ElementTree.parse(tmp_path / "r.xml").getroot().get("failures", "0")) >= 1
    page = (tmp_path / "r.html").read_text()
    assert "Not examined" in page and "Not passed" in page


CALLING = ("run.deterministic", *(sorted({c.group for c in DYNAMIC} - {"run"})))
"""Groups of checks that call an FMU in many ways: they take most of the time."""

OF_FMI_2 = {c.name: c.name in CALLING or c.group in CALLING for c in CHECKS if c.only_for != 3}
"""Whether a check of FMI 2.0 calls, by its name."""

FEW = {"EmlaPlant": MODELS["EmlaPlant"], "SignalFault": MODELS["SignalFault"]}
"""With continuous states, and without."""


@pytest.mark.parametrize(
    "models",
    [pytest.param(FEW, marks=pytest.mark.slow), pytest.param(MODELS, marks=pytest.mark.nightly)],
    ids=["few models", "all models"],
)
def test_our_fmus_pass_checks_of_files_and_runs(
    models: dict[str, type[Block]],
    emla: Emla,
    tmp_path: Path,
    python_fmu_folder: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """In both flavours, each output against its reference."""
    monkeypatch.setattr(commands_verify, "MODELS", models)
    monkeypatch.setattr(commands_verify, "build", lambda *of: build(*of, folder=python_fmu_folder))
    skipped = [word for name in CALLING for word in ("--skip", name)]
    result = emla("verify", "--all", "--json", "report.json", *skipped)
    assert result.exit_code == 0, result.output
    report = json.loads((tmp_path / "report.json").read_text())
    assert {examined["name"] for examined in report["examined"]} == {
        f"{m} ({f})" for m in models for f in FLAVOURS
    }
    for examined in report["examined"]:
        agrees = next(f for f in examined["findings"] if f["check"] == "reference.agrees")
        assert agrees["verdict"] == "passed", examined["name"]
        block = MODELS[examined["name"].split()[0]]
        described = read_model_description(str(build(block.__name__, "native", [], python_fmu_folder)))
        outputs = {v.name for v in described.modelVariables if v.causality == "output"}
        assert {c["signal"] for c in agrees["comparisons"]} == outputs
        assert {f["check"] for f in examined["findings"]} == {n for n, calls in OF_FMI_2.items() if not calls}


SLOW = [*((m, "native") for m in ("EmlaPlant", "FocController", "HdrmPlant")), ("SignalFault", "python")]


@pytest.mark.parametrize(
    ("model", "flavour"),
    [
        *(pytest.param(*pair, marks=pytest.mark.slow) for pair in SLOW),
        *(pytest.param(m, "native", marks=pytest.mark.nightly) for m in MODELS if (m, "native") not in SLOW),
    ],
)
def test_our_fmus_pass_dynamic_checks(model: str, flavour: str, python_fmu_folder: Path) -> None:
    """Of PythonFMU FMUs few: the code that answers is the same in all; bits agree with the native ones."""
    (examined,) = ec.verify(fmu_path(model, flavour, python_fmu_folder), only=CALLING).examined
    failures = {f.check for f in examined.of(Verdict.FAILED)}
    # PythonFMU's libraries leave the pointer to a freed state; the equations are not at fault
    assert failures == ({"state.freed"} if flavour == "python" else set())
    assert {f.check for f in examined.findings} == {name for name, calls in OF_FMI_2.items() if calls}


@pytest.mark.slow
def test_fmu_in_a_folder_with_an_odd_name_leaves_no_temporary_files(
    plant: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    strange, temporary = tmp_path / "ä b&c <i>", tmp_path / "temporary"
    for folder in (strange, temporary):
        folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(temporary))
    assert ec.verify(shutil.copy(plant, strange / "EmlaPlant.fmu"), only="run").passed
    assert list(temporary.iterdir()) == []


def test_reports_replace_no_other_file(plant: str, tmp_path: Path, emla: Emla) -> None:
    fmu = Path(shutil.copy(plant, tmp_path / "x.fmu"))
    before = fmu.read_bytes()
    (tmp_path / "link.json").symlink_to(fmu)
    for arguments, message in (
        (("--json", "x.fmu"), "the JSON report 'x.fmu' is also the file to verify. Choose another file."),
        (("--html", "link.json"), "the HTML report 'link.json' cannot be written: it is a symbolic link"),
        (("--json", "gone/r"), "the JSON report 'gone/r' cannot be written: there is no folder 'gone'."),
        (("--json", "."), "the JSON report '.' cannot be written"),
        (("--json", "/dev/null/x"), "cannot be written"),
    ):
        assert message in sentence(emla("verify", "x.fmu", "--only", "archive", *arguments), 2)
    assert fmu.read_bytes() == before
    assert sorted(p.name for p in tmp_path.iterdir()) == ["link.json", "x.fmu"]


def test_names_with_escape_sequences(tmp_path: Path, emla: Emla) -> None:
    """Neither markup nor escape sequences in names have an effect."""
    (path := tmp_path / "[red]\x1b[2J.fmu").write_bytes(b"PK no zip")
    output = emla("verify", str(path)).stdout
    assert "\x1b[2J" not in output
    assert r"[red]\x1b[2J.fmu" in output


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL], ids=lambda n: n.name)
def test_end_of_the_program_ends_an_fmu_that_hangs(number: signal.Signals, tmp_path: Path) -> None:
    """It is in a call that never returns. Ctrl-C leaves no temporary files."""
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    script = (
        "import signal\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)  # who began this may ignore it\n"
        "import emla_cosim as ec\n"
        f"ec.verify({str(build_good_fmu(tmp_path, 'HANG'))!r}, only='run', seconds=99)"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", script],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "TMPDIR": str(temporary)},
    )

    everyone = list[psutil.Process]()
    while not _has_worked(everyone):
        assert process.poll() is None
        time.sleep(0.1)
        everyone = psutil.Process(process.pid).children(recursive=True)
    process.send_signal(number)
    _, errors = process.communicate(timeout=30)
    assert not psutil.wait_procs(everyone, timeout=20.0)[1]
    assert process.returncode != 0
    if number == signal.SIGINT:
        assert errors.strip().endswith("KeyboardInterrupt")
        assert list(temporary.iterdir()) == []


def _has_worked(processes: list[psutil.Process]) -> bool:
    """Whether one of them has used a second of its core: it hangs."""
    with suppress(psutil.NoSuchProcess):
        return any(p.cpu_times().user > 1.0 and p.ppid() in {q.pid for q in processes} for p in processes)
    return False
