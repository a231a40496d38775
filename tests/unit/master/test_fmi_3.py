"""FMI 3.0 co-simulation FMUs in systems, also together with FMI 2.0."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import polars
import pytest

import emla_cosim as ec
from emla_cosim.base.errors import CommandError, RunError
from emla_cosim.system.model import System
from tests.support.hand_written_fmus import build_all_types_3_fmu, build_all_types_fmu, edit_description
from tests.support.tiers import mostly_slow
from tests.unit.master.conftest import run as run_for

DISCARD, TERMINATE, EARLY_RETURN, EVENT = 1, 2, 3, 4
STEP, STOP = 0.125, 1.0
VALUES: dict[str, Any] = {
    "Float32": 0.1,
    "Int8": -128,
    "UInt8": 255,
    "Int16": -(2**15),
    "UInt16": 2**16 - 1,
    "Int32": -(2**31),
    "UInt32": 2**32 - 1,
    "Int64": -(2**53),
    "UInt64": 2**53,
    "Boolean": True,
    "Enumeration": "two",
}
OPTIONS: list[dict[str, Any]] = [
    {},
    {"isolate": ["a", "b", "c"]},
    {"algorithm": "strong", "isolate": ["b"]},
    {"algorithm": "jacobi"},
]
run = partial(run_for, stop=STOP)
NUMBERS = {**VALUES, "Float32": float(np.float32(0.1)), "Boolean": 1, "Enumeration": 2}


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("fmi3") / "Third.fmu"
    return build_all_types_3_fmu(file)


def test_all_types_and_arrays_pass_through_connections(path: Path) -> None:
    connections = ["a.y -> b.u", *(f"a.{t}_out -> b.{t}_in" for t in VALUES)]
    values = {f"a.{t}_in": value for t, value in VALUES.items()}
    result = run(System.of({"a": path, "b": path}, connections, {**values, "a.u[1,1]": 3.0}))
    for kind, number in NUMBERS.items():
        assert result[f"a.{kind}_out"][-1] == number, kind
        assert result[f"b.{kind}_out"][-1] == number, kind
    # b.y = gain * gain * a.u, elementwise, with the gains 1 to 4
    for index, element in enumerate(("1,1", "1,2", "2,1", "2,2")):
        u = 3.0 if index == 0 else 0.5
        assert result[f"b.y[{element}]"][-1] == (index + 1) ** 2 * u
    assert result["a.x"][-1] == 3.0 * STOP  # the integral of u[1,1]


def test_one_element_leaves_the_others(path: Path) -> None:
    system = System.of({"a": path, "b": path}, ["a.x -> b.u[1,2]"], {"b.gain[2,1]": 7.0, "b.u[2,2]": 2.0})
    result = run(system)
    assert result["b.y[1,2]"][-1] == 2.0 * result["a.x"][-1] == 1.0
    assert [result[f"b.y[{e}]"][-1] for e in ("1,1", "2,1", "2,2")] == [0.5, 3.5, 8.0]


@pytest.mark.parametrize("options", mostly_slow(OPTIONS, OPTIONS[::2]), ids=str)
def test_strings_pass_through_connections(path: Path, options: dict[str, Any], tmp_path: Path) -> None:
    build_all_types_fmu(tmp_path / "all_types.fmu")  # FMI 2.0; its text changes
    fmus = {"b": path, "a": tmp_path / "all_types.fmu", "c": path}
    system = System.of(fmus, ["a.text -> b.String_in", "b.String_out -> c.String_in", "a.x -> b.u[1,1]"])
    signals = ["a.text", "b.String_out", "c.String_out", "b.y[1,1]", "a.x"]
    with ec.load(system, step_size=STEP, stop_time=STOP, **options).prepare() as simulation:
        results = [simulation.run(signals=signals) for _ in range(2)]
    texts, passed, last = (list(results[0][name]) for name in signals[:3])
    assert len(set(texts)) > 2, "the text changes"
    assert passed == [texts[0], *texts[:-1]], "the String of the beginning is held during a step"
    assert last == [texts[0], *passed[:-1]]
    assert [list(results[1][name]) for name in signals[:3]] == [texts, passed, last]


def test_resumed_run_has_its_strings_and_binary_values(path: Path, tmp_path: Path) -> None:
    build_all_types_fmu(tmp_path / "all_types.fmu")
    fmus = {"a": tmp_path / "all_types.fmu", "b": path, "c": path}
    names = ["a.text", "b.String_out", "c.checksum"]

    def part(stop: float, **options: Any) -> list[list[str]]:
        system = System.of(fmus, ["a.text -> b.String_in", "b.Binary_source -> c.Binary_in"])
        options = {"step_size": STEP, "stop_time": stop, "output_interval": STEP, "signals": names, **options}
        with ec.load(system, **options).prepare() as simulation:
            result = simulation.run()
        return [list(result[name]) for name in names]

    expected = part(STOP)
    part(0.5, checkpoint=tmp_path / "c")
    rest = part(STOP, resume=tmp_path / "c")
    assert rest == [texts[-len(rest[0]) :] for texts in expected]


def checksum(time: float) -> int:
    """The checksum of the bytes that `Binary_source` has at a time in s; see all_types_3.c."""
    count = round(8.0 * time)
    data = bytes(0 if i == 1 else 250 + count for i in range(count % 4))
    return 1000 * len(data) + sum((i + 1) * byte for i, byte in enumerate(data))


@pytest.mark.parametrize("options", mostly_slow(OPTIONS[::2] + OPTIONS[3:], OPTIONS[::3]), ids=str)
def test_binary_values_pass_through_connections(path: Path, options: dict[str, Any]) -> None:
    connections = ["a.Binary_source -> b.Binary_in", "b.Binary_out -> c.Binary_in", "a.x -> b.u[1,1]"]
    system, names = System.of(dict.fromkeys("abc", path), connections), ["b.checksum", "c.checksum"]
    with ec.load(system, step_size=STEP, stop_time=0.625, **options).prepare() as simulation:
        results = [simulation.run(signals=names) for _ in range(2)]
    sent = [checksum(time) for time in results[0]["time"]]
    assert len(set(sent)) > 3 and 0 in sent[1:], "there are values of several sizes, also without bytes"
    for result in results:
        assert list(result["b.checksum"]) == [sent[0], *sent[:-1]], "a value is held during a step"
        assert list(result["c.checksum"]) == [sent[0], sent[0], *sent[:-2]]


@pytest.mark.parametrize(
    ("connection", "options", "words"),
    [
        ("a.String_out -> b.u[1,1]", {}, "the types String and Real: a String can only become a String"),
        ("a.Int8_out -> b.String_in", {}, "the types Integer and String: a String can only become a String"),
        ("a.Binary_source -> b.u[1,1]", {}, "a Binary can only become a Binary"),
        ("a.String_out -> b.Binary_in", {}, "a String can only become a String"),
        (
            "a.Binary_source -> b.Binary_in",
            {"set": {"a.end": 0.25}},
            r"a.Binary_source has 9 bytes, but b.Binary_in takes 8 at the most \(maxSize\)",
        ),
        ("a.Binary_source -> b.Binary_in", {"signals": ["a.Binary_source"]}, "a.Binary_source"),
        ("a.Binary_source -> b.Binary_in", {"set": {"b.Binary_in": "00"}}, "b.Binary_in"),
        (
            "a.Binary_source -> b.Binary_in",
            {"set": {"a.Binary_in": "00"}},
            "a.Binary_in cannot be set: it is Binary",
        ),
    ],
)
def test_wrong_uses_of_strings_and_binary_values_are_refused(
    path: Path, connection: str, options: dict[str, Any], words: str
) -> None:
    with pytest.raises((CommandError, RunError), match=words):
        result = run(System.of({"a": path, "b": path}, [connection]), **options)
        raise RunError(result.problem or "nothing")


def test_mime_types_must_match(path: Path, tmp_path: Path) -> None:
    changed_fmu = edit_description(path, tmp_path / "Other.fmu", "application/test", "application/other")
    system = System.of({"a": path, "b": changed_fmu}, ["a.Binary_source -> b.Binary_in"])
    with pytest.raises(CommandError, match="the mimeType application/test and application/other, which must"):
        run(system)
    assert run(system, lenient=True)["b.checksum"][0] == 0


def test_signal_out_of_the_range_of_its_input_ends_the_run(path: Path) -> None:
    def passed(value: int) -> float:
        system = System.of({"a": path, "b": path}, ["a.Int16_out -> b.Int8_in"], {"a.Int16_in": value})
        return run(system)["b.Int8_out"][-1]

    assert (passed(127), passed(-128)) == (127, -128)
    for value in (128, -129):
        message = f"b got a value that .*: its input Int8_in is Int8 and cannot be {value}"
        with pytest.raises(RunError, match=message):
            passed(value)


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_integers_of_more_than_32_bits_are_recorded(path: Path, suffix: str, tmp_path: Path) -> None:
    largest = {"UInt32": 2**32 - 1, "Int64": -(2**53), "UInt64": 2**64 - 2**11, "Int32": -(2**31)}
    system = System.of({"a": path}, [], {f"a.{kind}_in": value for kind, value in largest.items()})
    file = tmp_path / f"rows.{suffix}"
    table = ec.CsvFile(file) if suffix == "csv" else ec.ParquetFile(file)
    with ec.load(system, step_size=STEP, stop_time=STOP).prepare() as simulation:
        simulation.run(recorders=[table])
    frame = polars.read_csv(file) if suffix == "csv" else polars.read_parquet(file)
    for kind, value in largest.items():
        assert set(frame[f"a.{kind}_out"][1:]) == {value}


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("a.UInt8_in", 256, "at most 255"),
        ("a.UInt64_in", -1, "at least 0"),
        ("a.Float32_in", 1e39, "out of range"),
        ("a.n", 3, "cannot be started: fmi3EnterConfigurationMode"),
        ("a.gain[3,1]", 1.0, r"elements of gain are gain\[1,1\] to gain\[2,2\]"),
        ("a.blob", 1, "cannot be set: it is Binary"),
    ],
)
def test_values_that_do_not_fit_are_refused(path: Path, name: str, value: Any, words: str) -> None:
    with pytest.raises(CommandError, match=words):
        run(System.of({"a": path}, [], {name: value}))
