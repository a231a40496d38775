"""Tables in Parquet: parts on disk during a run, and files of others are not changed."""

import os
import stat
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest

import fmublock.files
from emla_cosim.master.stepping.timing import make_communication_points
from emla_cosim.recorders.parquet_file import ParquetFile
from emla_cosim.recorders.recorder import RunLayout
from tests.support.commands import Emla, sentence
from tests.support.full_disk import files_of_at_most

RUN = ("run", "lift", "--stop-time", "0.01", "--no-plots", "--output-format", "parquet", "--output", "o")


def begun(folder: Path) -> ParquetFile:
    """A table of two signals that has taken 20 rows."""
    file = ParquetFile(folder / "results.parquet")
    file.begin(RunLayout(["a", "b"], [None, None], make_communication_points(50.0, 1.0), range(2)))
    file.write(np.random.default_rng(1).normal(size=(20, 3)))
    return file


def test_files_of_others_are_not_changed(emla: Emla, tmp_path: Path) -> None:
    assert emla(*RUN).exit_code == 0
    parts = tmp_path / "o" / "results.parquet.parts"
    parts.mkdir()
    (parts / "thesis.txt").write_text("years of work")
    (parts / "000000.parquet").write_text("a part")
    text = sentence(emla(*RUN), 2)
    assert f"no run wrote 'thesis.txt' in the folder '{parts}'; move it away" in text
    assert (parts / "thesis.txt").read_text() == "years of work"
    assert (parts / "000000.parquet").read_text() == "a part"
    (parts / "thesis.txt").unlink()
    (parts / "000001.parquet").mkdir()
    assert "no run wrote '000001.parquet' in the folder" in sentence(emla(*RUN), 2)
    assert parts.is_dir()


def test_leftovers_of_a_killed_run_are_removed(emla: Emla, tmp_path: Path) -> None:
    parts = tmp_path / "o" / "results.parquet.parts"
    parts.mkdir(parents=True)
    (tmp_path / "o" / "run.json").write_text('{"scenario": "lift", "status": "unfinished"}')
    for name in ("000000.parquet", "000001.parquet", ".unfinished-12-345-0123abcd-ab_3z"):
        (parts / name).write_text("left")
    assert emla(*RUN).exit_code == 0
    assert not parts.exists()
    assert len(polars.read_parquet(tmp_path / "o" / "results.parquet")) == 11


def test_files_are_synced_before_they_are_renamed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: set[int] = set()
    renamed: list[str] = []
    sync, replace = os.fsync, Path.replace

    def fsync(handle: int) -> None:
        sync(handle)
        assert os.fstat(handle).st_size > 0
        synced.add(os.fstat(handle).st_ino)

    def replaced(path: Path, target: Any) -> Path:
        assert path.stat().st_ino in synced, f"{target} is not on disk"
        renamed.append(Path(target).name)
        return replace(path, target)

    monkeypatch.setattr(fmublock.files.os, "fsync", fsync)
    monkeypatch.setattr(Path, "replace", replaced)
    file = begun(tmp_path)
    file.end()
    assert list(renamed) == ["000000.parquet", "results.parquet"]
    assert len(polars.read_parquet(tmp_path / "results.parquet")) == 20
    assert {p.name for p in tmp_path.iterdir()} == {"results.parquet"}
    assert stat.S_IMODE((tmp_path / "results.parquet").stat().st_mode) & 0o400


def test_full_disk_keeps_the_parts(tmp_path: Path) -> None:
    file = begun(tmp_path)
    file.state_dict()  # closes a part
    parts = {p.name: p.read_bytes() for p in (tmp_path / "results.parquet.parts").iterdir()}
    assert set(parts) == {"000000.parquet"}
    with files_of_at_most(100):
        with pytest.raises(OSError, match="File too large"):
            file.end()
        file.write(np.zeros((20, 3)))
        with pytest.raises(OSError, match="File too large"):
            file.state_dict()
    remaining_parts = {p.name: p.read_bytes() for p in (tmp_path / "results.parquet.parts").iterdir()}
    assert remaining_parts == parts
    assert {p.name for p in tmp_path.iterdir()} == {"results.parquet.parts"}
