"""Data with jumps, for discrete variables, and beside the run."""

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import emla_cosim as ec
from emla_cosim.base.errors import CommandError
from tests.support.hand_written_fmus import build_all_types_3_fmu, build_all_types_fmu, edit_description

STEP = 0.1
TIMES = np.arange(11) * STEP


@pytest.fixture(scope="module")
def integrator(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An FMU with the continuous input u and the output x, its integral."""
    return build_all_types_fmu(tmp_path_factory.mktemp("integrator") / "M.fmu")


def driven(fmu: Path, data: dict[str, list[float]], **settings: str) -> ec.Result:
    """Return a run in which data drive u."""
    source = ec.Input(data=data, signals={"M.u": "u"}, **settings)
    options = {"step_size": STEP, "stop_time": 1.0, "algorithm": "jacobi", "signals": ["input.M.u", "M.x"]}
    with ec.load(str(fmu), input=[source], **options).prepare() as simulation:
        return simulation.run()


@pytest.mark.parametrize("interpolation", ["held", "linear", "cubic"])
def test_two_rows_at_one_time_are_a_jump(integrator: Path, interpolation: str) -> None:
    data = {"time": [0.0, 0.5, 0.5, 1.0], "u": [0.0, 1.0, 3.0, 5.0]}
    result = driven(integrator, data, interpolation=interpolation)
    held_values = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 3.0, 3.0, 3.0, 3.0, 3.0, 5.0])
    lines = np.where(TIMES < 0.5, 2.0 * TIMES, 3.0 + 4.0 * (TIMES - 0.5))  # also as splines of two rows
    assert result["input.M.u"] == pytest.approx(held_values if interpolation == "held" else lines, abs=1e-12)


def test_a_cubic_column_has_a_spline_on_each_side_of_a_jump(integrator: Path) -> None:
    before, after = [0.0, 0.1, 0.2, 0.3, 0.5], [0.5, 0.6, 0.8, 0.9, 1.0]
    values = [0.0, 0.3, 0.1, 0.4, 0.2, 5.0, 5.5, 5.1, 5.3, 5.2]
    result = driven(integrator, {"time": [*before, *after], "u": values}, interpolation="cubic")
    expected = [
        float(CubicSpline(*((before, values[:5]) if t < 0.5 - 1e-9 else (after, values[5:])))(t))
        for t in TIMES
    ]
    assert result["input.M.u"] == pytest.approx(expected, abs=1e-12)


def test_repeated_rows_change_nothing(integrator: Path) -> None:
    without_repetition = driven(integrator, {"time": [0.0, 0.4, 1.0], "u": [0.0, 2.0, 1.0]})
    twice = driven(integrator, {"time": [0.0, 0.4, 0.4, 1.0, 1.0], "u": [0.0, 2.0, 2.0, 1.0, 1.0]})
    assert np.array_equal(without_repetition["M.x"], twice["M.x"])


def test_steps_end_at_jumps_under_error_control(integrator: Path) -> None:
    source = ec.Input(
        data={"time": [0.0, 0.437, 0.437, 1.0], "u": [0.0, 0.0, 1.0, 1.0]}, signals={"M.u": "u"}
    )
    options = {"step_size": STEP, "stop_time": 1.0, "error_tolerance": 1e-3}
    with ec.load(str(integrator), input=[source], **options).prepare() as simulation:
        times = simulation.run().time
    assert np.abs(times - 0.437).min() < 1e-12


def test_data_of_discrete_variables_hold(integrator: Path, tmp_path: Path) -> None:
    discrete = edit_description(
        integrator, tmp_path / "M.fmu", 'causality="input" variability="continuous"',
        'causality="input" variability="discrete"',
    )  # fmt: skip
    data = {"time": [0.0, 0.3, 0.7], "u": [1.0, 2.0, 5.0]}
    result = driven(discrete, data)
    expected = np.where(TIMES < 0.3 - 1e-9, 1.0, np.where(TIMES < 0.7 - 1e-9, 2.0, 5.0))
    assert np.array_equal(result["input.M.u"], expected)
    assert result["M.x"] == pytest.approx(driven(integrator, data, interpolation="held")["M.x"], abs=1e-12)


def test_data_before_the_run_may_repeat(integrator: Path) -> None:
    result = driven(integrator, {"time": [-3.0, -1.0], "u": [1.0, 3.0]}, end="repeat")
    assert result["input.M.u"][:3] == pytest.approx([2.0, 2.1, 2.2])


def test_data_are_compared_with_the_times_of_each_run(integrator: Path) -> None:
    source = ec.Input(data={"time": [1.0, 2.0], "u": [1.0, 2.0]}, signals={"M.u": "u"})
    with ec.load(str(integrator), input=[source], step_size=STEP, stop_time=1.0).prepare() as simulation:
        with pytest.raises(CommandError, match="after the run"):
            simulation.run()
        assert simulation.run(stop_time=2.0).steps == 20


@pytest.fixture(scope="module")
def echo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An FMU of FMI 3.0 with inputs of all types, and outputs that have their values."""
    return build_all_types_3_fmu(tmp_path_factory.mktemp("echo") / "M.fmu")


def test_data_drive_numbers_and_booleans_of_all_types(echo: Path, tmp_path: Path) -> None:
    table = tmp_path / "data.csv"
    table.write_text("time,a,b,c\n0,1,true,0.5\n0.25,3,FALSE,1.5\n0.5,5,1,2.5\n")
    signals = {"M.Int32_in": "a", "M.UInt8_in": "a", "M.Boolean_in": "b", "M.Float32_in": "c"}
    source = ec.Input(table, signals)
    options = {"step_size": 0.125, "stop_time": 0.5, "algorithm": "jacobi"}
    with ec.load(str(echo), input=[source], **options).prepare() as simulation:
        result = simulation.run()
    names = [n for n in result.names if n.startswith("input")]
    rows = {n.partition("M.")[2]: list(map(float, result[n])) for n in names}
    assert rows["Int32_in"] == rows["UInt8_in"] == [1.0, 1.0, 3.0, 3.0, 5.0]
    assert rows["Boolean_in"] == [1.0, 1.0, 0.0, 0.0, 1.0]
    assert rows["Float32_in"] == [0.5, 0.5, 1.5, 1.5, 2.5]
    assert list(result["M.Int32_out"][1:]) == [1, 1, 3, 3]  # one step late
    assert list(result["M.Boolean_out"][1:]) == [1, 1, 0, 0]


AS_INPUTS = (
    ('name="first" valueReference="0" causality="parameter" variability="fixed" initial="exact"',
     'name="first" valueReference="0" causality="input" variability="discrete"'),
    ('name="text" valueReference="0" causality="output" variability="discrete" initial="calculated">',
     'name="text" valueReference="0" causality="input" variability="discrete">'),
    ("<String/>", '<String start=""/>'),
)  # fmt: skip
"""Make inputs of an Integer and a String."""


@pytest.mark.parametrize(
    ("signal", "values", "words"),
    [
        ("M.first", "1 2.5", "2.5 in row 2 of the column 'u', which is not an Integer"),
        ("M.first", "1 2147483648", "which is not an Integer"),
        ("M.on", "0 2", "which is not a Boolean"),
        ("M.on", "true yes", "has 'yes' in row 2"),
        ("M.text", "1 2", "M.text is of the type String; data can drive Real, Integer, Enumeration and"),
    ],
)
def test_wrong_values_of_a_type_are_refused(
    signal: str, values: str, words: str, integrator: Path, tmp_path: Path
) -> None:
    path = edit_description(integrator, tmp_path / "M.fmu", *(text for edit in AS_INPUTS for text in edit))
    table = tmp_path / "data.csv"
    table.write_text("time,u\n" + "".join(f"{t},{value}\n" for t, value in enumerate(values.split())))
    source = ec.Input(table, {signal: "u"})
    with pytest.raises(CommandError, match=words):
        ec.load(str(path), input=[source], step_size=STEP, stop_time=1.0, lenient=True).prepare()


def test_names_of_an_enumeration_are_values(integrator: Path, tmp_path: Path) -> None:
    """Columns without a signal drive the inputs of their name, whatever their type."""
    path = edit_description(
        integrator, tmp_path / "M.fmu",
        '<Boolean start="false"/>', '<Enumeration declaredType="Mode" start="1"/>',
        'name="on" valueReference="2"', 'name="on" valueReference="0"',
        'name="first" valueReference="0"', 'name="first" valueReference="9"',
    )  # fmt: skip
    table = tmp_path / "data.csv"
    table.write_text("time,M.on\n0,off\n0.3,high\n0.6,2\n")
    with ec.load(str(path), input=[ec.Input(table)], step_size=STEP, stop_time=1.0).prepare() as simulation:
        result = simulation.run()
    assert [int(x) for x in result["input.M.on"]] == [1, 1, 1, 4, 4, 4, 2, 2, 2, 2, 2]
