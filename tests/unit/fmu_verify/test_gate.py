"""Reports that do not pass although no check failed, and findings that outlive their examiner."""

import struct
import sys
from pathlib import Path

import fmpy
import lief
import pytest

import emla_cosim as ec
from emla_cosim.fmu.models import build
from fmu_verify.check import Verdict
from fmu_verify.libraries import list_exports
from fmu_verify.settings import Settings
from tests.support.broken.dynamic import build_good_fmu
from tests.support.broken.editing import Build, Files, good_bytes, setting, with_files, with_text
from tests.support.broken.examining import examine
from tests.support.broken.static import LIBRARY
from tests.support.broken.wide import build_wide_fmu
from tests.support.tiers import mostly_slow

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no signals that end a process.")


def with_library_for(platform: str) -> Build:
    """Builds the good FMU with its library in the folder of another platform."""

    def edit(files: Files) -> None:
        files[LIBRARY.replace(fmpy.platform, platform)] = files.pop(LIBRARY)

    return with_files(edit)


@pytest.mark.parametrize("platform", mostly_slow(["lin64", "plan9", "win64"], ["plan9"]))
def test_fmu_that_cannot_run_here_does_not_pass(platform: str, tmp_path: Path) -> None:
    if platform == "win64":
        path = build("Reference", "native", [platform], tmp_path)
    else:
        path = with_library_for(platform)(tmp_path)
    report = examine(path, "binaries", "run")
    reason = f"It has no binary for {fmpy.platform}"
    assert report["binaries.present"].sentence.startswith(f"There are binaries for {platform}, but none for")
    assert report["binaries.symbols"].verdict == Verdict.PASSED
    assert report["binaries.loads"].verdict == Verdict.SKIPPED
    assert not report.passed
    assert any("could not run. binaries.loads: " + reason in text for text in report.objections)
    assert any(reason in gap for gap in report.not_examined)


def test_checks_of_the_file_alone_can_still_pass(tmp_path: Path) -> None:
    path = with_library_for("win64")(tmp_path)
    assert examine(path, "archive", "description", "variables", "structure").passed


def test_failure_that_is_skipped_does_not_excuse_others(tmp_path: Path) -> None:
    """A check is tried without the failed one; not so if nothing can run without that."""
    schema = with_text("<fmiModelDescription ", '<fmiModelDescription strange="1" ')(tmp_path)
    without = Settings(skip=("description.schema",))
    report = examine(schema, "variables", "run.completes", settings=without)
    assert report.passed, report.of(Verdict.FAILED)
    assert {f.verdict for f in report.findings} == {Verdict.PASSED}
    crash = build_good_fmu(tmp_path, "SEGFAULT")
    report = examine(crash, "run", "state", settings=Settings(skip=("run.completes",)))
    assert not report.passed and not report.of(Verdict.FAILED)
    (objection,) = report.objections
    assert objection.endswith("It needs run.completes, which failed.")


def test_failed_need_fails_the_report_unless_it_is_skipped(tmp_path: Path) -> None:
    (bad := tmp_path / "bad.fmu").write_bytes(b"PK no zip")
    report = examine(bad, "run")
    assert {f.check for f in report.of(Verdict.FAILED)} == {"archive.safe"}
    assert {f.check.split(".")[0] for f in report.of(Verdict.SKIPPED)} == {"run"}
    assert not report.passed
    report = examine(bad, "run", settings=Settings(skip=("archive.safe",)))
    assert {f.verdict for f in report.findings} == {Verdict.SKIPPED} and not report.passed


def test_warnings_and_skipped_checks_can_fail(tmp_path: Path) -> None:
    path = setting("//DefaultExperiment", stepSize="0")(tmp_path)
    warns, skips = ("description.experiment",), ("reference.agrees", "archive")

    def passes(only: tuple[str, ...], fail_on: tuple[str, ...] = (), must_run: tuple[str, ...] = ()) -> bool:
        settings = Settings(fail_on=fail_on, must_run=must_run)
        return examine(path, *only, settings=settings, apart=()).passed

    assert passes(warns) and not passes(warns, ("warning",))
    assert passes(skips, ("warning",)) and not passes(skips, ("skip",))
    assert passes(skips, must_run=("archive",)) and not passes(skips, must_run=("reference",))
    report = examine(path, *skips, settings=Settings(must_run=("reference",)), apart=())
    assert "--must-run reference: reference.agrees was skipped." in report.objections[0]


def test_fmu_that_ends_its_examiner_keeps_all_other_findings(tmp_path: Path) -> None:
    """The examiner ends in one check; a new one goes on after this check."""
    killer, good = build_wide_fmu(tmp_path, "step:kill_parent"), tmp_path / "Toy.fmu"
    good.write_bytes(good_bytes())
    report = ec.verify(
        [killer, good], only=["archive", "description.schema", "instance.environment", "binaries.loads"]
    )
    assert {f.check for f in report[killer].of(Verdict.FAILED)} == {"instance.environment"}
    message = report[killer]["instance.environment"].sentence
    assert message.startswith("It ended the process in fmi2") or "emla verify" in message
    assert "SIGKILL" in message
    passed = {f.check for f in report[killer].of(Verdict.PASSED)}
    assert {"description.schema", "binaries.loads"} <= passed and report[good].passed


def test_slow_fmu_runs_for_fewer_steps(tmp_path: Path) -> None:
    report = examine(build_good_fmu(tmp_path, "SLOW"), "run.completes", settings=Settings(seconds=2.0))
    assert report.passed, report.of(Verdict.FAILED)
    steps = report["run.completes"].outcome.figures["steps"]
    assert 1 <= steps < 20
    assert any(f"Runs end after {steps} of 100 steps" in gap for gap in report.not_examined)


def test_exports_of_a_mach_o_library_without_export_trie() -> None:
    """Older linkers write no export trie, which LIEF alone reads as exports."""
    library = _mach_o({"_fmi2DoStep": 0x0F, "_hidden": 0x1F, "_local": 0x0E, "_malloc": 0x01})
    assert list_exports(library) == {"fmi2DoStep"}


def _mach_o(symbols: dict[str, int]) -> lief.MachO.Binary:
    """Return a 64-bit library that has these symbols with their `n_type`, and no export trie."""
    names, table = b"\0", b""
    for name, kind in symbols.items():
        section = 0 if kind == 0x01 else 1
        table += struct.pack("<IBBHQ", len(names), kind, section, 0, 0x400)
        names += name.encode() + b"\0"
    section = struct.pack("<16s16sQQIIIIIIII", b"__text", b"__TEXT", 0x400, 16, 0x400, 0, 0, 0, 0, 0, 0, 0)
    segment = struct.pack("<II16sQQQQIIII", 0x19, 152, b"__TEXT", 0, 0x1000, 0, 0x1000, 5, 5, 1, 0)
    at = 0x1000
    linkedit = struct.pack("<II16sQQQQIIII", 0x19, 72, b"__LINKEDIT", at, 0x1000, at, 0x1000, 1, 1, 0, 0)
    symtab = struct.pack("<IIIIII", 2, 24, at, len(symbols), at + len(table), len(names))
    commands = segment + section + linkedit + symtab
    header = struct.pack("<IIIIIIII", 0xFEEDFACF, 0x01000007, 3, 6, 3, len(commands), 0, 0)
    content = (header + commands).ljust(at, b"\0") + table + names
    library = lief.parse(list(content.ljust(0x2000, b"\0")))
    assert isinstance(library, lief.MachO.Binary)
    return library
