"""An output folder that is removed or replaced while a command runs: one sentence, no file of others."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from emla_cosim.sweeps.folder import SweepFolder
from emla_cosim.views.output_folder import OutputFolder
from tests.support.commands import Emla, sentence
from tests.support.tiers import mostly_slow

MINE = "years of work"
NAMES = ("metrics.json", "run.json", "results.csv", "variants.parquet", "sweep.json", "tracking.png")
SHORT = ("--stop-time", "0.002", "--output", "out")

COMMANDS: dict[str, tuple[tuple[str, ...], type[Any], str]] = {
    "run": (("run", "lift", *SHORT, "--no-plots"), OutputFolder, "keep"),
    "overwrite": (("run", "lift", *SHORT, "--no-plots", "--overwrite"), OutputFolder, "keep"),
    "plots": (("run", "lift", *SHORT), OutputFolder, "draw"),
    "sweep": (("sweep", "lift", "--vary", "lift.plant.motor.R_s=0.1,0.2", *SHORT), SweepFolder, "merge"),
}
"""Commands, and the method before which the folder changes."""


def remove(out: Path, mine: Path) -> None:
    out.rename(out.with_name("moved"))


def replace_by_file(out: Path, mine: Path) -> None:
    remove(out, mine)
    out.write_text(MINE)


def replace_by_link(out: Path, mine: Path) -> None:
    remove(out, mine)
    out.symlink_to(mine, target_is_directory=True)


def replace_by_folder(out: Path, mine: Path) -> None:
    remove(out, mine)
    mine.rename(out)


WAYS = (remove, replace_by_file, replace_by_link, replace_by_folder)
CASES = [(what, way) for what in COMMANDS for way in WAYS]


@pytest.mark.usefixtures("on_one_cluster")
@pytest.mark.parametrize(
    ("what", "way"), mostly_slow(CASES, [*(("run", way) for way in WAYS), ("overwrite", replace_by_folder)])
)
def test_a_folder_that_changes_while_a_command_runs(
    what: str,
    way: Callable[[Path, Path], None],
    emla: Emla,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    arguments, owner, method = COMMANDS[what]
    out, mine = tmp_path / "out", tmp_path / "mine"
    mine.mkdir()
    for name in NAMES:
        (mine / name).write_text(MINE)
    original, changed = getattr(owner, method), list[bool]()

    def changing(self: Any, *given: Any, **named: Any) -> Any:
        if not changed:
            changed.append(True)
            way(out, mine)
        return original(self, *given, **named)

    monkeypatch.setattr(owner, method, changing)
    assert sentence(emla(*arguments), 1)
    assert changed
    place = out if way is replace_by_folder else mine
    assert {p.name for p in place.iterdir()} == set(NAMES)
    assert all((place / name).read_text() == MINE for name in NAMES)
    assert way is not replace_by_file or out.read_text() == MINE
    assert way is not replace_by_link or out.is_symlink()


LONGEST = 255
"""Bytes that a name may have in most file systems."""


@pytest.mark.parametrize("suffix", [".ssp", ".json", ".c"])
def test_names_of_the_greatest_length(suffix: str, emla: Emla, tmp_path: Path) -> None:
    name = "n" * (LONGEST - len(suffix)) + suffix
    command = {
        ".ssp": ("export", "lift", name),
        ".json": ("info", "lift", "--json", name),
        ".c": ("run", "lift", *SHORT, "--no-plots", "--checkpoint", name),
    }[suffix]
    for _ in range(2):
        assert emla(*command).exit_code == 0
    assert (tmp_path / name).stat().st_size
    assert not [p.name for p in tmp_path.iterdir() if p.name.startswith(".unfinished")]
