"""Tables of data: what is read of them, and the messages for what is wrong."""

import os
from pathlib import Path

import numpy as np
import pandas
import polars
import pytest
from hypothesis import given
from hypothesis import strategies as st

from emla_cosim.base.errors import CommandError
from emla_cosim.inputs.headers import Header
from emla_cosim.inputs.input import Column, Input
from emla_cosim.inputs.loaded_input import LoadedInput, read_data


def table(folder: Path, content: str | bytes, name: str = "data.csv") -> LoadedInput:
    file = folder / name
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    return LoadedInput.of(Input(file))


@pytest.mark.parametrize(
    ("text", "name", "unit"),
    [
        ("Force [kN]", "Force", "kN"),
        ("Force[kN]", "Force", "kN"),
        ("lift.plant.F_L / kN", "lift.plant.F_L", "kN"),
        ("v / (mm/s)", "v", "(mm/s)"),
        ("c (N/(m/s))", "c", "N/(m/s)"),
        ("machine.x_d[1] [mm]", "machine.x_d[1]", "mm"),
        ("m[1,2]", "m[1,2]", None),
        ("der(x)", "der(x)", None),
        ("a/b", "a/b", None),
    ],
)
def test_headers(text: str, name: str, unit: str | None) -> None:
    actual = Header.of(text)
    assert (actual.name, actual.unit) == (name, unit)


@pytest.mark.parametrize(
    "content",
    [
        "time,x\n0,1.5\n1,-2e-3\n",
        "# measured\n\ntime,x\r\n0,1.5\r\n# later\r\n1,-2e-3\r\n\r\n\r\n",
        "\ufefftime;x\n0;1,5\n1;-2e-3\n",
        "t [ms]\tx\n0\t1.5\n1000\t-2e-3",
        '"Time (s)","x"\n"0","1.5"\n"1"," -2e-3 "\n',
        'name;TIME;"x"\n9;0,0;1.5\n9;1,0;-2e-3\n',
        "time;n;x\n0;3;1.5\n1;3,5;-0,2e-2\n",
        "time / min,x\n0,1.5\n0.016666666666666666,-2e-3\n",
    ],
)
def test_forms_of_csv_mean_the_same(content: str, tmp_path: Path) -> None:
    actual = table(tmp_path, content)
    position = actual.data.find("x")
    assert position is not None
    np.testing.assert_allclose(actual.times, [0.0, 1.0], rtol=1e-15)
    assert actual.data.numbers(position).tolist() == [1.5, -2e-3]


@given(values=st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=2, max_size=20))
def test_numbers_are_read_to_the_last_bit(
    values: list[float], tmp_path_factory: pytest.TempPathFactory
) -> None:
    rows = "".join(f"{k},{value!r}\n" for k, value in enumerate(values))
    actual = table(tmp_path_factory.mktemp("data"), f"t,x\n{rows}")
    assert actual.data.numbers(1).tolist() == values


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ("", "data.csv' is empty."),
        ("time,x\n0,1\n", "has fewer than two rows"),
        ("time,x\n0,1\n1,two\n", "has 'two' in row 2 of the column 'x'; it must be a finite number."),
        ("time,x\n0 s,1 N\n1 s,1 N\n", r"has '0 s' in row 1 .* \(write units in the header"),
        ("time x\n0 1\n1 1\n", "has columns separated by spaces; use commas, semicolons or tabs"),
        ("time,x\n1684396800000,1\n1684396801000,2\n", r"milliseconds since 1970, .*'time \[ms\]'"),
        ("time,x\n0,1\n1,\n", "has nothing in row 2 of the column 'x'"),
        ("time,x\n,1\n1,2\n", "has nothing in row 1 of the column 'time'"),
        ("time,x\n0,1\n\n1,2\n", "has nothing in row 2 of the column 'time'"),
        ("time,x\n0,nan\n1,2\n", "has 'nan' in row 1 of the column 'x'"),
        ("time,x\n0,1\n1,1e999\n", "has '1e999' in row 2 of the column 'x'"),
        ("time,x\n0,1\n0,2\n", "has the time 0 s in all rows; times must increase"),
        ("time,x\n0,1\n1,2\n0.5,2\n", "has the time 0.5 s in row 3, after 1 s; times must not decrease"),
        ("time,x\n0,1,2\n1,2\n", "has 3 fields in row 1, but its header has 2"),
        ("time,x\n0;1\n1;2\n", "has 1 fields in row 1, but its header has 2"),
        ("time,x,x\n0,1,1\n1,2,2\n", "has 2 columns 'x'; each needs its own name"),
        ("0,1\n1,2\n", "begins with numbers; its first row must have the names"),
        ("when,x\n0,1\n1,2\n", "has no column called time or t, but 'when' and 'x'; call the column"),
        ("time [N],x\n0,1\n1,2\n", "for time has the units N and s"),
        ("time [blub],x\n0,1\n1,2\n", "has the unknown unit 'blub'"),
        ("t,T\n0,1\n1,2\n", "has several columns called time or t"),
        ("time,x\n-1e308,1\n1e308,2\n", "has times beyond 1e.100 s"),
        (b"time,x\0\n0,1\n", "is not a text file; it must be CSV or Parquet"),
        (b"PAR1 and then something else", "is not a Parquet file that can be read"),
    ],
)
def test_invalid_files(content: str | bytes, sentence: str, tmp_path: Path) -> None:
    with pytest.raises(CommandError, match=sentence) as error:
        actual = table(tmp_path, content)
        position = actual.data.find("x")
        assert position is not None
        actual.data.numbers(position)
    assert "\n" not in str(error.value) and "data.csv" in str(error.value)


def test_pipes_devices_and_folders_are_refused(tmp_path: Path) -> None:
    pipe, link = tmp_path / "pipe.csv", tmp_path / "link.csv"
    os.mkfifo(pipe)
    link.symlink_to("/dev/zero")
    for path in (pipe, link, tmp_path, tmp_path / "none.csv", Path("/dev/zero"), Path("a\0b.csv")):
        with pytest.raises(CommandError, match="cannot be read"):
            read_data(Input(path))


def test_units_of_parquet_are_in_its_metadata(tmp_path: Path) -> None:
    file = tmp_path / "x.parquet"
    frame = polars.DataFrame({"time": [0, 1], "a.b [1]": [1.0, 2.0], "text": ["a", "b"], "gap": [1.0, None]})
    frame.write_parquet(file, metadata={"units": '{"time": "ms", "a.b [1]": "kN"}'})
    actual = LoadedInput.of(Input(file))
    assert actual.times.tolist() == [0.0, 1e-3]
    assert (actual.data.headers[1].name, actual.data.headers[1].unit) == ("a.b [1]", "kN")
    for column, sentence in ((2, "has 'a' in row 1"), (3, "has nothing in row 2")):
        with pytest.raises(CommandError, match=sentence):
            actual.data.numbers(column)


def test_damaged_parquet(tmp_path: Path) -> None:
    file = tmp_path / "x.parquet"
    polars.DataFrame({"time": np.arange(1e3), "x": np.arange(1e3)}).write_parquet(file)
    content = file.read_bytes()
    for offset in range(4, len(content), 397):
        file.write_bytes(content[:offset] + b"\xff\x00\xff" + content[offset + 3 :])
        try:
            LoadedInput.of(Input(file)).data.numbers(1)
        except CommandError as error:
            assert "\n" not in str(error) and "x.parquet" in str(error)


def test_frames() -> None:
    columns = {"time": np.array([0.0, 1.0]), "x [mm]": np.array([1, 2], dtype=np.int16)}
    for data in (columns, polars.DataFrame(columns), pandas.DataFrame(columns)):
        actual = LoadedInput.of(Input(data=data)).data
        assert actual.numbers(1).tolist() == [1.0, 2.0] and actual.headers[1].unit == "mm"


@pytest.mark.parametrize(
    "data",
    [{"time": [0, 1], "x": ["a", "b"]}, {"time": [0, 1], "x": [[1, 2], [3, 4]]}, {"time": "ab", "x": 1}],
)
def test_invalid_frames(data: dict) -> None:
    with pytest.raises(CommandError, match="must"):
        LoadedInput.of(Input(data=data)).data.numbers(1)


def test_inputs_from_text() -> None:
    text = "C:\\a=b,c.csv:lift.plant.F_L=Force [kN],tilt.*,end=repeat,interpolation=cubic,time=t [ms]"
    signals = {"lift.plant.F_L": Column("Force [kN]")}
    assert Input.of_text(text) == Input(
        Path("C:\\a=b,c.csv"), signals, ["tilt.*"], "t [ms]", "cubic", "repeat"
    )
    assert Input.of_text("some/where.parquet") == Input(Path("some/where.parquet"))
    assert Input.of_text("named").file == Path("named")


def test_inputs_as_text() -> None:
    with_columns = Input(
        Path("m.csv"), {"a.b": Column("F", "kN", 1)}, ["c.*"], interpolation="cubic", end="stop"
    )
    assert str(with_columns) == "m.csv:a.b=der(F [kN]),c.*,interpolation=cubic,end=stop"
    assert with_columns.is_text and str(Input.of_text(str(with_columns))) == str(with_columns)
    for untextual in (Input(Path("m.csv"), {"a.b": Column("F,kN")}), Input(data={})):
        assert not untextual.is_text


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("a.csv:end=never", "there is no end of an input 'never'; choose from hold, repeat and stop"),
        ("a.csv:interpolation=spline", "no interpolation 'spline'; choose from held, linear and cubic"),
        ("a.csv:=x", "cannot be read; write FILE:SIGNAL=COLUMN"),
        ("a.csv:lift.plant.F_L=", "cannot be read; write FILE:SIGNAL=COLUMN"),
    ],
)
def test_invalid_texts(text: str, sentence: str) -> None:
    with pytest.raises(CommandError, match=sentence):
        Input.of_text(text)


def test_an_input_has_one_source() -> None:
    for wrong in ({}, {"file": "a.csv", "data": {}}, {"data": 3}):
        with pytest.raises(CommandError, match="input"):
            Input(**wrong)
    with pytest.raises(CommandError, match="must be 0, 1 or 2"):
        Column("x", derivative=3)
