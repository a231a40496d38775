"""What does not pass although no check failed, and that one FMU costs no other one its findings."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from string import Template
from xml.etree import ElementTree

import fmpy
import lief
import pytest

import emla_cosim as ec
from emla_cosim.fmu.models import build
from emla_cosim.verification.libraries import list_exports
from emla_cosim.verification.verdict import Verdict
from fmublock.archive import write_archive
from tests.support.broken.dynamic import Fault, build_good_fmu
from tests.support.broken.editing import DESCRIPTION, good_bytes, setting, with_files, with_text
from tests.support.broken.static import LIBRARY
from tests.support.commands import Emla, sentence
from tests.support.hand_written_fmus import compile_library
from tests.support.paths import SUPPORT

_BROKEN = SUPPORT / "broken"
_GUID = "{600d0000-0000-4000-8000-000000000001}"

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no signals that end a process.")


def outward(folder: Path, **macros: int) -> Path:
    """Build the FMU of outward.c."""
    text = Template((_BROKEN / "good.xml").read_text(encoding="utf-8"))
    library = compile_library(_BROKEN / "outward.c", {"MODEL_GUID": f'"{_GUID}"', **macros})
    path = folder / "Outward.fmu"
    described = text.substitute(name="Outward", guid=_GUID, total="2 9", once="false", order=1)
    content = {
        DESCRIPTION: described.encode(),
        f"binaries/{fmpy.platform}/Outward{fmpy.sharedLibraryExtension}": library,
        "resources/fault.txt": b"0\n",
    }
    write_archive(path, content)
    return path


def moved(folder: str) -> object:
    """Build the good FMU without sources, with its library in another folder."""
    return lambda files: files.update({LIBRARY.replace(fmpy.platform, folder): files.pop(LIBRARY)})


def misspelt(name: str) -> Callable[[Path], Path]:
    return with_files(moved(name))  # type: ignore[arg-type]


def for_another_platform(folder: Path) -> Path:
    return build("Reference", "native", ["win64" if fmpy.platform != "win64" else "linux64"], folder)


@pytest.mark.parametrize("make", [misspelt("Linux64"), misspelt("lin64"), for_another_platform])
def test_an_fmu_that_cannot_run_here_does_not_pass(
    make: Callable[[Path], Path], tmp_path: Path, emla: Emla
) -> None:
    fmu = make(tmp_path)
    found = emla("verify", str(fmu), "--json", "r.json", "--junit", "r.xml", "--html", "r.html")
    assert "1 FMU did not pass for other reasons." in sentence(found, 1)
    assert f"could not run. binaries.loads: There is no binary for {fmpy.platform}." in found.stdout
    report = json.loads((tmp_path / "r.json").read_text())
    assert not report["passed"]
    assert any("There is no binary for" in gap for gap in report["examined"][0]["not_examined"])
    suite = ElementTree.parse(tmp_path / "r.xml").getroot()
    assert int(suite.get("failures", "0")) >= 1
    page = (tmp_path / "r.html").read_text()
    assert "Not examined" in page and "Not passed" in page


def test_checks_of_the_file_alone_can_still_pass(tmp_path: Path) -> None:
    fmu = with_files(moved("win64"))(tmp_path)  # type: ignore[arg-type]
    assert ec.verify(fmu, only=["archive", "description", "variables", "structure"]).passed


def test_a_failure_that_is_skipped_does_not_excuse_others(tmp_path: Path) -> None:
    """The one of a part is tried without it; one without which nothing runs is not passed over in silence."""
    schema = with_text("<fmiModelDescription ", '<fmiModelDescription strange="1" ')(tmp_path)
    one = ec.verify(schema, skip=["description.schema"], only=["variables", "run.completes"]).examined[0]
    assert one.passed, one.of(Verdict.FAILED)
    assert {f.verdict for f in one.findings} == {Verdict.PASSED}
    crash = build_good_fmu(tmp_path, Fault.SEGFAULT)
    report = ec.verify(crash, skip=["run.completes"], only=["run", "state"])
    assert not report.passed and not report.failures
    (objection,) = report.examined[0].objections
    assert objection.endswith("It needs run.completes, which failed.")
    (bad := tmp_path / "bad.fmu").write_bytes(b"PK no zip")
    assert not ec.verify(bad, skip="archive.safe").passed


def test_what_else_fails_can_be_chosen(tmp_path: Path, emla: Emla) -> None:
    setting("//DefaultExperiment", stepSize="0")(tmp_path)
    warns = ("verify", "Toy.fmu", "--only", "description.experiment")
    found = emla(*warns)
    assert found.exit_code == 0, found.output
    assert emla(*warns, "--fail-on", "warning").exit_code == 1
    skips = ("verify", "Toy.fmu", "--only", "reference.agrees", "--only", "archive")
    assert emla(*skips, "--fail-on", "warning").exit_code == 0
    assert emla(*skips, "--fail-on", "skip").exit_code == 1
    assert emla(*skips, "--must-run", "archive").exit_code == 0
    found = emla(*skips, "--must-run", "reference")
    assert "--must-run reference: reference.agrees was skipped." in found.stdout
    assert found.exit_code == 1
    assert "'run' must run, but" in sentence(emla(*skips, "--must-run", "run"), 2)
    assert "there is no value of fail-on 'x'" in sentence(emla(*skips, "--fail-on", "x"), 2)


def test_a_reference_folder_without_that_fmu_does_not_pass(tmp_path: Path) -> None:
    (tmp_path / "Toy.fmu").write_bytes(good_bytes())
    report = ec.verify(tmp_path / "Toy.fmu", reference=tmp_path, only="reference")
    assert not report.passed
    assert "There is no Toy_ref.csv" in report.examined[0].objections[0]


def test_an_fmu_that_kills_its_parent_keeps_all_other_findings(tmp_path: Path) -> None:
    """The process that examines it ends in one check; a new one goes on after this check."""
    killer, good = outward(tmp_path, KILLS=1), tmp_path / "Toy.fmu"
    good.write_bytes(good_bytes())
    report = ec.verify([killer, good], only=["archive", "description", "run", "instance.created"])
    failed = {f.check for f in report[killer].of(Verdict.FAILED)}
    assert failed == {"run.completes"}
    lost = report[killer]["run.completes"]
    assert lost.sentence.startswith("It ended the process in fmi2") and "SIGKILL" in lost.sentence
    assert lost.clause.section == "2.1.3"
    assert report[killer]["description.schema"].verdict == Verdict.PASSED
    assert report[killer]["instance.created"].verdict == Verdict.PASSED
    assert report[good].passed


def test_a_slow_fmu_is_run_for_fewer_steps(tmp_path: Path) -> None:
    report = ec.verify(outward(tmp_path, SLEEPS=50_000), only=["run"], seconds=2.0)
    assert report.passed, report.failures
    one = report.examined[0]
    steps = one["run.completes"].outcome.figures["steps"]
    assert 1 <= steps < 20
    assert any(f"Runs end after {steps} of 100 steps" in gap for gap in one.not_examined)


def test_the_symbol_table_of_a_mach_o_library_is_read() -> None:
    """Older linkers write no export trie, which LIEF alone reads as exports."""
    library = _mach_o({"_fmi2DoStep": 0x0F, "_hidden": 0x1F, "_local": 0x0E, "_malloc": 0x01})
    assert list_exports(library) == {"fmi2DoStep"}


def _mach_o(symbols: dict[str, int]) -> lief.MachO.Binary:
    """Return a 64-bit library that has these symbols with their `n_type`, and no export trie."""
    import struct

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
    found = lief.parse(list(content.ljust(0x2000, b"\0")))
    assert isinstance(found, lief.MachO.Binary)
    return found
