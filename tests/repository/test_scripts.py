"""The scripts behind tables of the documentation: what they count, and what they say of tools that fail."""

import csv
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from docs import verifiers
from docs.good_fmus import summarize
from docs.verifiers import OURS, examine, with_command, with_fmpy
from tests.support.broken.static import STATIC
from tests.support.paths import ROOT


@pytest.mark.slow
def test_fmus_are_compared_with_fmpy_and_copies_count_once(fmu_folder: Path, tmp_path: Path) -> None:
    folder = tmp_path / "fmus"
    folder.mkdir()
    for name in ("plant.fmu", "copy.fmu"):
        shutil.copy(fmu_folder / "EmlaPlant" / "EmlaPlant.fmu", folder / name)
    (folder / "none.fmu").write_text("version https://git-lfs")
    command = [sys.executable, str(ROOT / "docs" / "foreign_fmus.py"), str(folder), str(tmp_path / "out")]
    subprocess.run(command, check=True, capture_output=True, timeout=300)
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
    text = summarize([{"examined": [first, second]}, {"examined": [clean]}])
    assert text.splitlines()[0] == "3 FMUs, 1 without a finding."
    assert text.splitlines()[4:] == [
        "| failed | `a.b` | 2 | Dymola, OpenModelica | 2.1.5, 2.3 |",
        "| warning | `c.d` | 1 | OpenModelica | emla verify c.d |",
    ]


@pytest.mark.slow
def test_only_new_findings_of_a_broken_fmu_count(tmp_path: Path) -> None:
    of_schema = [b for b in STATIC if b.check == "variables.start"][:1]
    tools = {"FMPy": with_fmpy, "grumbler": partial(with_command, ["false", "{}"])}
    rows = examine({"the file": of_schema}, tools, tmp_path)
    assert [(row[OURS], row["FMPy"], row["grumbler"]) for row in rows] == [("yes", "yes", "")]
    assert "| all | 1 | 1 | 1 | 0 |" in verifiers.summarize(rows, [OURS, *tools])


def test_a_tool_without_an_answer_does_not_count(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(verifiers, "LIMIT", 0.1)
    answer = with_command(["sleep", "60"], tmp_path / "X.fmu")
    assert answer == verifiers.NO_ANSWER
    assert with_command(["sh", "-c", "kill -9 $PPID"], tmp_path / "X.fmu") == "yes"
    group = next(iter(verifiers.SETS))
    rows = [{"set": group, "fmu": "x", "what": "", OURS: "yes", "slow": answer}]
    assert verifiers.summarize(rows, [OURS, "slow"]).endswith("which do not count: slow 1.\n")
