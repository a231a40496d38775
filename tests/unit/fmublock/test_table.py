"""FMUs of data over time: what they say between the rows, before and after them, and to a host."""

import zipfile
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from fmpy.fmi2 import fmi2Terminated
from fmpy.validation import validate_fmu
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, PPoly

from emla_cosim import Verdict, verify
from fmublock.errors import BuildError
from fmublock.table import ENDS, MOST_OUTPUTS, TableColumn, TableContent, TableOutput, build_table
from fmublock.units import SiUnit
from tests.support.sessions import DISCARD, Session, opened, refused
from tests.support.tiers import mostly_slow

Array = NDArray[np.float64]

NEWTON = SiUnit("kN", (1, 1, -2, 0, 0, 0, 0, 0), 1e3)


def a_table(times: Array, values: Array, end: str = "hold") -> TableContent:
    """One column in every way of interpolation, and the derivatives of the cubic one."""
    columns = [TableColumn(values, kind) for kind in ("held", "linear", "cubic")]
    table_outputs = [
        TableOutput("held", 0),
        TableOutput("linear", 1),
        TableOutput("cubic", 2),
        TableOutput("rate", 2, 1),
        TableOutput("bend", 2, 2),
    ]
    return TableContent(times, columns, table_outputs, end)


def two_rows(columns: list[TableOutput]) -> TableContent:
    """A line from 1 to 3 within 1 s."""
    return TableContent(np.array([0.0, 1.0]), [TableColumn(np.array([1.0, 3.0]))], columns)


def outputs(table: TableContent, folder: Path, start: float, step: float, count: int) -> dict[str, Array]:
    """All outputs at the communication points."""
    rows = []
    with opened(build_table(table, folder / "table.fmu"), folder / "unpacked") as session:
        slave, names = session.instance(time=start), session.names("output")
        for k in range(count):
            rows.append(session.get(slave, *names))
            slave.doStep(start + k * step, step)
        rows.append(session.get(slave, *names))
    return dict(zip(names, np.array(rows).T, strict=True))


increasing = st.lists(st.integers(1, 400), min_size=1, max_size=12).map(
    lambda gaps: np.cumsum([0, *gaps]) * 0.01
)


@settings(max_examples=12)
@given(data=st.data(), times=increasing, shift=st.sampled_from([0.0, -1.37, 0.5]))
def test_values_between_rows_match_numpy_and_scipy(
    data: st.DataObject, times: Array, shift: float, tmp_path_factory: pytest.TempPathFactory
) -> None:
    times = times + shift
    numbers = st.floats(-1e3, 1e3)
    values = np.array(data.draw(st.lists(numbers, min_size=len(times), max_size=len(times))))
    step = data.draw(st.sampled_from([0.01, 0.013, 0.25, 1.0]))
    count = int((max(times[-1], 0.0) + 1.0) / step) + 1  # the data may be over before the start
    actual = outputs(a_table(times, values), tmp_path_factory.mktemp("table"), 0.0, step, count)
    points = step * np.arange(count + 1)
    inside = np.clip(points, times[0], times[-1])
    np.testing.assert_allclose(actual["linear"], np.interp(points, times, values), rtol=1e-12, atol=1e-10)
    held_values = values[np.clip(np.searchsorted(times, points + 1e-12, side="right") - 1, 0, None)]
    np.testing.assert_array_equal(actual["held"], held_values)
    spline = CubicSpline(times, values)
    np.testing.assert_allclose(actual["cubic"], spline(inside), rtol=1e-9, atol=1e-6)
    moving = (points > times[0] + 1e-9) & (points < times[-1] - 1e-9)
    for order, name in ((1, "rate"), (2, "bend")):
        expected = spline(points, order)
        size = np.abs(spline(times, order)).max() + 1.0
        np.testing.assert_allclose(actual[name][moving], expected[moving], rtol=1e-7, atol=1e-7 * size)
        assert not actual[name][points > times[-1] + 1e-9].any()


def spans(table: TableContent, folder: Path, times: Array) -> dict[str, Array]:
    """What each output did in the steps between these times, the first of which is the start."""
    rows = []
    with opened(build_table(table, folder / "table.fmu"), folder / "unpacked") as session:
        slave, names = session.instance(time=times[0]), session.names("local")
        for begin, end in pairwise(times):
            slave.doStep(begin, end - begin)
            rows.append(session.get(slave, *names))
    return dict(zip(names, np.array(rows).T, strict=True))


@settings(max_examples=12)
@given(data=st.data(), times=increasing, shift=st.sampled_from([0.0, -0.37]))
def test_spans_have_the_means_of_scipy(
    data: st.DataObject, times: Array, shift: float, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """With rows at communication points, between them, and several within one step."""
    times, numbers = times + shift, st.floats(-1e3, 1e3)
    values = np.array(data.draw(st.lists(numbers, min_size=len(times), max_size=len(times))))
    step = data.draw(st.sampled_from([0.01, 0.013, 0.25, 1.0]))
    points = times[0] + step * np.arange(int((times[-1] - times[0]) / step) + 1)
    if len(points) < 2:
        points = times[[0, -1]]
    actual = spans(a_table(times, values), tmp_path_factory.mktemp("table"), points)
    slopes = np.diff(values) / np.diff(times)
    curves = {
        "held": PPoly(values[None, :-1], times),
        "linear": PPoly(np.array([slopes, values[:-1]]), times),
        "cubic": CubicSpline(times, values),
    }
    curves |= {"rate": curves["cubic"].derivative(), "bend": curves["cubic"].derivative(2)}
    for name, curve in curves.items():
        exact = np.diff(curve.antiderivative()(points)) / np.diff(points)
        size = np.abs(curve(np.linspace(times[0], times[-1], 1000))).max() + 1.0
        np.testing.assert_allclose(actual[f"step.mean.{name}"], exact, rtol=1e-7, atol=1e-7 * size)


def test_line_of_a_step_ends_before_a_jump_and_is_its_mean_over_one(tmp_path: Path) -> None:
    """At 0.2 s between points, at 0.5 s at one; the data repeat after 0.8 s, with a jump."""
    times = np.array([0.0, 0.2, 0.2, 0.5, 0.5, 0.8])
    values = np.array([1.0, 3.0, 5.0, 2.0, 4.0, 4.0])
    table_outputs = [TableOutput("y", 0), TableOutput("z", 1)]
    columns = [TableColumn(values), TableColumn(np.array([1.0, 1.0, 2.0, 2.0, 5.0, 5.0]), "held")]
    table = TableContent(times, columns, table_outputs, "repeat")
    actual = spans(table, tmp_path, np.array([0.0, 0.1, 0.25, 0.5, 0.75, 0.9]))
    assert actual["step.begin.y"] == pytest.approx([1.0, 3.25, 4.5, 4.0, 7.0 / 3])
    assert actual["step.end.y"] == pytest.approx([2.0, 3.25, 2.0, 4.0, 7.0 / 3])
    assert actual["step.mean.y"] == pytest.approx([1.5, 3.25, 3.25, 4.0, 7.0 / 3])
    assert actual["step.begin.z"] == pytest.approx([1.0, 4.0 / 3, 2.0, 5.0, 7.0 / 3])
    assert actual["step.end.z"].tolist() == actual["step.begin.z"].tolist() == actual["step.mean.z"].tolist()


def test_rows_are_met_exactly_whatever_the_rounding_of_their_times(tmp_path: Path) -> None:
    times = np.array([float(f"{k / 10}") for k in range(101)])  # 0.3, and not 3 * 0.1
    values = np.random.default_rng(1).normal(size=101)
    actual = outputs(a_table(times, values), tmp_path, 0.0, 0.1, 100)
    np.testing.assert_array_equal(actual["held"], values)
    np.testing.assert_array_equal(actual["linear"], values)
    np.testing.assert_array_equal(actual["cubic"], values)


@pytest.mark.parametrize("end", ENDS)
def test_splines_are_periodic_only_in_repeated_tables(end: str, tmp_path: Path) -> None:
    """Not because its ends are equal, as those of a load that comes and goes."""
    times, values = np.linspace(0.0, 1.0, 6), np.array([1.0, 3.0, 2.0, -1.0, 4.0, 1.0])
    count = 79 if end == "repeat" else 19
    actual = outputs(a_table(times, values, end), tmp_path, 0.0, 0.05, count)
    points = 0.05 * np.arange(count + 1)
    spline = CubicSpline(times, values, bc_type="periodic" if end == "repeat" else "not-a-knot")
    for order, name in enumerate(("cubic", "rate", "bend")):
        np.testing.assert_allclose(actual[name], spline(points, order), rtol=1e-9, atol=1e-9)


def test_first_row_of_a_repeated_table_replaces_the_last(tmp_path: Path) -> None:
    """From the first row on: before it, the table rests."""
    table = a_table(np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 9.0]), "repeat")
    actual = outputs(table, tmp_path, 0.0, 0.5, 12)
    assert actual["held"].tolist() == [1, 1, 1, 1, 2, 2, 1, 1, 2, 2, 1, 1, 2]
    expected = [1, 1, 1, 1.5, 2, 5.5, 1, 1.5, 2, 5.5, 1, 1.5, 2]
    np.testing.assert_allclose(actual["linear"], expected, atol=1e-12)


def test_table_that_stops_asks_the_host_to_end(tmp_path: Path) -> None:
    table = a_table(np.array([0.0, 1.0]), np.array([0.0, 1.0]), "stop")
    with opened(build_table(table, tmp_path / "t.fmu"), tmp_path / "t") as session:
        slave = session.instance()
        slave.doStep(0.0, 0.75)
        with refused(DISCARD):
            slave.doStep(0.75, 0.5)
        assert slave.getBooleanStatus(fmi2Terminated) and session.get(slave, "linear") == [0.75]
        slave.doStep(0.75, 0.25)  # a shorter step is possible
        assert session.get(slave, "linear") == [1.0] and not slave.getBooleanStatus(fmi2Terminated)


def test_states_of_tables_are_restored_and_instances_are_independent(tmp_path: Path) -> None:
    times = np.linspace(0.0, 1.0, 11)
    path = build_table(a_table(times, times**2), tmp_path / "t.fmu")
    with opened(path, tmp_path / "a b%20ü#c") as session, opened(path, tmp_path / "other") as elsewhere:
        first, second = session.instance(), elsewhere.instance(time=0.5)
        first.doStep(0.0, 0.25)
        state, before = first.getFMUstate(), session.get(first, "linear")
        first.doStep(0.25, 0.6)
        assert session.get(first, "linear") != before and elsewhere.get(second, "linear") == [0.25]
        serialized = first.serializeFMUstate(state)
        first.setFMUstate(state)
        first.freeFMUstate(state)
        assert session.get(first, "linear") == before
        first.doStep(0.25, 0.5)
        after = session.get(first, "linear")
        first.reset()
        session.initialize(first)
        assert session.get(first, "linear") == [0.0]
        second.setFMUstate(second.deSerializeFMUstate(serialized))  # also of another instance
        second.doStep(0.25, 0.5)
        assert elsewhere.get(second, "linear") == after


def test_output_is_its_column_in_its_own_unit(tmp_path: Path) -> None:
    columns = [
        TableOutput("lift.plant.F_L", 0, factor=1e-3, offset=2.0, unit=NEWTON, description='<a> & "b"')
    ]
    path = build_table(two_rows(columns), tmp_path / "t.fmu")
    assert validate_fmu(str(path)) == []
    with opened(path, tmp_path / "t") as session:
        (unit,) = session.description.unitDefinitions
        assert (unit.name, unit.baseUnit.kg, unit.baseUnit.s, unit.baseUnit.factor) == ("kN", 1, -2, 1e3)
        assert session.variables["lift.plant.F_L"].description == '<a> & "b"'
        assert session.get(session.instance(time=1.0), "lift.plant.F_L") == [2.003]


@pytest.mark.slow
def test_verify_reports_no_problem(tmp_path: Path) -> None:
    times = np.linspace(0.0, 2.0, 201)
    path = build_table(a_table(times, np.sin(3 * times)), tmp_path / "t.fmu", license_text="free")
    (examined,) = verify([path]).examined
    assert [str(f) for f in examined.findings if f.verdict in (Verdict.FAILED, Verdict.WARNING)] == []


def test_bytes_depend_on_the_content_and_libraries_do_not(tmp_path: Path) -> None:
    times = np.array([0.0, 1.0])
    paths = [
        build_table(a_table(times, np.array([0.0, y])), tmp_path / f"{i}.fmu")
        for i, y in enumerate((1.0, 1.0, 2.0))
    ]
    assert paths[0].read_bytes() == paths[1].read_bytes() != paths[2].read_bytes()
    archives = [zipfile.ZipFile(path) for path in paths]
    (name,) = (n for n in archives[0].namelist() if n.startswith("binaries/"))
    assert len({archive.read(name) for archive in archives}) == 1


@pytest.mark.parametrize("count", mostly_slow([16, 17, MOST_OUTPUTS], [17]))
def test_tables_may_have_many_outputs(tmp_path: Path, count: int) -> None:
    columns = [TableOutput(f"y[{i}]", 0, factor=float(i)) for i in range(count)]
    with opened(build_table(two_rows(columns), tmp_path / "t.fmu"), tmp_path / "t") as session:
        slave = session.instance()
        slave.doStep(0.0, 0.5)
        assert session.get(slave, f"y[{count - 1}]") == [2.0 * (count - 1)]
        with refused():
            slave.getReal([4 * count + 1])  # the outputs, and three values of each in the last step


def test_too_many_outputs_are_refused(tmp_path: Path) -> None:
    columns = [TableOutput(f"y[{i}]", 0) for i in range(MOST_OUTPUTS + 1)]
    with pytest.raises(BuildError, match=f"can have {MOST_OUTPUTS} outputs"):
        build_table(two_rows(columns), tmp_path / "t.fmu")


@pytest.mark.parametrize("end", ENDS)
def test_damaged_data_are_refused(tmp_path: Path, end: str) -> None:
    table = a_table(np.array([0.0, 1.0, 2.0]), np.array([1.0, 2.0, 1.0]), end)
    session = Session(build_table(table, tmp_path / "t.fmu"), tmp_path / "t")
    numbers = session.folder / "resources" / "table.bin"
    complete = numbers.read_bytes()
    random = np.random.default_rng(3)
    damaged = [b"", complete[:-1], complete + b"\0", complete[:40], b"EMLATBL1" + complete[8:]]
    for position in random.integers(0, len(complete), 25):
        damaged.append(complete[:position] + bytes([complete[position] ^ 0x41]) + complete[position + 1 :])
    for content in (*damaged, None):
        numbers.unlink() if content is None else numbers.write_bytes(content)
        with pytest.raises(Exception, match="Failed to instantiate"):
            session.new()
