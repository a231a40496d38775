"""A file of the user's that appears under an output's name while a command runs is not replaced."""

import errno
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import fmublock.files
from emla_cosim.views.output_folder import OutputFolder
from fmublock.files import UNFINISHED, write_atomically
from tests.support.commands import Emla, sentence

MINE = "years of work"
SHORT = ("--stop-time", "0.002")


def refuse(place: Path) -> None:
    """Refuse to replace any file."""
    raise FileExistsError(errno.EEXIST, "it is mine")


def test_a_file_that_appears_at_the_last_moment_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    original = Path.hardlink_to

    def link(self: Path, target: Path) -> None:
        self.write_text(MINE)
        original(self, target)

    monkeypatch.setattr(Path, "hardlink_to", link)
    with (
        pytest.raises(FileExistsError, match="it is mine"),
        write_atomically(tmp_path / "f", refuse) as stream,
    ):
        stream.write(b"ours")
    assert (tmp_path / "f").read_text() == MINE
    assert [p.name for p in tmp_path.iterdir()] == ["f"]


@pytest.mark.parametrize("links", [True, False])
def test_a_new_file_needs_no_check(links: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(self: Path, target: Path) -> None:
        raise OSError(errno.EPERM, os.strerror(errno.EPERM))

    if not links:
        monkeypatch.setattr(Path, "hardlink_to", fail)
    with write_atomically(tmp_path / "f", refuse) as stream:
        stream.write(b"ours")
    assert (tmp_path / "f").read_bytes() == b"ours"
    assert [p.name for p in tmp_path.iterdir()] == ["f"]
    assert (tmp_path / "f").stat().st_nlink == 1


@contextmanager
def appear(monkeypatch: pytest.MonkeyPatch, name: str) -> Iterator[None]:
    """Let the user write a file just before a command gives its own the name."""
    original, done = fmublock.files._move, list[str]()

    def moving(unfinished: Path, place: Path, check: Callable[[Path], object]) -> None:
        if place.name == name and not done:
            done.append(name)
            place.write_text(MINE)
        original(unfinished, place, check)

    with monkeypatch.context() as patch:
        patch.setattr(fmublock.files, "_move", moving)
        yield
    assert done


COMMANDS = {
    "out/metrics.json": ("run", "lift", *SHORT, "--no-plots", "--output", "out"),
    "out/run.json": ("run", "lift", *SHORT, "--no-plots", "--output", "out"),
    "c": ("run", "lift", *SHORT, "--no-plots", "--output", "out", "--checkpoint", "c"),
    "x.ssp": ("export", "lift", "x.ssp"),
    "i.json": ("info", "lift", "--json", "i.json"),
    "built/Reference/Reference.fmu": ("build", "Reference", "--output", "built"),
}
"""Commands by the file that appears."""


@pytest.mark.parametrize("file", COMMANDS)
@pytest.mark.parametrize("again", [False, True], ids=["new", "earlier"])
def test_what_appears_while_a_command_runs_stays(
    file: str, again: bool, emla: Emla, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    command = COMMANDS[file]
    if again:
        # with all its platforms the FMU would be up to date, and not written again
        few = ("--platform", "linux64") if file.endswith(".fmu") else ()
        assert emla(*command, *few).exit_code == 0
    with appear(monkeypatch, Path(file).name):
        said = sentence(emla(*command), 1)
    assert "appeared while emla ran" in said or "was not built by" in said
    assert (tmp_path / file).read_text() == MINE
    assert not [p for p in tmp_path.rglob("*") if p.name.startswith(UNFINISHED)]
    with appear(monkeypatch, Path(file).name):
        assert emla(*command, "--overwrite").exit_code == 0
    assert (tmp_path / file).read_bytes() != MINE.encode()


def test_a_plot_that_appears_stays(emla: Emla, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    original = OutputFolder.draw

    def draw(self: OutputFolder, name: str, figure: Any) -> Path:
        (tmp_path / "out" / name).write_text(MINE)
        return original(self, name, figure)

    monkeypatch.setattr(OutputFolder, "draw", draw)
    assert "appeared while emla ran" in sentence(emla("run", "lift", *SHORT, "--output", "out"), 1)
    (plot,) = (tmp_path / "out").glob("*.png")
    assert plot.read_text() == MINE
