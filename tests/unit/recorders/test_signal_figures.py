"""Minimum, maximum, rms and final value of every signal, against NumPy on all rows."""

import json
from collections.abc import Sequence
from pathlib import Path

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

import emla_cosim as ec
from emla_cosim.master.stepping.timing import make_communication_points
from emla_cosim.recorders.metrics import NAMES, SignalFigures
from emla_cosim.recorders.recorder import RunLayout
from tests.support.axis import axis
from tests.support.commands import Emla, sentence

ANY = st.floats(allow_nan=True, allow_infinity=True, width=64)
FIGURES = {"minimum": np.min, "maximum": np.max, "final": lambda values: values[-1]}


def make_layout(count: int, recorded: Sequence[int]) -> RunLayout:
    return RunLayout(
        [f"a.x{i}" for i in range(count)], [None] * count, make_communication_points(1.0, 0.1), recorded
    )


def compute_metrics(
    rows: np.ndarray, sizes: Sequence[int], recorded: Sequence[int]
) -> dict[str, dict[str, float]]:
    """The metrics of rows that come in blocks of these sizes, each to another object that continues."""
    about = make_layout(rows.shape[1] - 1, recorded)
    state, at = None, 0
    for size in (*sizes, len(rows)):
        recorder = SignalFigures(about, state)
        if at < len(rows):
            recorder.write(rows[at : at + size])
        at += size
        state = json.loads(json.dumps(recorder.state_dict()))
    return SignalFigures(about, state).figures()


def rms(values: np.ndarray) -> float:
    """The root mean square of scaled values: on some systems no number format has a wider exponent."""
    largest = np.abs(values).max()
    scale = 2.0**-600 if largest > 1e150 else 2.0**600 if largest < 1e-150 else 1.0
    scaled = scale * values
    return float(np.sqrt(np.mean(scaled * scaled)) / scale)


@given(data=st.data(), signals=st.integers(1, 4), sizes=st.lists(st.integers(1, 40), max_size=4))
def test_metrics_equal_those_of_numpy(data: st.DataObject, signals: int, sizes: list[int]) -> None:
    numbers = data.draw(st.sampled_from((ANY, st.floats(-1e3, 1e3), st.floats(1e300, 1.7e308))))
    row = st.lists(numbers, min_size=signals, max_size=signals)
    values = np.array(data.draw(st.lists(row, min_size=1, max_size=60)))
    rows = np.column_stack((np.arange(len(values)) * 0.1, values))
    recorded = sorted(data.draw(st.sets(st.integers(0, signals - 1), min_size=1)))
    actual = compute_metrics(rows, sizes, recorded)
    assert list(actual) == [f"a.x{i}" for i in recorded]
    for i in recorded:
        figures = actual[f"a.x{i}"]
        for name, right in FIGURES.items():
            np.testing.assert_equal(figures[name], right(values[:, i]))
        with np.errstate(all="ignore"):
            np.testing.assert_allclose(figures["rms"], rms(values[:, i]), rtol=1e-12, atol=0)


@pytest.mark.parametrize("signals", [1, 30, 999, 1500])
def test_rows_of_any_width_count_once(signals: int) -> None:
    rows = np.random.default_rng(signals).normal(size=(217, 1 + signals))
    actual = compute_metrics(rows, [100], range(signals))
    for i in (0, signals - 1):
        assert actual[f"a.x{i}"]["rms"] == pytest.approx(rms(rows[:, 1 + i]), rel=1e-13)
        assert actual[f"a.x{i}"]["minimum"] == rows[:, 1 + i].min()


def test_metrics_are_nan_before_the_first_row() -> None:
    figures = SignalFigures(make_layout(2, [1])).figures()
    assert list(figures) == ["a.x1"] and np.isnan([figures["a.x1"][name] for name in NAMES]).all()


def test_metrics_use_every_communication_point(fmu_folder: Path, tmp_path: Path) -> None:
    with ec.load("lift").prepare(fmus=fmu_folder, stop_time=0.05, output_interval=0.01) as simulation:
        sparse_run = simulation.run(output_interval=1e-4)
        result = simulation.run(signals=["lift.plant.*"], require=["lift.plant.x_L.maximum < 0.25"])
        with pytest.raises(ec.RunError, match=r"lift.plant.x_L.maximum < 0.24, but it is 0.24"):
            simulation.run(require=["lift.plant.x_L.maximum < 0.24"])
        with pytest.raises(ec.CommandError, match=r"did you mean lift.plant.x_L.maximum"):
            simulation.run(require=["lift.plant.x_L.maxmum < 0.24"])
    assert list(result.signals) == result.names and len(result.time) == 6
    for name, figures in result.signals.items():
        values = sparse_run[name]
        right = (values.min(), values.max(), rms(values), values[-1])
        assert [figures[n] for n in NAMES] == pytest.approx(right, rel=1e-12, abs=0), name
    result.save(tmp_path, plots=False)
    content = json.loads((tmp_path / "metrics.json").read_text())
    assert content["signals"] == result.signals and list(content) == ["joints", "coupling", "signals", "run"]


@pytest.fixture(scope="module")
def package(fmu_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return axis(tmp_path_factory.mktemp("axis"), fmu_folder)


def test_system_without_joints_shows_signal_metrics(package: Path, emla: Emla) -> None:
    requirement = ("--require", "gantry.slide.place.final > 0")
    result = emla("run", str(package), "--no-plots", "--output", "o", *requirement)
    assert result.exit_code == 0, result.output
    figures = json.loads(Path("o/metrics.json").read_text())["signals"]["gantry.slide.pull"]
    output = next(line for line in result.stdout.splitlines() if "gantry.slide.pull" in line)
    assert [text.strip() for text in output.strip("│").split("│")] == [
        "gantry.slide.pull",
        *(f"{figures[name]:.5g}" for name in NAMES),
        "N",
    ]
    text = sentence(emla("run", str(package), "--require", "gantry.slide.place.peak>0"), 2)
    assert "there is no metric 'gantry.slide.place.peak' to require" in text


def test_first_of_many_signals_are_shown(emla: Emla, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(ec.METRICS, "joints")
    output = emla("run", "lift", "--stop-time", "0.01", "--no-plots", "--output", "o").stdout
    names = list(json.loads(Path("o/metrics.json").read_text())["signals"])
    assert names[19] in output and names[20] not in output
    assert f"The metrics of {len(names) - 20} more signals are in metrics.json." in output
