"""Rows in files and in the buffer: every n-th row, and all bits."""

from pathlib import Path

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from emla_cosim.inputs.stored_runs import open_stored_run
from emla_cosim.master.stepping.timing import make_communication_points
from emla_cosim.recorders.csv_file import CsvFile
from emla_cosim.recorders.parquet_file import ParquetFile
from emla_cosim.recorders.recorder import RunLayout
from emla_cosim.recorders.row_buffer import BLOCK_ROWS, BLOCK_SIZE, RowBuffer


def make_run_layout(names: list[str], steps_per_row: int = 1) -> RunLayout:
    """All of these signals, of every n-th row."""
    return RunLayout(
        names, [None] * len(names), make_communication_points(1.0, 0.1), range(len(names)), steps_per_row
    )


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
    stride=st.integers(1, 30),
    sizes=st.lists(st.integers(1, 50), min_size=1, max_size=5),
)
def test_csv_has_every_nth_row_and_the_last_for_any_blocks(
    count: int, stride: int, sizes: list[int], tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("csv") / "results.csv"
    rows = np.random.default_rng(count).normal(size=(count, 3)) * 10.0 ** np.arange(-200, 201, 200)
    rows[:, 0] = np.arange(count)
    file = CsvFile(path)
    file.begin(make_run_layout(["a.b", "c"], stride))
    for block in in_blocks(rows, sizes):
        file.write(block)
    file.end()
    expected = rows[sorted({*range(0, count, stride), count - 1})]
    actual = open_stored_run(path).read(["time", "a.b", "c", "missing"])
    assert list(actual) == ["time", "a.b", "c"]
    assert np.array_equal(np.column_stack(list(actual.values())), expected)  # every bit comes back


@pytest.mark.parametrize("most", [1, 2, 10])
@pytest.mark.parametrize("form", [CsvFile, ParquetFile])
def test_number_of_rows_read_is_at_most_the_requested_one(
    form: type[CsvFile | ParquetFile], most: int, tmp_path: Path
) -> None:
    """And at least half as many, if there are: from the run itself, and from its file."""
    for count in (1, most, most + 1, 2 * most - 1, 2 * most, 2 * most + 1, 7 * most + 3):
        table = form(tmp_path / f"r{count}.{form.__name__[:-4].lower()}")
        time = 0.5 + np.arange(count)
        table.begin(make_run_layout(["x"]))
        for rows in in_blocks(np.column_stack([time, 2.0 * time]), [4, 7]):
            table.write(rows)
        table.end()
        for source in (table, open_stored_run(table.path)):
            actual = source.read(["time", "x"], most)
            assert min(count, most) / 2 <= len(actual["time"]) <= most, count
            assert actual["time"][0] == 0.5 and (actual["x"] == 2.0 * actual["time"]).all()
            assert len(set(np.diff(actual["time"]))) <= 1


@pytest.mark.parametrize("width", [1, 1000, 20_000, BLOCK_SIZE // 8 + 1])
def test_size_of_a_block_is_bounded(width: int) -> None:
    rows = RowBuffer(width, []).room(2 * BLOCK_ROWS)
    assert len(rows) == 1 or rows.nbytes <= BLOCK_SIZE
    assert len(rows) == BLOCK_ROWS or rows.nbytes + 8 * width > BLOCK_SIZE
