"""Files as measurement computers write them: units in any form, preambles, clock times, MDF and TDMS."""

import datetime
import re
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pandas
import polars
import pytest
from asammdf import MDF, Signal
from nptdms import ChannelObject, TdmsWriter

import emla_cosim as ec
from emla_cosim.base.errors import CommandError
from emla_cosim.base.progress import Progress
from emla_cosim.fmu.interface import Interface, read_interfaces
from emla_cosim.inputs.column_bindings import bind_columns
from emla_cosim.inputs.headers import Header
from emla_cosim.inputs.input import Input
from emla_cosim.inputs.loaded_input import LoadedInput
from emla_cosim.inputs.wired_inputs import wire_inputs
from emla_cosim.run.preparation import prepare_system
from emla_cosim.system.model import System
from emla_cosim.system.names import Names

LOAD, POSITION = "lift.disturbance.F_L", "lift.reference.x_d"
TIMES, FORCES = [0.0, 0.005, 0.01], [1.5, 2.0, 2.25]
STOP = 0.01


@cache
def lift(folder: Path) -> tuple[System, dict[str, Interface]]:
    scenario = ec.load("lift", fmus=folder)
    prepared = prepare_system(scenario.system, scenario.options, Progress())
    system, fmus = prepared.system, prepared.fmus
    return system, read_interfaces(fmus)


def forces_of(folder: Path, source: Input | Path, signal: str = LOAD) -> tuple[np.ndarray, str]:
    """The values that drive a signal in the rows, and the notes on them."""
    loaded_input = LoadedInput.of(source if isinstance(source, Input) else Input(source, {signal: "Force"}))
    system, interfaces = lift(folder)
    notes = wire_inputs(system, [loaded_input], interfaces, ["linux64"]).notes
    (driven,), _ = bind_columns(
        loaded_input.source, loaded_input.data, loaded_input.time, system, Names(system, interfaces)
    )
    assert driven.signal == signal
    numbers = loaded_input.data.numbers(driven.column)
    return driven.transformation.factor * numbers + driven.transformation.offset, "\n".join(notes)


def table(folder: Path, content: str | bytes) -> LoadedInput:
    file = folder / "data.csv"
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    return LoadedInput.of(Input(file))


def rows(delimiter: str = ";", force: float = 1.0) -> str:
    return "".join(f"{1000 * t:g}{delimiter}{force * f:g}\n" for t, f in zip(TIMES, FORCES, strict=True))


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [
        ("Kraft vorne_kN", "Kraft vorne", "kN"),
        ("F/kN", "F", "kN"),
        ("v/(mm/s)", "v", "(mm/s)"),
        ("Force, kN", "Force", "kN"),
        ("Force: kN", "Force", "kN"),
        ("Force - kN", "Force", "kN"),
        ("Force kN", "Force", "kN"),
        ("Force {kN}", "Force", "kN"),
        ("Force.kN", "Force", "kN"),
        ("M_N.m", "M", "N.m"),
        ("x_d", "x", "d"),
    ],
)
def test_header_that_only_looks_as_if_it_had_a_unit(header: str, name: str, unit: str) -> None:
    actual = Header.of(header)
    assert actual.unit is None and actual.name == header
    assert actual.unit_like_end == (name, unit)


NO_UNITS = """v1.2|KraftkN|F.kNn|.kN|x|x_1|Speed in the motor|Speed motor|a/b|x_max|p_2|_N"""


@pytest.mark.parametrize("header", NO_UNITS.split("|"))
def test_header_without_a_unit_at_its_end(header: str) -> None:
    assert Header.of(header).unit_like_end is None


@pytest.mark.parametrize(
    "content",
    [
        "Zeit in ms;Force in kN\n" + rows(),
        "Zeit(ms);Force(kN)\n" + rows(),
        "t / ms;Force / kN\n" + rows(),
        "Zeit;Force\nms;kN\n" + rows(),
        "Zeit\tForce\n[ms]\t[kN]\n" + rows("\t").replace(".", ","),
        "Zeit in msec;Force [kN]\n" + rows(),
        f"Zeit in ms;{LOAD} in kN\n" + rows(),
    ],
)
def test_units_are_read_in_every_form(content: str, fmu_folder: Path, tmp_path: Path) -> None:
    file = tmp_path / "data.csv"
    file.write_text(content)
    forces, notes = forces_of(fmu_folder, Input(file) if LOAD in content else file)
    np.testing.assert_allclose(forces, 1e3 * np.array(FORCES), rtol=1e-5)
    assert "without a unit" not in notes


def test_column_without_a_unit_is_noted(fmu_folder: Path, tmp_path: Path) -> None:
    file = tmp_path / "data.csv"
    file.write_text("Zeit in ms;Force\n" + rows())
    forces, notes = forces_of(fmu_folder, file)
    assert forces.tolist() == FORCES
    assert "read in the unit of their signal: 'Force' in N." in notes


@pytest.mark.parametrize("header", ["x_mm", "x/mm", "x, mm", "x mm", "x {mm}", "x.mm"])
def test_header_that_may_have_another_unit_is_refused(header: str, fmu_folder: Path, tmp_path: Path) -> None:
    file = tmp_path / "data.csv"
    file.write_text(f"t;{header}\n0;0.24\n0.01;0.25\n")
    remedy = re.escape(f"write the unit as in 'x [mm]', or declare it with '{POSITION}={header} [mm]'")
    with pytest.raises(CommandError, match=f"ends like the unit 'mm', but {POSITION} is in m; {remedy}"):
        forces_of(fmu_folder, Input(file, {POSITION: header}), POSITION)
    for unit, factor in (("mm", 1e-3), ("m", 1.0)):
        forces, notes = forces_of(fmu_folder, Input(file, {POSITION: f"{header} [{unit}]"}), POSITION)
        np.testing.assert_allclose(forces, factor * np.array([0.24, 0.25]), rtol=1e-15)
        assert "without a unit" not in notes


def test_unit_behind_the_name_of_a_signal_is_refused(fmu_folder: Path, tmp_path: Path) -> None:
    file = tmp_path / "data.csv"
    file.write_text(f"t;{LOAD}_kN\n0;0.24\n0.01;0.25\n")
    with pytest.raises(CommandError, match=re.escape(f"write its name as '{LOAD} [kN]'")):
        forces_of(fmu_folder, Input(file))


@pytest.mark.parametrize("header", ["pump.kN", "lift.plant.F_L", "x_d", "x_m"])
def test_end_of_another_quantity_is_a_name(header: str, fmu_folder: Path, tmp_path: Path) -> None:
    file = tmp_path / "data.csv"
    file.write_text(f"t;{header}\n0;0.24\n0.01;0.24\n")
    forces, notes = forces_of(fmu_folder, Input(file, {POSITION: header}), POSITION)
    assert forces[0] == 0.24 and f"'{header}' in m" in notes


def test_unknown_unit_needs_a_declaration(fmu_folder: Path, tmp_path: Path) -> None:
    file = tmp_path / "data.csv"
    file.write_text("t;Weg in Zoll\n0;1\n0.01;1\n")
    with pytest.raises(CommandError, match=r"'Weg in Zoll' .* has the unknown unit 'Zoll'"):
        forces_of(fmu_folder, Input(file, {POSITION: "Weg in Zoll"}), POSITION)
    forces, _ = forces_of(fmu_folder, Input(file, {POSITION: "Weg in Zoll [in]"}), POSITION)
    assert forces[0] == pytest.approx(0.0254)


@pytest.mark.parametrize(
    ("name", "unit"), [("t_h", "h"), ("t.min", "min"), ("time_ms", "ms"), ("t ms", "ms")]
)
def test_ambiguous_unit_of_the_time_is_refused(name: str, unit: str) -> None:
    data = {name: [0.0, 1.0], "x": [0.0, 1.0]}
    message = (
        f"the column '{re.escape(name)}' of the input of data ends like the unit '{unit}', but time is in s"
    )
    with pytest.raises(CommandError, match=message):
        LoadedInput.of(Input(data=data))
    assert LoadedInput.of(Input(data=data, time=f"{name} [s]")).times.tolist() == [0.0, 1.0]
    assert LoadedInput.of(Input(data={"t/s": [0.0, 1.0], "x": [0.0, 1.0]})).times.tolist() == [0.0, 1.0]


@pytest.mark.parametrize(("header", "pound"), [("Force [lbs]", 1.0), ("Force in oz", 16.0)])
def test_pounds_are_mass_or_force_as_the_signal(
    header: str, pound: float, fmu_folder: Path, tmp_path: Path
) -> None:
    file = tmp_path / "data.csv"
    file.write_text(f"t;{header}\n0;{pound}\n0.01;{2.0 * pound}\n")
    forces, notes = forces_of(fmu_folder, file)
    np.testing.assert_allclose(forces, [4.4482216152605, 8.896443230521], rtol=1e-12)
    assert "without a unit" not in notes


PREAMBLE = "Prüfstand 7;\nDatum;03.05.2026\nAbtastrate;1 kHz\n\n"


@pytest.mark.parametrize(("encoding", "end"), [("cp1252", "\r\n"), ("utf-8", "\r\n"), ("utf-16", "\n")])
def test_german_preamble_and_encodings(encoding: str, end: str, fmu_folder: Path, tmp_path: Path) -> None:
    text = f"{PREAMBLE}Zeit;Druck in Öl;Force\nms;bar;kN\n"
    text += "".join(f"{1000 * t:g};7,5;{f:g}\n".replace(".", ",") for t, f in zip(TIMES, FORCES, strict=True))
    file = tmp_path / "data.csv"
    file.write_bytes(text.replace("\n", end).encode(encoding))
    forces, notes = forces_of(fmu_folder, file)
    np.testing.assert_allclose(forces, 1e3 * np.array(FORCES), rtol=1e-15)
    assert "has 3 lines before its header, which are skipped" in notes
    assert LoadedInput.of(Input(file)).data.headers[1].text == "Druck in Öl"
    assert ("is not UTF-8" in notes) == (encoding != "utf-8")


def test_units_that_contradict_each_other_are_refused(tmp_path: Path) -> None:
    with pytest.raises(CommandError, match="has the unit 'N' in its row of units, and another one before"):
        table(tmp_path, "t;F [kN]\ns;N\n0;1\n1;2\n")
    assert table(tmp_path, "t;F [kN]\ns;kN\n0;1\n1;2\n").data.headers[1].unit == "kN"


def test_rows_are_counted_from_the_first_numbers(tmp_path: Path) -> None:
    actual = table(tmp_path, f"{PREAMBLE}t;F\ns;N\n0;1\n1;two\n")
    with pytest.raises(CommandError, match="has 'two' in row 2 of the column 'F'"):
        actual.data.numbers(1)


@pytest.mark.parametrize(
    "cells",
    [
        ["12:00:00,000", "12:00:00.250", "12:00:01.500"],
        ["2026-05-03 23:59:59", "2026-05-03T23:59:59.25", "2026-05-04 00:00:00.5"],
        ["23:59:59", "23:59:59.25", "00:00:00.5"],
        ["03.05.2026 23:59:59", "03.05.2026 23:59:59.25", "04.05.2026 00:00:00.5"],
        ["05/13/2026 11:59:59 PM", "05/13/2026 11:59:59.25 pm", "05/14/2026 12:00:00.5 AM"],
        ["2026-05-03T12:00:00Z", "2026-05-03T14:00:00.25+02:00", "2026-05-03T10:30:01.5-01:30"],
        ["28.02.24 23:59:59", "28.02.24 23:59:59.25", "29.02.24 00:00:00.5"],
    ],
)
def test_clock_times_and_dates_count_from_the_first_row(cells: list[str], tmp_path: Path) -> None:
    text = "".join(f"{cell};{k}\n" for k, cell in enumerate(cells))
    assert table(tmp_path, f"Uhrzeit;x\n{text}").times.tolist() == [0.0, 0.25, 1.5]


@pytest.mark.parametrize(
    ("cells", "sentence"),
    [
        (["05/03/2026 12:00:00", "05/04/2026 12:00:00"], "whose day and month are ambiguous"),
        (["31.02.2026 12:00:00", "01.03.2026 12:00:00"], "has the date '31.02.2026', which does not exist"),
        (["12:00:00", "12.5"], "has '12.5' in row 2; write clock times as"),
        (["12:00:00", "11:59:00"], "times must not decrease"),
        (["2026-05-03 12:00:00", "12:00:01"], "has no date in row 2"),
    ],
)
def test_invalid_clock_times(cells: list[str], sentence: str, tmp_path: Path) -> None:
    with pytest.raises(CommandError, match=sentence):
        table(tmp_path, "time;x\n" + "".join(f"{c};1\n" for c in cells))


@pytest.mark.parametrize(
    ("cells", "times", "note"),
    [
        (["12:00", "12:15", "12:30"], [0, 900, 1800], "has hours and minutes in 'time'; t = 0 is 12:00"),
        (["8:30 AM", "12:00 PM", "1:00 PM"], [0, 12600, 16200], "has hours and minutes"),
        (["2026-05-03 12:00", "2026-05-04 12:00"], [0, 86400], "has dates and hours and minutes"),
        (["2026-05-03", "2026-05-04"], [0, 86400], "has dates in 'time'; t = 0 is 2026-05-03, the first row"),
        (["20260503T235959", "20260504T000000"], [0, 1], "has dates and clock times"),
        (["05/13/2026", "05/14/2026"], [0, 86400], "has dates (month/day/year)"),
        (["1684396800", "1684396800.5"], [0, 0.5], "t = 0 is 1684396800 s, 2023-05-18 08:00:00 UTC"),
        (["1.0", "2.0"], [1, 2], None),
    ],
)
def test_times_are_read_with_a_note(
    cells: list[str], times: list[float], note: str | None, tmp_path: Path
) -> None:
    actual = table(tmp_path, "time;x\n" + "".join(f"{c};1\n" for c in cells))
    assert actual.times.tolist() == times
    assert any(note in text for text in actual.data.notes) if note else not actual.data.notes


def test_seconds_since_1970_stay_with_a_shift_or_in_a_run_of_that_time(tmp_path: Path) -> None:
    file = tmp_path / "data.csv"
    file.write_text("t,x\n1684396800,1\n1684396801,1\n")
    for source, start in ((Input(file), 1684396800.0), (Input(file, shift=0.0), 0.0)):
        assert LoadedInput.of(source, start).times.tolist() == [1684396800.0, 1684396801.0]


@pytest.mark.parametrize(
    ("shift", "times"),
    [("-5 s", [0.0, 1.0]), ("500 ms", [5.5, 6.5]), (2.0, [7.0, 8.0]), ("start", [3.0, 4.0])],
)
def test_shift_moves_the_data(shift: str | float, times: list[float], tmp_path: Path) -> None:
    file = tmp_path / "data.csv"
    file.write_text("t,x\n5,1\n6,1\n")
    source = Input(file, shift=shift)
    assert LoadedInput.of(source, 3.0).times.tolist() == times
    assert LoadedInput.of(Input.of_text(str(source)), 3.0).times.tolist() == times


@pytest.mark.parametrize("shift", ["first", "5 kg", "nan s"])
def test_invalid_shift(shift: str) -> None:
    with pytest.raises(CommandError, match=r"the shift of the input 'a\.csv'"):
        Input.of_text(f"a.csv:shift={shift}")


def test_dates_in_frames_and_parquet_are_times(tmp_path: Path) -> None:
    moments = [datetime.datetime(2026, 5, 3, 23, 59, 59, 750_000), datetime.datetime(2026, 5, 4, 0, 0, 1)]
    columns = {"t": moments, "x": [1.0, 2.0]}
    polars.DataFrame(columns).write_parquet(tmp_path / "data.parquet")
    for source in (
        Input(data=pandas.DataFrame(columns)),
        Input(data={"t": np.array(moments, "M8[us]"), "x": [1, 2]}),
        Input(tmp_path / "data.parquet"),
    ):
        assert LoadedInput.of(source).times.tolist() == [0.0, 1.25]


def write_mdf(file: Path) -> None:
    with MDF() as mdf:
        times = np.array(TIMES)
        force = Signal(np.array(FORCES), times, name="Force", unit="kN")
        count = Signal(np.arange(3, dtype=np.uint16), times, name="count")
        mdf.append([force, count], acq_name="fast")
        slow = np.array([0.0, STOP])
        mdf.append([Signal(np.array([240, 241], np.int16), slow, name="x", unit="mm")], acq_name="slow")
        mdf.save(file)


def write_tdms(file: Path) -> None:
    step = {"wf_increment": 0.005, "wf_start_offset": 0.0, "wf_samples": 3}
    start = np.datetime64("2026-05-03T12:00:00")
    moments = np.array([start, start + np.timedelta64(10, "ms")])
    with TdmsWriter(file) as writer:
        writer.write_segment(
            [
                ChannelObject("fast", "Force", np.array(FORCES), {"unit_string": "kN", **step}),
                ChannelObject("fast", "count", np.arange(3, dtype=np.uint16), step),
                ChannelObject("slow", "Time", moments),
                ChannelObject("slow", "x", np.array([240, 241], np.int16), {"unit_string": "mm"}),
            ]
        )


@pytest.mark.parametrize(("name", "write"), [("a.mf4", write_mdf), ("a.tdms", write_tdms)])
def test_measurement_files_drive_signals(name: str, write, fmu_folder: Path, tmp_path: Path) -> None:
    file = tmp_path / name
    write(file)
    forces, _ = forces_of(fmu_folder, Input.of_text(f"{file}:{LOAD}=Force"))
    np.testing.assert_allclose(forces, 1e3 * np.array(FORCES), rtol=1e-15)
    positions, _ = forces_of(fmu_folder, Input.of_text(f"{file}:{POSITION}=x"), POSITION)
    np.testing.assert_allclose(positions, [0.24, 0.241], rtol=1e-12)
    options = {"stop_time": STOP, "input": [f"{file}:{LOAD}=Force"]}
    result = ec.load("lift", fmus=fmu_folder, **options).prepare().run()
    rows = np.searchsorted(result["time"], np.array(TIMES) - 1e-9)
    np.testing.assert_allclose(result[f"input.{LOAD}"][rows], 1e3 * np.array(FORCES), rtol=1e-15)
    with pytest.raises(CommandError, match="in the groups 'fast' and 'slow'; name the channels"):
        LoadedInput.of(Input(file))
    message = r"has Force and x in different groups, .*; use one input for each"
    with pytest.raises(CommandError, match=message):
        LoadedInput.of(Input(file, {LOAD: "Force", POSITION: "x"}))


def test_missing_package_is_named(fmu_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_mdf(tmp_path / "a.mf4")
    monkeypatch.setitem(sys.modules, "asammdf", None)
    with pytest.raises(CommandError, match=r"needs the extra mdf, .*\[mdf\]"):
        LoadedInput.of(Input(tmp_path / "a.mf4"))


@pytest.mark.parametrize("magic", [b"MDF     ", b"TDSm"])
def test_damaged_measurement_files(magic: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.mf4").write_bytes(magic + b"\xff" * 200)
    with pytest.raises(CommandError, match=r"a\.mf4' (cannot be read: |has no channels)") as error:
        LoadedInput.of(Input(tmp_path / "a.mf4"))
    assert "\n" not in str(error.value)


def test_samples_marked_invalid_are_refused(tmp_path: Path) -> None:
    with MDF() as mdf:
        marks = np.array([False, True, False])
        times = np.array(TIMES)
        bad = Signal(np.array(FORCES), times, name="Force", unit="kN", invalidation_bits=marks)
        mdf.append([bad, Signal(np.arange(3.0), times, name="x")])
        mdf.save(tmp_path / "a.mf4")
    actual = LoadedInput.of(Input(tmp_path / "a.mf4")).data
    position = actual.find("Force")
    assert position is not None
    with pytest.raises(CommandError, match="has 2 samples that are not at the 3 times of its group"):
        actual.numbers(position)


def test_unit_at_the_end_of_a_parameter(fmu_folder: Path, tmp_path: Path) -> None:
    (tmp_path / "levels.csv").write_text("lift.disturbance.load.level in kN;lift.plant.motor.R_s\n30;0,2\n")
    options = {"parameters": [tmp_path / "levels.csv"], "stop_time": 1e-3}
    result = ec.load("lift", fmus=fmu_folder, **options).prepare().run()
    assert result["lift.disturbance.F_L"][-1] == 3e4
