"""The thread that stores rows stores all of them, once and in order, also when something fails."""

import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest

import emla_cosim as ec
from emla_cosim.master.stepping.timing import make_communication_points
from emla_cosim.recorders import file_table
from emla_cosim.recorders.csv_file import CsvFile
from emla_cosim.recorders.file_table import FileTable
from emla_cosim.recorders.parquet_file import ParquetFile
from emla_cosim.recorders.recorder import RunLayout
from tests.support.full_disk import files_of_at_most

WIDTH, BLOCK = 3, 8


@pytest.fixture(autouse=True)
def small_buffers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Room for 16 rows that wait."""
    monkeypatch.setattr(file_table, "_MOST_VALUES", 16 * WIDTH)


class SlowTable(FileTable):
    """Stores rows as a slow disk does, up to a number of calls at which it fails."""

    batch_rows, batch_seconds = 4, 0.2

    def __init__(self, fails_at: int | None = None) -> None:
        super().__init__("slow.table")
        self.rows, self.calls, self.threads = list[float](), 0, set[str]()
        self._fails_at = fails_at
        self.begin(make_run_layout())

    def store(self, rows: np.ndarray) -> None:
        self.calls += 1
        self.threads.add(threading.current_thread().name)
        if self.calls == self._fails_at:
            raise OSError(28, "No space left on device")
        time.sleep(0.0005)
        assert (rows == rows[:, :1]).all()  # no row is overwritten before it is stored
        self.rows.extend(rows[:, 0])

    def count_stored(self) -> int:
        return len(self.rows)

    def is_ours(self, path: Path) -> bool:
        raise NotImplementedError

    def reopen(self, layout: RunLayout, rows: int) -> None:
        raise NotImplementedError

    def blocks(self) -> Iterator[np.ndarray]:
        raise NotImplementedError

    def read(self, names: Sequence[str], most: int | None = None) -> dict[str, np.ndarray]:
        raise NotImplementedError


def numbered(first: int, count: int) -> np.ndarray:
    return np.repeat(np.arange(first, first + count, dtype=float)[:, None], WIDTH, axis=1)


@pytest.mark.parametrize("fails_at", [1, 5])
def test_failure_is_raised_by_all_later_calls(fails_at: int) -> None:
    table, raised = SlowTable(fails_at), list[int]()
    for n in range(20):
        try:
            table.write(numbered(5 * n, 5))
        except OSError:
            raised.append(n)
    assert raised == list(range(20 - len(raised), 20)), "a later call hides the failure"
    with pytest.raises(OSError, match="No space left on device"):
        table.end()
    assert table.calls == fails_at
    assert table.rows == list(range(len(table.rows)))


def test_rows_are_stored_without_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", refuse)
    table = SlowTable()
    for n in range(10):
        table.write(numbered(7 * n, 7))
    table.end()
    assert table.rows == list(range(70))


@pytest.mark.parametrize("seed", range(2))
def test_all_rows_are_stored_in_order(seed: int) -> None:
    random, table, count = np.random.default_rng(seed), SlowTable(), 0
    sizes = [*random.integers(1, BLOCK + 1, size=80), 2 * BLOCK + 3, 40]  # also more than fits
    for size in sizes:
        if random.random() < 0.1:
            table.drain()
            assert len(table.rows) == count
        rows = numbered(count, size)
        count += size
        table.write(rows)
        rows[:] = np.nan  # the rows of a run are reused
        most = int(random.integers(0, 30))
        table.release(most)
        assert len(table.rows) >= count - most, "rows that must be on the disk are not"
    table.end()
    assert table.rows == list(range(count))
    assert table.threads - {threading.current_thread().name}


def make_run_layout(steps_per_row: int = 1) -> RunLayout:
    return RunLayout(
        ["a", "b"],
        [None, None],
        make_communication_points(1000.0, 1.0),
        range(2),
        steps_per_row=steps_per_row,
    )


def random_rows(count: int) -> np.ndarray:
    rows = np.random.default_rng(2).normal(size=(count, 3))
    rows[:, 0] = np.arange(count)
    return rows


def test_checkpoint_waits_for_rows_on_the_disk(tmp_path: Path) -> None:
    """A run that continues there leaves the same file, however slow the disk is."""
    rows, actual, steps_per_row = random_rows(100), [], 3
    for cuts in ([], [10, 50], [7, 8, 9, 64]):
        path = tmp_path / f"{len(actual)}.csv"
        file: Any = CsvFile(path)
        layout = make_run_layout(steps_per_row)
        file.begin(layout)
        for block, following in zip(np.split(rows, cuts), [*cuts, None], strict=True):
            file.write(block)
            if following is None:
                break
            state = file.state_dict()
            assert path.stat().st_size == state["bytes"]
            assert len(polars.read_csv(path)) == -(-following // steps_per_row)
            with path.open("ab") as stream:
                stream.write(b"rows after the checkpoint\n")
            file = CsvFile(path)
            file.begin(layout, state)
        assert file.read(["b"])["b"][0] == rows[0, 2]  # also rows that wait
        file.end()
        actual.append(path.read_bytes())
    assert actual[0] == actual[1] == actual[2]


@pytest.mark.parametrize(("kind", "name"), [(CsvFile, "r.csv"), (ParquetFile, "r.parquet")])
def test_thread_changes_no_byte(
    kind: Any, name: str, fmu_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with ec.load("lift", stop_time=0.2, fmus=fmu_folder).prepare() as simulation:
        simulation.run(recorders=[kind(tmp_path / name)])
        monkeypatch.setattr(kind, "append", kind.store)
        simulation.run(recorders=[kind(tmp_path / f"direct.{name}")], fresh=True)
    assert (tmp_path / name).read_bytes() == (tmp_path / f"direct.{name}").read_bytes()


def test_full_disk_ends_a_run_with_the_rows_that_fit(fmu_folder: Path, tmp_path: Path) -> None:
    """The error message is that of the file, and the rows are the first ones of a whole run."""
    size = 20_000
    with ec.load("lift", stop_time=0.2, fmus=fmu_folder).prepare() as simulation:
        simulation.run(recorders=[CsvFile(tmp_path / "whole.csv")])
        with files_of_at_most(size):
            result = simulation.attempt(recorders=[CsvFile(tmp_path / "r.csv")], fresh=True)
    assert result.problem is not None
    assert result.problem.endswith("r.csv cannot be written: File too large.")
    full_table, stored_rows = (tmp_path / "whole.csv").read_bytes(), (tmp_path / "r.csv").read_bytes()
    assert full_table.startswith(stored_rows)
    assert stored_rows.endswith(b"\n") and size - 2000 < len(stored_rows) <= size
