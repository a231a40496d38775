"""The scripts behind tables of the documentation: what they count, and what they say of tools that fail."""

import argparse
import csv
import shutil
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks.checker_tools import CRASHED, HUNG, NOT_APPLICABLE, Answer, Checker, find_checkers, run
from benchmarks.checkers import GROUPS, OURS, examine, group_of, summarize
from docs import controller_results, good_fmus
from fmu_verify.catalogue import CHECKS
from tests.support.broken.static import STATIC
from tests.support.broken.table import BROKEN
from tests.support.paths import ROOT
from tests.support.processes import run as run_program

OPTIONS = ("fmusim", "vdmcheck2", "vdmcheck3", "fmu_compliance_checker")


@pytest.mark.slow
def test_fmus_are_compared_with_fmpy_and_copies_count_once(fmu_folder: Path, tmp_path: Path) -> None:
    folder = tmp_path / "fmus"
    folder.mkdir()
    for name in ("plant.fmu", "copy.fmu"):
        shutil.copy(fmu_folder / "EmlaPlant" / "EmlaPlant.fmu", folder / name)
    (folder / "none.fmu").write_text("version https://git-lfs")
    command = [sys.executable, str(ROOT / "docs" / "foreign_fmus.py"), str(folder), str(tmp_path / "out")]
    run_program(*command, check=True, timeout=300)
    with (tmp_path / "out" / "fmus.csv").open() as stream:
        rows = {(row["fmu"], row["kind"]): row for row in csv.DictReader(stream)}
    assert set(rows) == {("copy.fmu", "CS"), ("copy.fmu", "ME"), ("none.fmu", "")}
    for kind in ("CS", "ME"):
        row = rows["copy.fmu", kind]
        assert (row["fmpy"], row["emla"], row["agrees"]) == ("yes", "yes", "True"), row
    assert "not an FMU" in rows["none.fmu", ""]["reason"]
    assert "| all | ME | 1 | 1 | 0 | 1 | 0 | 1 of 1 |" in (tmp_path / "out" / "comparison.md").read_text()


def _finding(check: str, verdict: str, section: str, document: str = "FMI 2.0.4") -> dict[str, Any]:
    return {"check": check, "verdict": verdict, "clause": {"document": document, "section": section}}


def _fmu(tool: str, *findings: dict[str, Any]) -> dict[str, Any]:
    return {"facts": {"made by": tool}, "findings": list(findings)}


def test_findings_are_counted_by_check_and_tool() -> None:
    first = _fmu("Dymola Version 2017", _finding("a.b", "failed", "2.3"), _finding("c.d", "passed", "2.1"))
    warning = _finding("c.d", "warning", "c.d", "emla verify")
    second = _fmu("OpenModelica Compiler v1.13.0", _finding("a.b", "failed", "2.1.5"), warning)
    clean = _fmu("Acme 3", _finding("a.b", "skipped", "2.3"))
    assert good_fmus.count_findings([{"examined": [first, second]}, {"examined": [clean]}]) == [
        ["failed", "a.b", "2", "Dymola, OpenModelica", "2.1.5, 2.3"],
        ["warning", "c.d", "1", "OpenModelica", "emla verify c.d"],
    ]


def test_pages_show_their_csv_files() -> None:
    rows = good_fmus.TABLE.read_text(encoding="utf-8").splitlines()[1:]
    assert good_fmus.make_table(csv.reader(rows)) in good_fmus.PAGE.read_text(encoding="utf-8")
    rows = controller_results.read_rows()
    for page in controller_results.PAGES:
        text = page.read_text(encoding="utf-8")
        assert controller_results.fill(text, rows) == text


def test_comparisons_are_summarized_over_seeds(tmp_path: Path) -> None:
    lines = [
        "scenario,joint,case,controller,gains,seed,random,held,lost_at_s,why,"
        + ",".join(controller_results.FIGURES),
        "study-drive,lift,nominal,foc,rule,1,true,true,,,1e-6,1,1,1,1,1,0,1",
        "study-drive,lift,nominal,foc,rule,2,true,true,,,3e-6,1,1,1,1,1,0,1",
        "study-drive,lift,nominal,rsba,damped,1,true,true,,,1e-6,1,1,1,1,1,0,1",
        "study-drive,lift,nominal,rsba,damped,2,true,false,0.3,tripped,7e-6,1,1,1,1,1,0,",
    ]
    (tmp_path / "comparison.csv").write_text("\n".join(lines))
    foc, rsba = controller_results.summarize("drive", tmp_path)
    assert (foc["joint"], foc["seeds"], foc["not_held"], foc["why"]) == ("lift", "2", "0", "")
    assert (foc["position_error_m"], foc["position_error_m_std"]) == ("2e-06", "1.4e-06")
    assert (rsba["gains"], rsba["not_held"], rsba["why"], rsba["position_error_m"]) == (
        "damped",
        "1",
        "tripped",
        "7e-06",
    )
    assert rsba["position_error_m_std"] == rsba["convergence_time_s"] == ""


@pytest.mark.slow
def test_complaints_about_good_fmus_do_not_count(tmp_path: Path) -> None:
    broken = [b for b in STATIC if b.check == "variables.start"][:1]
    fmpy = next(c for c in find_checkers(argparse.Namespace(**dict.fromkeys(OPTIONS)))[0] if not c.calls)
    tools = [fmpy, Checker("grumbler", "1.0", ["false"], "x"), Checker("other", "", ["true"], "x", (3,))]
    rows = examine(tools, broken, [], tmp_path, 60.0, 1)
    assert rows[-1][OURS] == "found: force has no start value."
    assert rows[-1][fmpy.name].startswith('found: Variable "force"')
    assert rows[-1]["grumbler"] == rows[-1]["other"] == NOT_APPLICABLE
    row = rows[0] | {"grumbler": "hung", "other": "not found"}
    table = summarize([row, rows[-1] | {"grumbler": "crashed: SIGSEGV"}], tools, ["fmusim"])
    assert "| grumbler 1.0 | - | 0 of 1 | - | - | - | - | 0 of 1 | 1 | 0 | 1 of 1 | - |" in table
    assert "| other | - | - | - | - | - | - | - | 0 | 0 | 0 of 1 | - |" in table
    assert table.endswith("Not there: fmusim.")


def test_tools_that_do_not_answer(tmp_path: Path) -> None:
    def answer(script: str, limit: float = 60.0) -> Answer:
        return run(Checker("x", "", ["sh", "-c", script], "^warning"), (), tmp_path / "X.fmu", limit)

    assert answer("sleep 60", 0.1).verdict == HUNG
    assert answer("kill -9 $PPID") == Answer(["SIGKILL"], -9, CRASHED)
    assert answer("kill -11 $$") == Answer(["SIGSEGV"], 139, CRASHED)
    assert answer("echo fine; echo warning: /tmp/a/X.fmu") == Answer(["warning: X.fmu"])
    assert answer("echo bad; exit 255") == Answer(["exit code 255: bad"], 255)


def test_groups_of_the_table_of_checkers() -> None:
    assert {group_of(b.check) for b in BROKEN} == set(GROUPS)
    prefixes = [prefix for prefixes in GROUPS.values() for prefix in prefixes]
    assert set(prefixes) <= {check.group for check in CHECKS}
