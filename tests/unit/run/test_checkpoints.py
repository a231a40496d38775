"""A run that is continued from a checkpoint leaves the same bytes as one without a pause."""

import io
import json
import pickle
import re
import shutil
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import hypothesis.strategies as st
import numpy as np
import polars
import pytest
from click.testing import Result
from hypothesis import HealthCheck, given

import emla_cosim as ec
import emla_cosim.recorders.checkpoints
from emla_cosim.base.errors import CommandError
from emla_cosim.base.output_files import OutputFile
from emla_cosim.master.stepping.checkpoint import load_checkpoint, save_checkpoint
from emla_cosim.master.stepping.stepping_base import Stepping
from tests.support.commands import Emla, sentence
from tests.support.faulty_systems import faulty, line_with_a_fault, run_system, wired
from tests.support.full_disk import files_of_at_most
from tests.support.hand_written_fmus import Fault
from tests.support.tiers import examples
from tests.support.whole_files import names

Lift = Callable[..., Result]


@pytest.fixture
def lift(emla: Emla) -> Lift:
    """Run `emla run lift` without plots, in an empty folder."""
    return lambda *options: emla("run", "lift", "--no-plots", *options)


def check_result(result: Result) -> None:
    assert result.exit_code == 0, result.output


def joints(folder: Path) -> Any:
    return json.loads((folder / "metrics.json").read_text())["joints"]


def assert_same(actual: Path, expected: Path) -> None:
    """Rows and metrics of two folders are the same to the last bit."""
    assert (actual / "results.csv").read_bytes() == (expected / "results.csv").read_bytes()
    assert joints(actual) == joints(expected)


# ---- continued in the same folder --------------------------------------------------------------

CONTINUED: list[tuple[list[str], tuple[str, str]]] = [
    (["--algorithm", "gauss-seidel", "--extrapolation", "fmu"], ("0.0355", "0.07")),  # between two rows
    (["--step-multiple", "lift.controller=10"], ("0.0355", "0.07")),  # it waits at 0.0355 s
    (["--error-tolerance", "1e-2", "--output-interval", "1e-3"], ("0.011", "0.02")),
    (["--output-interval", "1e-4"], ("0.3567", "0.5")),  # errors count from 0.3 s on
]
"""Options, and the stop times of the two parts in s."""


@pytest.mark.parametrize(
    ("options", "stops"), CONTINUED, ids=lambda x: " ".join(x)[:60] if isinstance(x, list) else ""
)
def test_continued_run_leaves_the_same_bytes(
    options: list[str], stops: tuple[str, str], lift: Lift, tmp_path: Path
) -> None:
    """In the folder of the first part; tests/backends has other steppers and algorithms."""
    first, second = stops
    check_result(lift(*options, "--stop-time", second, "--output", "whole"))
    check_result(lift(*options, "--stop-time", first, "--output", "parts", "--checkpoint", "c"))
    check_result(lift(*options, "--stop-time", second, "--output", "parts", "--resume", "c"))
    assert_same(tmp_path / "parts", tmp_path / "whole")


def test_run_is_continued_several_times(lift: Lift, tmp_path: Path) -> None:
    check_result(lift("--stop-time", "0.05", "--output", "whole"))
    check_result(lift("--stop-time", "0.01", "--output", "parts", "--checkpoint", "c"))
    for stop in ("0.0123", "0.0345", "0.05"):
        check_result(lift("--stop-time", stop, "--output", "parts", "--resume", "c", "--checkpoint", "c"))
    assert_same(tmp_path / "parts", tmp_path / "whole")
    assert {p.name for p in tmp_path.iterdir()} == {"whole", "parts", "c"}


def test_error_control_continues_at_the_checkpoint(faulty_fmu: Path, tmp_path: Path) -> None:
    """The first part shortens a step to meet its stop time: rows are as many as steps, and in order."""
    system = line_with_a_fault(faulty_fmu, Fault.NONE, 0.0)
    run_system(system, tmp_path, stop_time=0.5, error_tolerance=0.1, checkpoint=tmp_path / "c")
    result = run_system(system, tmp_path, error_tolerance=0.1, resume=tmp_path / "c")
    times = np.genfromtxt(tmp_path / "results.csv", delimiter=",", names=True)["time"]
    assert result.problem is None
    assert (np.diff(times) > 0.0).all() and {0.0, 0.5, 1.0} <= set(times)


# ---- continued elsewhere -----------------------------------------------------------------------


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_another_folder_gets_the_rows_after_the_checkpoint(form: str, lift: Lift, tmp_path: Path) -> None:
    for stop, output, *more in (
        ("0.02", "whole"),
        ("0.0105", "parts", "--checkpoint", "c"),
        ("0.02", "other", "--resume", "c"),
        ("0.02", "parts", "--resume", "c"),
    ):
        check_result(lift("--stop-time", stop, "--output", output, "--output-format", form, *more))
    read = polars.read_csv if form == "csv" else polars.read_parquet
    full_table, parts, other = (read(f"{f}/results.{form}") for f in ("whole", "parts", "other"))
    assert parts.equals(full_table)
    assert other.equals(full_table.filter(polars.col("time") > 0.0105)) and other["time"][0] == 0.011
    assert joints(tmp_path / "other") == joints(tmp_path / "whole")
    assert json.loads(Path("other/metrics.json").read_text())["run"]["steps"] == 95
    record = json.loads(Path("other/run.json").read_text())
    assert record["settings"]["resumed_from"] == "c" and record["stepping"]["steps"] == 200


@pytest.mark.parametrize(("first", "second"), [("csv", "parquet"), ("parquet", "csv")])
def test_rows_after_the_checkpoint_in_another_format(first: str, second: str, lift: Lift) -> None:
    check_result(
        lift("--stop-time", "0.01", "--output", "out", "--output-format", first, "--checkpoint", "c")
    )
    check_result(lift("--stop-time", "0.02", "--output", "out", "--output-format", second, "--resume", "c"))
    tables = polars.read_csv("out/results.csv"), polars.read_parquet("out/results.parquet")
    earlier, later = tables if first == "csv" else tables[::-1]
    assert earlier["time"][-1] == 0.01 and later["time"].to_list() == pytest.approx(np.arange(11, 21) * 1e-3)


def test_results_of_another_run_are_not_continued(lift: Lift, tmp_path: Path) -> None:
    """Another run of the same columns has left its results in the folder."""
    check_result(lift("--stop-time", "0.02", "--output", "whole"))
    check_result(lift("--stop-time", "0.01", "--output", "parts", "--checkpoint", "c"))
    check_result(lift("--stop-time", "0.02", "--output", "parts", "--set", "lift.plant.start.x_L=0.25"))
    check_result(lift("--stop-time", "0.02", "--output", "parts", "--resume", "c"))
    full_table, parts = ((tmp_path / x / "results.csv").read_text().splitlines() for x in ("whole", "parts"))
    assert parts == [full_table[0], *full_table[-10:]]


# ---- checkpoints of other runs -----------------------------------------------------------------


@pytest.fixture(scope="module")
def checkpoint_file(fmu_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a checkpoint `c` at 0.01 s and the results `out` that belong to it."""
    folder = tmp_path_factory.mktemp("made")
    with ec.load("lift", stop_time=0.01, fmus=fmu_folder).prepare() as simulation:
        simulation.run(checkpoint=folder / "c").save(folder / "out", plots=False)
    return folder


@pytest.mark.parametrize(
    ("scenario", "options", "words"),
    [
        ("lift", ["--gains", "published"], "other values set, of lift."),
        ("lift", ["--flavour", "python"], "other FMUs, of lift.reference, lift.plant"),
        ("tilt", [], "other FMUs, of lift.reference"),
    ],
)
def test_checkpoint_of_another_run_is_refused(
    scenario: str, options: list[str], words: str, checkpoint_file: Path, python_fmu_folder: Path, emla: Emla
) -> None:
    shutil.copytree(checkpoint_file / "out", "out")
    resume = ("--resume", str(checkpoint_file / "c"), "--stop-time", "0.02", "--output", "out", "--no-plots")
    text = sentence(emla("run", scenario, *resume, *options), 2)
    assert text.startswith(f"Error: the checkpoint '{checkpoint_file / 'c'}' has ") and words in text
    for file in (checkpoint_file / "out").iterdir():
        assert Path("out", file.name).read_bytes() == file.read_bytes()


@pytest.mark.parametrize(
    ("algorithm", "options", "words"),
    [
        ("jacobi", {"set": {"j.bad.a": 2.0}}, "other values set, of j.bad.a."),
        ("jacobi", {"algorithm": "gauss-seidel"}, "the algorithm jacobi, but this run has gauss-seidel."),
        ("jacobi", {"extrapolation": "fmu"}, "the extrapolation none, but this run has fmu."),
        ("strong", {"coupling_tolerance": 1e-6}, "the coupling tolerance 1e-08, but this run has 1e-06."),
        ("jacobi", {"error_tolerance": 0.5}, "the step-size control fixed, but this run has error."),
        ("jacobi", {"step_multiples": {"j.sink": 2}}, "other step multiples, of j.sink."),
        ("gauss-seidel", {"order": ["j.sink", "j.bad", "j.source"]}, "other order."),
        ("jacobi", {"step_size": 0.05}, "the step size 0.1, but this run has 0.05."),
        ("jacobi", {"output_interval": 0.2}, "the output interval None, but this run has 0.2."),
    ],
    ids=lambda x: next(iter(x)) if isinstance(x, dict) else "",
)
def test_differences_to_the_checkpoint_are_named(
    algorithm: str, options: dict[str, Any], words: str, faulty_fmu: Path, tmp_path: Path
) -> None:
    system = line_with_a_fault(faulty_fmu, Fault.NONE, 0.0)
    run_system(system, tmp_path, algorithm, stop_time=0.5, checkpoint=tmp_path / "c")
    with pytest.raises(CommandError) as refused:
        run_system(system, tmp_path, resume=tmp_path / "c", **{"algorithm": algorithm, **options})
    assert str(refused.value) == f"the checkpoint '{tmp_path / 'c'}' has {words}"


def test_other_wiring_and_order_are_named(faulty_fmu: Path, tmp_path: Path) -> None:
    parts = [faulty("j.a", faulty_fmu, u=1.0), faulty("j.b", faulty_fmu)]
    run_system(wired(parts, "j.a.y -> j.b.u"), tmp_path, stop_time=0.5, checkpoint=tmp_path / "c")
    for changed_system, words in (
        (wired(parts, "j.a.z -> j.b.u"), "other connections"),
        (wired(parts[::-1], "j.a.y -> j.b.u"), "other components"),  # signals are in their order
    ):
        with pytest.raises(CommandError, match=f"has {words}"):
            run_system(changed_system, tmp_path, resume=tmp_path / "c")


@pytest.mark.parametrize("stop", ["0.01", "0.005"])
def test_stop_time_must_be_after_the_checkpoint(stop: str, checkpoint_file: Path, lift: Lift) -> None:
    text = sentence(lift("--resume", str(checkpoint_file / "c"), "--stop-time", stop), 2)
    assert text.endswith(f"is already at t = 0.01 s. Set a stop time later than that; it is {stop} s.")
    assert sentence(lift("--resume", "gone"), 2) == "Error: there is no checkpoint 'gone'."


# ---- damaged files -----------------------------------------------------------------------------


def archive(**content: bytes) -> bytes:
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as target:
        for name, value in content.items():
            target.writestr(name, value)
    return stream.getvalue()


def arrays(**content: Any) -> bytes:
    stream = io.BytesIO()
    np.savez(stream, **content)
    return stream.getvalue()


def header(content: object) -> bytes:
    return arrays(header=np.frombuffer(json.dumps(content).encode(), dtype=np.uint8))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is not a checkpoint, or is damaged"),
        (pickle.dumps({"a": 1}), "is not a checkpoint, or is damaged"),
        (archive(readme=b"hello"), "is not a checkpoint, or is damaged"),
        (arrays(x=np.zeros(3)), "is not a checkpoint, or is damaged"),
        (arrays(header=np.array([{}], dtype=object)), "is not a checkpoint, or is damaged"),
        (header([1]), "is not a checkpoint, or is damaged"),
        (header({"format": 8, "notes": {}, "arrays": ["state/x"]}), "damaged: parts of it are missing"),
        (header({"format": 7, "notes": {}, "arrays": []}), "has the format 7; this version reads 8"),
        (header({"format": 8, "notes": {}, "arrays": []}), "is not a checkpoint of a run"),
        (header({"format": 8, "notes": 7, "arrays": []}), "is not a checkpoint of a run"),
        (header({"format": 8, "notes": {"identity": 1, "time": 0}, "arrays": []}), "is not a checkpoint"),
    ],
)
def test_invalid_checkpoint_files_are_reported(
    content: bytes, words: str, faulty_fmu: Path, tmp_path: Path
) -> None:
    (tmp_path / "c").write_bytes(content)
    with pytest.raises(CommandError) as refused:
        run_system(wired([faulty("j.a", faulty_fmu)]), tmp_path / "out", resume=tmp_path / "c")
    assert f"'{tmp_path / 'c'}'" in str(refused.value) and words in str(refused.value)
    assert list((tmp_path / "out").iterdir()) == []


@examples(20, 300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(part=st.floats(0.0, 1.0, exclude_max=True), change=st.integers(0, 255))
def test_changed_byte_is_noticed_or_has_no_effect(
    part: float, change: int, checkpoint_file: Path, tmp_path: Path
) -> None:
    """Where the change is 0 the file ends there."""
    content = bytearray((checkpoint_file / "c").read_bytes())
    at = int(part * len(content))
    content[at] ^= change
    (tmp_path / "c").write_bytes(content if change else content[:at])
    if not change:
        with pytest.raises(CommandError, match="is not a checkpoint, or is damaged"):
            load_checkpoint(tmp_path / "c")
        return
    good = load_checkpoint(checkpoint_file / "c")
    try:
        actual = load_checkpoint(tmp_path / "c")
    except CommandError:
        return
    assert (actual.states, actual.notes) == (good.states, good.notes)
    assert actual.memory.keys() == good.memory.keys()
    assert all(np.array_equal(actual.memory[n], good.memory[n]) for n in good.memory)


# ---- checkpoints that cannot be written --------------------------------------------------------


@pytest.mark.parametrize("path", [".", "/", "gone/c", "file/c", "out"])
def test_unusable_place_is_reported_before_the_run(
    path: str, faulty_fmu: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(
        CommandError, match=f"the checkpoint '{re.escape(str(Path(path)))}' cannot be written: "
    ):
        run_system(wired([faulty("j.a", faulty_fmu)]), Path("out"), checkpoint=Path(path))
    assert {p.name for p in tmp_path.iterdir()} == {"file", "out"}
    assert list((tmp_path / "out").iterdir()) == []


def test_full_disk_leaves_the_earlier_checkpoint(
    checkpoint_file: Path, lift: Lift, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def save(file: OutputFile, stepping: Stepping, notes: dict[str, Any]) -> None:
        with files_of_at_most(1000):
            save_checkpoint(file, stepping, notes)

    shutil.copy(checkpoint_file / "c", tmp_path / "c")
    monkeypatch.setattr(emla_cosim.recorders.checkpoints, "save_checkpoint", save)
    text = sentence(lift("--stop-time", "0.02", "--output", "out", "--checkpoint", "c"), 1)
    assert "the checkpoint 'c' cannot be written: File too large." in text
    assert (tmp_path / "c").read_bytes() == (checkpoint_file / "c").read_bytes()
    assert {p.name for p in tmp_path.iterdir()} == {"c", "out"}
    assert names(tmp_path / "out") == {"results.csv", "metrics.json", "run.json"}


def test_failed_run_has_the_last_regular_checkpoint(
    faulty_fmu: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The run fails in the end, and can be continued from the last checkpoint before."""
    monkeypatch.setattr(emla_cosim.recorders.checkpoints, "INTERVAL", 0.0)
    system = line_with_a_fault(faulty_fmu, Fault.ERROR, 0.35)
    result = run_system(system, tmp_path, checkpoint=tmp_path / "c")
    assert result.problem is not None
    assert load_checkpoint(tmp_path / "c").notes["time"] == pytest.approx(0.3)
    repeated = run_system(system, tmp_path, resume=tmp_path / "c")
    assert repeated.problem == result.problem
    assert len((tmp_path / "results.csv").read_text().splitlines()) == 5


# ---- made by hand ----------------------------------------------------------------------------------

ODD: list[Any] = [None, 0, -1, 1e308, "x", [], {}, [[1]], {"a": {"b": []}}, True]


def list_paths(content: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the path of each entry of nested tables, the outermost first."""
    inner = content.items() if isinstance(content, dict) else ()
    for key, value in inner:
        yield (*path, key)
        yield from list_paths(value, (*path, key))


@examples(8, 60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_edited_checkpoint_gives_at_most_one_message(
    data: st.DataObject, checkpoint_file: Path, lift: Lift, tmp_path: Path
) -> None:
    """Whole files in which one entry of the header, or one array, is another."""
    with np.load(checkpoint_file / "c") as archive:
        arrays = {name: archive[name] for name in archive}
    header = json.loads(arrays["header"].tobytes())
    if data.draw(st.booleans()):
        path = data.draw(st.sampled_from([p for p in list_paths(header) if p[:2] != ("notes", "identity")]))
        inside = header
        for key in path[:-1]:
            inside = inside[key]
        odd = data.draw(st.sampled_from([*ODD, "gone"]))
        if odd == "gone":
            del inside[path[-1]]
        else:
            inside[path[-1]] = odd
    else:
        name = data.draw(st.sampled_from([n for n in arrays if n != "header"]))
        array = arrays[name]
        arrays[name] = data.draw(
            st.sampled_from(
                [array[:0], np.append(array, array[-1:]), array.astype("U5"), array[..., None], -array]
            )
        )
    arrays["header"] = np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)
    with (tmp_path / "odd").open("wb") as stream:
        np.savez(stream, **arrays)
    result = lift("--stop-time", "0.02", "--resume", "odd")
    assert result.exit_code in (0, 1, 2)
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    if result.exit_code:
        sentence(result, result.exit_code)
