"""The script that compares tools that verify FMUs."""

from functools import partial
from pathlib import Path

import pytest

from docs import verifiers
from docs.verifiers import OURS, examine, summarize, with_command, with_fmpy
from tests.support.broken.static import STATIC


def test_only_what_is_new_in_a_broken_fmu_counts(tmp_path: Path) -> None:
    of_schema = [b for b in STATIC if b.check == "variables.start"][:1]
    tools = {"FMPy": with_fmpy, "grumbler": partial(with_command, ["false", "{}"])}
    rows = examine({"the file": of_schema}, tools, tmp_path)
    assert [(row[OURS], row["FMPy"], row["grumbler"]) for row in rows] == [("yes", "yes", "")]
    assert "| all | 1 | 1 | 1 | 0 |" in summarize(rows, [OURS, *tools])


def test_a_tool_that_ends_its_parent_complains(tmp_path: Path) -> None:
    path = tmp_path / "X.fmu"
    assert with_command(["sh", "-c", "kill -9 $PPID"], path) == "yes"
    assert with_command(["test", "{}", "=", str(path)], path) == ""


def test_a_tool_without_an_answer_found_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(verifiers, "LIMIT", 0.1)
    answer = with_command(["sleep", "60"], tmp_path / "X.fmu")
    assert answer == verifiers.NO_ANSWER
    group = next(iter(verifiers.SETS))
    rows = [{"set": group, "fmu": "x", "what": "", OURS: "yes", "slow": answer}]
    text = summarize(rows, [OURS, "slow"])
    assert "| all | 1 | 1 | 0 |" in text
    assert text.endswith("which do not count: slow 1.\n")
