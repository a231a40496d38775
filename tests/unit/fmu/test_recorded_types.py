"""Outputs and locals of all types in tables, compared with closed forms and with FMPy."""

import json
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import polars
import pytest

import emla_cosim as ec
from emla_cosim.base.errors import CommandError, RunError
from emla_cosim.inputs.stored_runs import open_stored_run
from tests.support.hand_written_fmus import build_all_types_fmu
from tests.support.tiers import mostly_slow

NOTE = 'a "quote", a comma,\na line, é'
EVERYTHING = ("a.*", "a.half", "a.twice", "a.odd", "a.text", "a.note", "a.reads", "a.first")


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("all_types")
    return build_all_types_fmu(folder / "AllTypes.fmu")


def prepare(fmu: Path, **options: Any) -> ec.Simulation:
    """Two instances of which only the first is recorded, so that rows have other signals too."""
    first = options.pop("first", 3)
    system = ec.System.of({"a": fmu, "b": fmu}, set={"a.first": first, "b.u": -1.0})
    defaults = {"step_size": 0.01, "stop_time": 0.5, "output_interval": 0.02, "signals": EVERYTHING}
    return ec.load(system, **{**defaults, **options}).prepare()


def expected(time: np.ndarray, first: int = 3, u: float = 1.0, start: float = 0.0) -> dict[str, Any]:
    """What the C file says, at these times."""
    x, count = u * (time - start), first + np.floor(time / 0.1 + 1e-6).astype(int)
    texts = [f"count is {n}, {'high' if y > 0.25 else 'low'}" for n, y in zip(count, x, strict=True)]
    return {
        "a.x": x,
        "a.half": x / 2,
        "a.count": count,
        "a.twice": 2 * count,
        "a.first": np.full(len(time), first),
        "a.mode": np.where(x < 0.2, 1, np.where(x < 0.4, 2, 4)),
        "a.high": x > 0.25,
        "a.odd": count % 2 == 1,
        "a.text": np.array(texts, dtype=object),
        "a.note": np.full(len(time), NOTE, dtype=object),
    }


def check(result: ec.Result, first: int = 3, **more: float) -> None:
    """Compare all columns, except where a sum of steps is within rounding of a threshold."""
    away = np.ones(len(result.time), dtype=bool)
    for edge in (0.2, 0.25, 0.4):
        away &= np.abs(result["a.x"] - edge) > 1e-9
    for name, values in expected(result.time, first, **more).items():
        actual = result[name]
        if values.dtype == float:
            np.testing.assert_allclose(actual, values, atol=1e-12, err_msg=name)
        else:
            assert actual[away].tolist() == values[away].tolist(), name
            assert actual.dtype == {"i": np.int32, "b": np.bool_, "O": object}[values.dtype.kind], name


WAYS = {
    "compiled": {},
    "threads": {"threads": 2},
    "isolated": {"isolate": ["a"]},
    "strong": {"algorithm": "strong"},
    "error control": {"error_tolerance": 1e-3},
}


@pytest.mark.parametrize("way", mostly_slow(WAYS, ["compiled", "strong", "error control"]))
def test_all_types_are_recorded_by_every_stepper(fmu: Path, way: str) -> None:
    with prepare(fmu, **WAYS[way]) as simulation:
        for first in (3, 4):  # the second run resets the FMUs
            result = simulation.run(set={"a.first": first})
            assert len(result.time) == 26
            check(result, first)
        assert result.names[:5] == [f"a.{n}" for n in ("x", "count", "mode", "high", "half")]
        # texts were read at the 26 rows of the table, not at all 51 points; reading counts the calls before
        assert result["a.reads"][-1] == 2 * 25


def test_resumed_run_has_the_same_table(fmu: Path, tmp_path: Path) -> None:
    path, file = tmp_path / "half.checkpoint", tmp_path / "rows.csv"
    signals = tuple(n for n in EVERYTHING if n != "a.reads")
    with prepare(fmu, start_time=0.1, signals=signals) as simulation:
        simulation.run(stop_time=0.3, checkpoint=path, recorders=[ec.CsvFile(file)])
        resumed = simulation.run(resume=path, recorders=[ec.CsvFile(file)])
        check(simulation.run(), start=0.1)
        full_table = tmp_path / "whole.csv"
        simulation.run(recorders=[ec.CsvFile(full_table)])
    assert file.read_bytes() == full_table.read_bytes()
    assert resumed.signals["a.count"]["minimum"] == 4.0


def test_outputs_but_no_texts_and_no_locals_are_recorded_by_default(fmu: Path) -> None:
    with prepare(fmu, signals=()) as simulation:
        result = simulation.run()
        with pytest.raises(CommandError, match=r"did you mean a\.half"):
            simulation.run(signals=["a.hlf"])
    names = [f"{c}.{n}" for c in "ab" for n in ("count", "mode", "high")]
    assert result.names == simulation.names == ["a.x", "b.x", *names]
    assert result.signals["a.high"]["maximum"] == 1.0


def test_fmpy_has_the_same_values(fmu: Path) -> None:
    names = ["x", "count", "mode", "high", "half", "odd"]
    fmpy_result = fmpy.simulate_fmu(
        str(fmu), stop_time=0.5, step_size=0.01, output_interval=0.01, output=names, fmi_type="CoSimulation"
    )
    system = ec.System.of({"a": fmu})
    with ec.load(
        system, step_size=0.01, stop_time=0.5, output_interval=0.01, signals=[f"a.{n}" for n in names]
    ).prepare() as simulation:
        ours = simulation.run()
    np.testing.assert_allclose(ours.time, fmpy_result["time"], atol=1e-12)
    away = np.abs(ours["a.x"][:, None] - [0.2, 0.25, 0.4]).min(axis=1) > 1e-9
    for name in names:
        assert np.allclose(ours[f"a.{name}"][away], fmpy_result[name][away], atol=1e-12), name


def test_tables_have_types(fmu: Path, tmp_path: Path) -> None:
    files = tmp_path / "rows.csv", tmp_path / "rows.parquet"
    with prepare(fmu) as simulation:
        check(simulation.run(recorders=[ec.ParquetFile(files[1])]))
        result = simulation.run(recorders=[ec.CsvFile(files[0])])
    assert result["a.note"][0] == NOTE.replace("\n", "\\n")
    text = files[0].read_text(encoding="utf-8").splitlines()
    assert len(text) == 27
    row = dict(zip(text[0].split(","), text[16].split(","), strict=False))
    assert (row["time"], row["a.count"], row["a.mode"], row["a.high"]) == ("0.3", "6", "2", "1")
    frame = polars.read_parquet(files[1])
    types = {n: str(t) for n, t in frame.schema.items()}
    assert types["a.x"] == types["a.half"] == "Float64"
    assert types["a.count"] == types["a.mode"] == "Int32"
    assert (types["a.high"], types["a.text"]) == ("Boolean", "String")
    declared = json.loads(polars.read_parquet_metadata(files[1])["types"])
    assert declared["a.mode"] == {
        "type": "Enumeration",
        "items": {"1": "off", "2": "low & slow", "4": "high"},
    }
    assert frame["a.note"][3] == NOTE
    assert result.to_polars().schema["a.odd"] == polars.Boolean
    for file in files:
        stored = open_stored_run(file)
        actual = stored.read(["time", "a.count", "a.text"])
        assert actual["a.count"].tolist() == expected(actual["time"])["a.count"].tolist()
        assert actual["a.text"][0] == "count is 3, low"
        assert len(stored.read(["a.text"], 5)["a.text"]) <= 7
        outside = {
            comparison.signal
            for comparison in result.compare(file, {"*": 0.0})
            if comparison.left_at is not None
        }
        assert outside <= {
            "a.reads",
            "a.note",
        }  # the calls of two runs, and a line break in CSV and in Parquet


def test_a_saved_result_has_types_and_can_be_plotted(fmu: Path, tmp_path: Path) -> None:
    with prepare(fmu) as simulation:
        result = simulation.run()
    pictures = result.save(tmp_path / "kept", plots=False)
    record = json.loads((tmp_path / "kept" / "run.json").read_text(encoding="utf-8"))
    assert not pictures
    assert record["types"]["a.high"] == {"type": "Boolean"}
    axes = result.plot("a.mode", "a.high").axes
    assert [label.get_text() for label in axes[0].get_yticklabels()] == ["off", "low & slow", "high"]
    assert [label.get_text() for label in axes[1].get_yticklabels()] == ["false", "true"]
    assert set(axes[0].get_lines()[0].get_ydata()) == {1.0, 2.0, 4.0}
    with pytest.raises(CommandError, match=r"'a\.text' has texts, which cannot be plotted"):
        result.plot("a.text")


def test_requirements_and_references_have_all_types(fmu: Path, tmp_path: Path) -> None:
    with prepare(fmu, signals=["a.text", "a.odd", "a.x", "a.count", "a.twice"]) as simulation:
        first = simulation.run(require=["a.count.final == 8", "a.odd.maximum == 1"])
        first.save(tmp_path / "kept", plots=False)
        with pytest.raises(RunError, match=r"a\.twice\.final"):
            simulation.run(require=["a.twice.final < 16"])
        second_run = simulation.run(set={"a.first": 4})
    outside = {
        comparison.signal
        for comparison in second_run.compare(tmp_path / "kept")
        if comparison.left_at is not None
    }
    assert outside == {"a.text", "a.odd", "a.count", "a.twice"}


@pytest.mark.parametrize("isolated", mostly_slow([(), ("a",)], [()]))
def test_failed_reading_ends_the_run(fmu: Path, isolated: tuple[str, ...]) -> None:
    options: dict[str, Any] = {"isolate": list(isolated), "signals": ["a.count", "a.text"]}
    with prepare(fmu, output_interval=0.01, **options) as simulation:
        with pytest.raises(RunError, match="a answered getting recorded variables with fmi2Error") as caught:
            simulation.run(set={"a.fail_at": 5})
        partial = caught.value.fields["result"]
        assert partial.time[-1] == pytest.approx(0.19)
        assert partial["a.text"][-1] == "count is 4, low"
        check_again = simulation.run(set={"a.first": 1})
        assert check_again["a.count"][-1] == 6


def test_metrics_and_signals_of_a_sweep_name_locals(fmu: Path, tmp_path: Path, on_one_cluster: None) -> None:
    result = ec.sweep(
        str(fmu),
        step_size=0.01,
        stop_time=0.5,
        output_interval=0.02,
        vary={"AllTypes.u": [1.0, -4.0]},
        metrics=["h = last(AllTypes.half)", "n = max(AllTypes.twice)"],
        signals=["AllTypes.half"],
        output=tmp_path / "out",
    )
    assert result.variants["h"].to_list() == pytest.approx([0.25, -1.0], rel=1e-12)
    assert result.variants["n"].to_list() == [10.0, 10.0]
    assert result.units["AllTypes.half"] == "m"
    series = polars.read_parquet(sorted((tmp_path / "out" / "series").glob("*.parquet")))
    assert series["AllTypes.half"].abs().max() == pytest.approx(1.0, rel=1e-12)
