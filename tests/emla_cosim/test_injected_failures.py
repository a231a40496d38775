"""Every call by which Python reaches a file fails once: a sentence, whole files, and nothing lost."""

import errno
import json
import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import polars
import pytest

from tests.support.commands import Emla

EVENTS = {
    "open", "os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.chmod", "os.scandir", "os.listdir",
    "os.truncate", "tempfile.mkstemp", "tempfile.mkdtemp", "shutil.rmtree",
}  # fmt: skip
"""What the interpreter tells of before it does it; the first argument is the path."""

COMMANDS = {
    "run": ["run", "my.toml", "--output", "out", "--checkpoint", "c"],
    "resume": ["run", "lift", "--stop-time", "0.02", "--output", "out", "--no-plots", "--resume", "before"],
    "parquet": [
        "run",
        "lift",
        "--stop-time",
        "0.01",
        "--output",
        "out",
        "--no-plots",
        "--output-format",
        "parquet",
    ],
    "export": ["export", "lift", "mine.ssp"],
    "package": ["run", "lift.ssp", "--stop-time", "0.01", "--output", "out", "--no-plots"],
    "build": ["build", "Reference", "--output", "built"],
}
HARMLESS = ("os.remove", "os.rmdir", "shutil.rmtree", "os.scandir", "os.listdir")
"""Failures that may pass without a word: something is left that nobody needs."""


class _Failing:
    """Counts the events in a folder, and lets one of them fail."""

    def __init__(self) -> None:
        self.folder: str | None = None
        self.seen = 0
        self.at = -1
        self.failed = ""
        sys.addaudithook(self.hear)  # for ever: there is no way to remove one

    def hear(self, event: str, arguments: tuple[Any, ...]) -> None:
        """What the interpreter calls."""
        if self.folder is None or event not in EVENTS or not arguments:
            return
        path = arguments[0]
        if not isinstance(path, (str, bytes, os.PathLike)) or not self._inside(os.fsdecode(path)):
            return
        self.seen += 1
        if self.seen == self.at:
            self.failed = f"{event} {os.fsdecode(path)}"
            raise OSError(errno.EIO, os.strerror(errno.EIO), path)

    def _inside(self, path: str) -> bool:
        return not Path(path).is_absolute() or path.startswith(str(self.folder))


@pytest.fixture(scope="module")
def hook() -> _Failing:
    return _Failing()


@pytest.fixture
def failing(hook: _Failing, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[_Failing]:
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    yield hook
    hook.folder = None


def assert_whole(folder: Path) -> None:
    """No file is there in part."""
    for path in folder.rglob("*"):
        if path.suffix == ".json":
            json.loads(path.read_text())
        elif path.suffix == ".png":
            assert path.read_bytes().endswith(b"IEND\xaeB`\x82")
        elif path.suffix == ".csv" and path.stat().st_size:
            assert path.read_bytes().endswith(b"\n")
        elif path.suffix == ".parquet" and path.parent.name == "out":
            polars.read_parquet(path)


@pytest.mark.parametrize("what", COMMANDS)
def test_every_call_to_the_file_system_fails_once(
    what: str, emla: Emla, failing: _Failing, tmp_path: Path
) -> None:
    (tmp_path / "my.toml").write_text('system = "lift"\nstop_time = 0.01\nstep_size = 1e-4\n')
    assert emla("export", "lift", "lift.ssp").exit_code == 0
    before = ["run", "lift", "--stop-time", "0.01", "--output", "out", "--no-plots", "--checkpoint", "before"]
    assert emla(*before).exit_code == 0
    failures, silent, at = 0, [], 0
    while True:
        at += 1
        failing.folder, failing.seen, failing.at, failing.failed = str(tmp_path), 0, at, ""
        result = emla(*COMMANDS[what])
        failing.folder = None
        if not failing.failed:
            break
        failures += 1
        assert result.exception is None or isinstance(result.exception, SystemExit), failing.failed
        assert result.exit_code in (0, 1, 2), failing.failed
        lines = [x for x in result.stderr.splitlines() if x.startswith("Error:")]
        assert len(lines) == (result.exit_code > 0), (failing.failed, result.stderr)
        if not result.exit_code and not failing.failed.startswith(HARMLESS):
            silent.append(failing.failed)
        assert_whole(tmp_path)
    assert result.exit_code == 0, (at, result.stderr)
    assert failures > 0
    print(what, failures, "failures;", "silent:", *silent, sep="\n  ")
