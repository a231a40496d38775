"""Rows on disk and metrics, against the definitions worked out in full."""

import json
from pathlib import Path

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from emla_cosim.loading import load
from emla_cosim.master.stepping.timing import timing
from emla_cosim.recorders.csv_file import CsvFile, read_csv
from emla_cosim.recorders.recorder import BLOCK_ROWS, BLOCK_SIZE, Outline, Recorder, RecordingError, RowBuffer
from emla_cosim.study.metrics import JointMetrics
from tests.support.scenario_runs import run_scenario

NAMES = [
    "j.plant.x_L",
    "j.plant.v_L",
    "j.plant.tau_m",
    "j.reference.x_d",
    "j.reference.v_d",
    "j.observer.x_hat",
]
NAMES += ["j.controller.saturated"]


def outline(names: list[str], every: int = 1) -> Outline:
    """All of these signals, of every n-th row."""
    return Outline(names, [None] * len(names), timing(1.0, 0.1), range(len(names)), every)


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
def test_csv_has_every_nth_row_and_the_last_however_it_is_cut(
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


def test_csv_is_readable_by_numpy_and_starts_with_time(tmp_path: Path) -> None:
    file = CsvFile(tmp_path / "r.csv")
    file.begin(outline(["x[1]"]))
    file.write(np.array([[0.0, 1.5], [0.1, -2e-300]]))
    file.end()
    assert (tmp_path / "r.csv").read_text().splitlines()[0] == "time,x[1]"
    assert np.loadtxt(tmp_path / "r.csv", delimiter=",", skiprows=1).tolist() == [[0.0, 1.5], [0.1, -2e-300]]


def test_the_buffer_passes_everything_on_and_ends_every_recorder_even_if_one_fails() -> None:
    class Counting(Recorder):
        def __init__(self, broken: bool) -> None:
            self.rows, self.ended, self.broken = 0, False, broken

        def __str__(self) -> str:
            return "the counter"

        def write(self, rows: np.ndarray) -> None:
            self.rows += len(rows)

        def end(self) -> None:
            self.ended = True
            if self.broken:
                raise OSError(28, "No space left on device")

    recorders = [Counting(broken=True), Counting(broken=False)]
    buffer = RowBuffer(3, recorders, block_rows=4)
    for count in (3, 1, 2, 2, 2):
        assert len(buffer.room(count)) == count
        buffer.commit(count)
    with pytest.raises(RecordingError, match=r"^the counter cannot be written: No space left on device\.$"):
        buffer.end()
    assert [(r.rows, r.ended) for r in recorders] == [(10, True), (10, True)]


@pytest.mark.parametrize("width", [1, 1000, 20_000, BLOCK_SIZE // 8 + 1])
def test_rows_wait_in_so_much_memory_however_wide_they_are(width: int) -> None:
    rows = RowBuffer(width, []).room(2 * BLOCK_ROWS)
    assert len(rows) == 1 or rows.nbytes <= BLOCK_SIZE
    assert len(rows) == BLOCK_ROWS or rows.nbytes + 8 * width > BLOCK_SIZE


def metrics_by_definition(rows: np.ndarray) -> dict[str, float]:
    """The definitions, applied to the whole run at once."""
    t, x_L, v_L, tau, x_d, v_d, x_hat, saturated = rows.T
    error = np.abs(x_L - x_d)
    outside = t[error > 0.05 * error[0]] if error[0] > 1e-6 else np.array([])
    convergence = outside[-1] - t[0] if len(outside) else 0.0
    within = error[-1] <= max(0.05 * error[0], 1e-6)
    counted = t >= t[0] + max(convergence, 0.3)
    largest = {
        "position_error_m": error,
        "velocity_error_m_s": np.abs(v_L - v_d),
        "torque_effort_N_m": np.abs(tau),
        "observer_position_error_m": np.abs(x_L - x_hat),
    }
    return {
        "converged": bool(within and t[-1] - t[0] > 0.3),
        **{name: float(x[counted].max()) if counted.any() else np.nan for name, x in largest.items()},
        "torque_peak_N_m": float(np.abs(tau).max()),
        "convergence_time_s": float(convergence) if within else np.nan,
        "saturated_fraction": float(np.mean(saturated > 0)),
        "saturated_after_convergence": float(np.mean(saturated[counted] > 0)) if counted.any() else np.nan,
    }


@given(
    seed=st.integers(0, 10_000),
    offset=st.sampled_from([0.0, 1e-7, 0.01, -0.3]),
    decay=st.floats(0.5, 30.0),
    count=st.integers(2, 120),
    sizes=st.lists(st.integers(1, 40), min_size=1, max_size=4),
)
def test_metrics_are_those_of_the_definition_however_rows_come(
    seed: int, offset: float, decay: float, count: int, sizes: list[int]
) -> None:
    random = np.random.default_rng(seed)
    t = np.arange(count) * 0.01
    rows = np.column_stack([t, random.normal(size=(count, 7)) * 1e-3])
    rows[:, 1] = rows[:, 4] + offset * np.exp(-decay * t) + rows[:, 1] * abs(offset)
    rows[0, 1] = rows[0, 4] + offset
    rows[:, 7] = random.integers(0, 2, size=count)
    metrics = JointMetrics([*NAMES, "elsewhere.plant.x_L"])
    for block in in_blocks(np.column_stack([rows, t]), sizes):
        metrics.write(block)
    (found,) = (dict(figures) for figures in metrics.figures().values())
    assert found.pop("left_limits") is None  # nobody gave any
    expected = metrics_by_definition(rows)
    assert found == pytest.approx(expected, rel=1e-12, abs=1e-15, nan_ok=True)


def test_metrics_of_a_known_decay() -> None:
    """An error of exp(-10 t) mm leaves its 5 % band for the last time just before ln(20)/10 s."""
    t = np.linspace(0.0, 1.0, 10_001)
    error = 1e-3 * np.exp(-10 * t)
    rows = np.column_stack([t, error, np.zeros((len(t), 6))])
    metrics = JointMetrics(NAMES)
    metrics.write(rows)
    found = metrics.figures()["j"]
    assert found["convergence_time_s"] == pytest.approx(np.log(20) / 10, abs=1e-4)
    assert found["position_error_m"] == pytest.approx(1e-3 * np.exp(-3.0), rel=1e-3)


def test_what_does_not_exist_is_null_in_json(fmu_folder: Path, tmp_path: Path) -> None:
    """Errors count from 0.3 s on; JSON has no NaN."""
    run_scenario(load("lift"), tmp_path, fmus=fmu_folder, stop_time=0.01)
    metrics = json.loads((tmp_path / "metrics.json").read_text(), parse_constant=pytest.fail)
    assert metrics["joints"]["lift"]["position_error_m"] is None
