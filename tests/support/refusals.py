"""Commands that are refused: one sentence, and nothing left behind."""

import gc
import tempfile
from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from emla_cosim.cli.app import app

Refused = Callable[..., str]


def refusals(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Refused:
    """A function that runs an SSP in `tmp_path`, checks that it is refused, and returns the sentence."""
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    monkeypatch.chdir(work)

    def refused(path: Path | str, *options: str) -> str:
        before = _listing(tmp_path)
        times = ["--stop-time", "1", "--step-size", "0.1", "--no-plots"]
        result = CliRunner().invoke(app, ["run", str(path), *times, *options])
        assert result.exit_code == 2, result.output
        assert isinstance(result.exception, SystemExit)
        stdout, stderr = result.stdout, result.stderr
        del result  # whose traceback holds the scenario, and this what was unpacked
        gc.collect()
        assert _listing(tmp_path) == before
        lines = [line for line in stderr.splitlines() if line.strip() and not _is_progress(line)]
        assert stdout == ""
        assert len(lines) == 1, lines
        sentence = lines[0]
        assert sentence.startswith("Error: ")
        assert sentence[-1] in ".?"
        assert str(temporary) not in sentence
        return sentence.removeprefix("Error: ")

    return refused


def _is_progress(line: str) -> bool:
    return "━" in line or line.endswith("-:--:--")


def _listing(folder: Path) -> dict[Path, int]:
    """All files with their sizes, and folders, around, but for the results of a run."""
    results = folder / "work" / "results"
    around = [*folder.parent.iterdir(), *folder.rglob("*")]
    kept = (p for p in around if results not in (p, *p.parents) and p != folder)
    return {p: 0 if p.is_dir() else p.lstat().st_size for p in kept}
