"""Every call by which Python reaches a file fails once: a sentence, whole files, and nothing lost."""

import errno
import gc
import json
import os
import re
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import polars
import pytest

from tests.support.commands import Emla

EVENTS = {
    "open", "os.mkdir", "os.rename", "os.link", "os.remove", "os.rmdir", "os.chmod", "os.scandir",
    "os.listdir", "os.truncate", "tempfile.mkstemp", "tempfile.mkdtemp", "shutil.rmtree",
}  # fmt: skip
"""What the interpreter tells of before it does it; the first argument is the path."""

COMMANDS = {
    "run": ["run", "my.toml", "--output", "out", "--no-plots", "--checkpoint", "c"],
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
OURS = re.compile(r"[/\\\\](emla_cosim|fmublock)[/\\\\](?!test_)")

MADE = {"export": "mine.ssp", "build": "built/Reference/Reference.fmu", "parquet": "out/results.parquet"}
"""What commands are for, if not for results.csv."""


class _Failing:
    """Lets an event in a folder fail, at a place of our code where none has failed yet."""

    def __init__(self) -> None:
        self.folder: str | None = None
        self.tried: set[tuple[str, str, int]] = set()
        self.failed: tuple[str, str, int] | None = None
        sys.addaudithook(self.hear)  # for ever: there is no way to remove one

    def hear(self, event: str, arguments: tuple[Any, ...]) -> None:
        """What the interpreter calls."""
        if self.folder is None or self.failed or event not in EVENTS or not arguments:
            return
        path = arguments[0]
        if not isinstance(path, (str, bytes, os.PathLike)) or not self._inside(os.fsdecode(path)):
            return
        place = (event, *_place())
        if place not in self.tried:
            self.tried.add(place)
            self.failed = place
            raise OSError(errno.EIO, os.strerror(errno.EIO), path)

    def _inside(self, path: str) -> bool:
        return not Path(path).is_absolute() or path.startswith(str(self.folder))


def _place() -> tuple[str, int]:
    """The innermost line of ours that is being executed."""
    frame = sys._getframe(2)
    while frame.f_back is not None and not OURS.search(frame.f_code.co_filename):
        frame = frame.f_back
    return Path(frame.f_code.co_filename).name, frame.f_lineno


@pytest.fixture(scope="module")
def hook() -> _Failing:
    return _Failing()


@pytest.fixture
def failing(hook: _Failing, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[_Failing]:
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    yield hook
    hook.folder = None


@pytest.fixture
def unraisable(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What finalizers raise: nobody can catch it, and Python prints its traceback."""
    told: list[str] = []
    monkeypatch.setattr(sys, "unraisablehook", lambda of: told.append(f"{of.exc_value!r} in {of.object!r}"))
    return told


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
    what: str, emla: Emla, failing: _Failing, unraisable: list[str], tmp_path: Path
) -> None:
    (tmp_path / "my.toml").write_text('system = "lift"\nstop_time = 0.01\nstep_size = 1e-4\n')
    assert emla("export", "lift", "lift.ssp").exit_code == 0
    before = ["run", "lift", "--stop-time", "0.01", "--output", "out", "--no-plots", "--checkpoint", "before"]
    assert emla(*before).exit_code == 0
    made, silent = tmp_path / MADE.get(what, "out/results.csv"), []
    failing.tried = set()
    while True:
        failing.folder, failing.failed = str(tmp_path), None
        result = emla(*COMMANDS[what])
        failing.folder = None
        if failing.failed is None:
            break
        assert result.exception is None or isinstance(result.exception, SystemExit), failing.failed
        assert result.exit_code in (0, 1, 2), failing.failed
        lines = [x for x in result.stderr.splitlines() if x.startswith("Error:")]
        assert len(lines) == (result.exit_code > 0), (failing.failed, result.stderr)
        if not result.exit_code:  # it could do without
            silent.append(made.read_bytes())
        assert_whole(tmp_path)
    assert result.exit_code == 0, result.stderr
    gc.collect()
    assert not unraisable
    assert all(content == made.read_bytes() for content in silent)
    assert len(silent) < len(failing.tried) or what == "build"  # which reads what it made before
    print(f"{what}: {len(failing.tried)} places failed, {len(silent)} of them without harm")
