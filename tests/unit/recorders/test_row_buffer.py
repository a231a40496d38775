"""The ring of rows that outlives the process has every row that a table has not stored."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emla_cosim.base import crash_page
from emla_cosim.base.files import UNFINISHED, remove_unfinished
from emla_cosim.base.units import LinearTransformation
from emla_cosim.recorders import row_buffer
from emla_cosim.recorders.recorder import Recorder
from emla_cosim.recorders.row_buffer import RowBuffer, RowFile, read_rows
from tests.support.full_disk import files_of_at_most

WIDTH, BLOCK = 2, 4


class SlowTable(Recorder):
    """Stores rows only if it must, and then as few as it may."""

    def __init__(self, random: np.random.Generator, is_shown: bool) -> None:
        self.received: list[float] = []
        self.stored = 0
        self._random, self._is_shown = random, is_shown

    def write(self, rows: np.ndarray) -> None:
        self.received.extend(rows[:, 1] - 5.0 * self._is_shown)

    def release(self, most: int) -> None:
        least = max(self.stored, len(self.received) - most)
        self.stored = int(self._random.integers(least, len(self.received) + 1))


@pytest.fixture(autouse=True)
def small_ring(monkeypatch: pytest.MonkeyPatch) -> None:
    """Rings of four blocks."""
    monkeypatch.setattr(row_buffer, "RING_SIZE", 0)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("is_shown", [False, True])
def test_another_process_finds_all_rows_that_are_not_stored(
    seed: int, is_shown: bool, tmp_path: Path
) -> None:
    """At any instant, and also rows that compiled code has counted, but Python has not seen."""
    random = np.random.default_rng(seed)
    table, files = SlowTable(random, is_shown), list[RowFile]()
    transformations = {0: LinearTransformation(1.0, 5.0)} if is_shown else {}

    def map_rows(size: int) -> Any:
        files.append(RowFile(tmp_path, size))
        return files[-1].memory

    buffer = RowBuffer(WIDTH, [table], block_rows=BLOCK, transformations=transformations, map_rows=map_rows)
    count, activity = 0, crash_page.current_activity()
    for _ in range(100):
        rows = buffer.room(int(random.integers(1, 2 * BLOCK)))
        for row in rows:
            row[:] = count
            count += 1
            activity.rows += 1
            first, actual = read_rows(files[0].path, WIDTH, activity.rows)
            assert first <= table.stored and first + len(actual) == count
            assert actual[:, 0].tolist() == actual[:, 1].tolist() == list(range(first, count))
        buffer.commit(len(rows))
        assert activity.rows == count
        if random.random() < 0.2:
            buffer.flush()
    buffer.end()
    assert table.received == list(range(count))


def test_rows_that_are_not_committed_do_not_count(tmp_path: Path) -> None:
    """An exception of Python ends compiled code: nothing shows in which of its rows it was left."""
    file = RowFile(tmp_path, 8 * WIDTH * BLOCK * 4)
    buffer = RowBuffer(WIDTH, [], block_rows=BLOCK, map_rows=lambda size: file.memory)
    activity = crash_page.current_activity()
    buffer.room(1)[:] = 0.0
    activity.rows += 1
    buffer.commit(1)
    activity.rows += 2
    buffer.end()
    assert activity.rows == 1


@pytest.mark.skipif(os.name == "nt", reason="Only supervised runs have such files; Windows keeps open ones.")
def test_file_is_a_leftover_after_a_kill(tmp_path: Path) -> None:
    file = RowFile(tmp_path, 100)
    (tmp_path / "mine").touch()
    assert file.path.name.startswith(UNFINISHED) and file.path.stat().st_size == 100
    remove_unfinished(tmp_path)
    file.memory[:3] = b"row"  # of a process that still runs
    file.remove()
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]


def test_full_disk_leaves_no_file(tmp_path: Path) -> None:
    with files_of_at_most(1000), pytest.raises(OSError, match="File too large"):
        RowFile(tmp_path, 2000)
    assert not any(tmp_path.iterdir())
