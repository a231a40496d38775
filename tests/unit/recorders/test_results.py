"""Rows in files and in the buffer: every n-th row, all bits, and all rows of a process that ended."""

from pathlib import Path

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from emla_cosim.master.stepping.timing import make_communication_points
from emla_cosim.recorders.csv_file import CsvFile, read_csv
from emla_cosim.recorders.parquet_file import ParquetFile
from emla_cosim.recorders.recorder import BLOCK_ROWS, BLOCK_SIZE, Outline, Recorder, RowBuffer
from emla_cosim.recorders.stored import open_stored_run
from emla_cosim.sandbox import black_box


def outline(names: list[str], every: int = 1) -> Outline:
    """All of these signals, of every n-th row."""
    return Outline(names, [None] * len(names), make_communication_points(1.0, 0.1), range(len(names)), every)


def in_blocks(rows: np.ndarray, sizes: list[int]) -> list[np.ndarray]:
    """The rows cut into blocks of these sizes, over and over."""
    blocks, start, i = [], 0, 0
    while start < len(rows):
        blocks.append(rows[start : start + sizes[i % len(sizes)]])
        start += sizes[i % len(sizes)]
        i += 1
    return blocks


@given(
    count=st.integers(1, 200),
    every=st.integers(1, 30),
    sizes=st.lists(st.integers(1, 50), min_size=1, max_size=5),
)
def test_csv_has_every_nth_row_and_the_last_for_any_blocks(
    count: int, every: int, sizes: list[int], tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("csv") / "results.csv"
    rows = np.random.default_rng(count).normal(size=(count, 3)) * 10.0 ** np.arange(-200, 201, 200)
    rows[:, 0] = np.arange(count)
    file = CsvFile(path)
    file.begin(outline(["a.b", "c"], every))
    for block in in_blocks(rows, sizes):
        file.write(block)
    file.end()
    expected = rows[sorted({*range(0, count, every), count - 1})]
    found = read_csv(path, ["time", "a.b", "c", "missing"])
    assert list(found) == ["time", "a.b", "c"]
    assert np.array_equal(np.column_stack(list(found.values())), expected)  # every bit comes back


@pytest.mark.parametrize("most", [1, 2, 10])
@pytest.mark.parametrize("form", [CsvFile, ParquetFile])
def test_number_of_rows_read_is_bounded(form: type[CsvFile | ParquetFile], most: int, tmp_path: Path) -> None:
    """And at least half as many, if there are: from the run itself, and from its file."""
    for count in (1, most, most + 1, 2 * most - 1, 2 * most, 2 * most + 1, 7 * most + 3):
        table = form(tmp_path / f"r{count}.{form.__name__[:-4].lower()}")
        time = 0.5 + np.arange(count)
        table.begin(outline(["x"]))
        for rows in in_blocks(np.column_stack([time, 2.0 * time]), [4, 7]):
            table.write(rows)
        table.end()
        for source in (table, open_stored_run(table.path)):
            found = source.read(["time", "x"], most)
            assert min(count, most) / 2 <= len(found["time"]) <= most, count
            assert found["time"][0] == 0.5 and (found["x"] == 2.0 * found["time"]).all()
            assert len(set(np.diff(found["time"]))) <= 1


@pytest.mark.parametrize("pending", [0, 1, 3])
@pytest.mark.parametrize("committed", [0, 3, 4, 13])
def test_rows_of_an_ended_process_are_recovered(
    committed: int, pending: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whether it ended before a block was full, just then, or in the rows after it."""
    memory = bytearray(2**24 + 2**12)
    monkeypatch.setattr(black_box._Box, "memory", memory)
    monkeypatch.setattr(black_box._Box, "presents", black_box._map_activities(memory))
    rows = list[float]()

    class Taking(Recorder):
        def write(self, block: np.ndarray) -> None:
            rows.extend(block[:, 0])

    survivor, ended = (RowBuffer(2, [Taking()], block_rows=4) for _ in range(2))
    for row in range(committed):
        ended.room(1)[:] = row
        ended.commit(1)
    pending = min(pending, len(ended.room(4)))
    ended.room(pending)[:, 0] = committed + np.arange(pending)
    black_box.current_activity().recorded = pending  # as compiled code says it
    last = survivor.recover()
    assert last == (committed + pending - 1 if pending or committed % 4 else None)
    survivor.end()
    assert rows == list(range(committed + pending))


@pytest.mark.parametrize("width", [1, 1000, 20_000, BLOCK_SIZE // 8 + 1])
def test_size_of_a_block_is_bounded(width: int) -> None:
    rows = RowBuffer(width, []).room(2 * BLOCK_ROWS)
    assert len(rows) == 1 or rows.nbytes <= BLOCK_SIZE
    assert len(rows) == BLOCK_ROWS or rows.nbytes + 8 * width > BLOCK_SIZE
