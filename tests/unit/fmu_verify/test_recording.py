"""References made of a run of the FMU."""

import os
import tomllib
from enum import IntEnum
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.util import read_csv

import emla_cosim as ec
from fmu_verify.check import Verdict
from fmu_verify.findings import Finding
from fmu_verify.references.judgment import sample_inputs
from fmu_verify.references.recording import SHAPES, excite_inputs
from fmu_verify.settings import Settings
from fmublock import Block, DefaultExperiment, Input, Output, Parameter, build
from tests.support.broken.examining import examine
from tests.support.commands import Emla, sentence
from tests.support.toy_fmu import copy_toy


class Mode(IntEnum):
    """An enumeration."""

    OFF = 1
    ON = 2


class Typed(Block):
    """Outputs that are the inputs, one of them k times."""

    default_experiment = DefaultExperiment(stop_time=2.0, step_size=0.1)

    u = Input(0.0)
    i = Input(0)
    b = Input(False)
    e = Input(Mode.OFF)
    k = Parameter(1.0)
    u_out = Output(0.0)
    i_out = Output(0)
    b_out = Output(False)
    e_out = Output(Mode.OFF)

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"u_out": v.k * v.u, "i_out": v.i, "b_out": v.b, "e_out": v.e}


EVENTS = "time,u,i,b,e\n0,0,1,0,1\n0.5,1,1,0,1\n0.5,3,-7,1,2\n1.3,4,-7,1,2\n1.3,4,99,0,1\n2,0,99,0,1\n"
"""Two events, each with a row before and one after."""


@pytest.fixture(scope="module")
def typed_fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(Typed, tmp_path_factory.mktemp("typed") / "Typed.fmu")


def test_references_of_all_types_of_fmi_3(tmp_path: Path) -> None:
    fmu = build(Typed, tmp_path / "Typed.fmu", fmi=3)
    record(fmu, tmp_path)
    finding = compare(fmu, tmp_path, relative=1e-14)
    assert finding.verdict == Verdict.PASSED, finding.sentence


@pytest.fixture(scope="module")
def toy_fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return copy_toy(tmp_path_factory.mktemp("toy") / "Toy.fmu")


def record(fmu: Path, folder: Path, **options: Any) -> None:
    """Record references of an FMU in a folder."""
    folder.mkdir(exist_ok=True)
    assert examine(fmu, settings=Settings(recording=ec.Recording(folder, **options)), apart=()).passed


def compare(fmu: Path, folder: Path, relative: float) -> Finding:
    tolerance = {"*": ec.Tolerance(relative=relative, time=0.0)}
    settings = Settings(reference=folder, tolerance=tolerance)
    return examine(fmu, "reference.agrees", settings=settings, apart=())["reference.agrees"]


@pytest.mark.parametrize("source", [*SHAPES, "given.csv"])
def test_fmpy_computes_what_is_recorded(source: str, typed_fmu: Path, tmp_path: Path) -> None:
    """As does a second run, to the last digits."""
    (input_file := tmp_path / "given.csv").write_text(EVENTS)
    new, values = tmp_path / "new", {"k": 3.0}
    how = {"inputs": input_file} if source == input_file.name else {"shape": source}
    record(typed_fmu, new, values=values, **how)
    inputs, expected = read_csv(new / "Typed_in.csv"), read_csv(new / "Typed_ref.csv")
    assert source in SHAPES or inputs["i"].tolist() == [1, 1, -7, -7, 99, 99]
    outputs = list(expected.dtype.names[1:])
    assert outputs == ["u_out", "i_out", "b_out", "e_out"]
    rows_of_fmpy = fmpy.simulate_fmu(
        str(typed_fmu),
        stop_time=2.0,
        output_interval=0.1,
        start_values=values,
        input=inputs,
        output=outputs,
        fmi_type="CoSimulation",
    )
    for name in expected.dtype.names:
        assert np.abs(rows_of_fmpy[name].astype(float) - expected[name]).max() < 1e-12, name
        assert len(np.unique(expected[name])) > 1
    second_finding = compare(typed_fmu, new, relative=1e-14)
    assert second_finding.verdict == Verdict.PASSED, second_finding.sentence
    assert [c.signal for c in second_finding.outcome.comparisons] == outputs
    about = tomllib.loads((new / "Typed_ref.toml").read_text())
    assert about["made_by"].startswith("emla verify --record, ")
    assert "Typed.fmu" in about["made_by"] and source in about["made_by"]
    assert about["set"] == values


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("0,0,1.5,0,1", "has 1.5 in row 1 of the column 'i', which is not an Integer"),
        ("0,0,3e9,0,1", "has 3e+09 in row 1 of the column 'i', which is not an Integer"),
        ("0,0,1,2,1", "has 2 in row 1 of the column 'b', which is not a Boolean"),
        ("0,0,1,nan,1", "has 'nan' in row 1 of the column 'b'; it must be true, false, 1 or 0"),
    ],
)
def test_invalid_values_of_inputs(typed_fmu: Path, tmp_path: Path, row: str, message: str) -> None:
    input_file = tmp_path / "given.csv"
    input_file.write_text(f"time,u,i,b,e\n{row}\n2,0,1,0,1\n")
    with pytest.raises(ec.CommandError) as error:
        ec.verify(typed_fmu, record=ec.Recording(tmp_path / "new", inputs=input_file))
    assert message in str(error.value)


def test_many_steps_become_fewer_rows(fmu_folder: Path, tmp_path: Path) -> None:
    fmu = fmu_folder / "EmlaPlant" / "EmlaPlant.fmu"
    record(fmu, tmp_path, stop=0.5, step=1e-4)
    rows = read_csv(tmp_path / "EmlaPlant_ref.csv")
    assert len(rows) == 1001
    assert rows["time"][-1] == 0.5
    assert compare(fmu, tmp_path, relative=1e-12).verdict == Verdict.PASSED


def test_inputs_of_an_earlier_recording_are_removed(fmu_folder: Path, tmp_path: Path) -> None:
    earlier_inputs = tmp_path / "Reference_in.csv"
    earlier_inputs.write_text("time,x\n0,1\n")
    record(fmu_folder / "Reference" / "Reference.fmu", tmp_path, overwrite=True)
    assert not earlier_inputs.exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--set", "body.mas=3"], "Toy has no variable 'body.mas'; did you mean body.mass?"),
        (["--set", "body.mass=99"], "Toy.body.mass = 99 kg is out of range"),
        (["--set", "power=1"], "Toy.power cannot be set: it is computed by the FMU."),
        (["--excite", "bumps"], "there is no shape 'bumps'; choose from steps, ramps and chirps."),
        (["--input", "nowhere.csv"], "the inputs 'nowhere.csv' cannot be read"),
        (["--stop-time", "-1"], "the stop time -1 s must be after the start, 0 s."),
        (["--step-size", "0"], "the step size 0 s must be a positive number."),
        (["--step-size", "1e-9"], "steps of 1e-09 s are too many to record; set --stop-time"),
    ],
)
def test_invalid_options_of_a_recording(
    arguments: list[str], message: str, toy_fmu: Path, tmp_path: Path, emla: Emla
) -> None:
    assert message in sentence(emla("verify", str(toy_fmu), "--record", "new", *arguments), 2)
    assert not list(tmp_path.glob("new/*"))


def test_recording_options_need_record_and_a_folder(toy_fmu: Path, emla: Emla) -> None:
    assert "need --record" in sentence(emla("verify", str(toy_fmu), "--stop-time", "1"), 2)
    message = sentence(emla("verify", str(toy_fmu), "--record", str(toy_fmu)), 2)
    assert message == f"Error: the folder '{toy_fmu}' cannot be created: File exists."


@pytest.mark.skipif(os.name != "posix", reason="Links need special rights on Windows.")
def test_link_is_not_followed(toy_fmu: Path, tmp_path: Path, emla: Emla) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "real" / "Toy_ref.csv").write_text("mine")
    (tmp_path / "Toy_ref.csv").symlink_to(tmp_path / "real" / "Toy_ref.csv")
    for more in ((), ("--overwrite",)):
        text = sentence(emla("verify", str(toy_fmu), "--record", str(tmp_path), *more), 2)
        assert "it is a symbolic link" in text
    assert (tmp_path / "real" / "Toy_ref.csv").read_text() == "mine"


LEVELS = SimpleNamespace(items=[SimpleNamespace(value=v) for v in (3, 5, 8)])
RANGES: dict[str, dict[str, Any]] = {
    "free": {"start": "2"},
    "free, at 0": {"start": "0"},
    "from its start up": {"start": "2", "min": "2"},
    "up to its start": {"start": "2", "max": "2"},
    "from 0 up, nominal 50": {"start": "0", "min": "0", "nominal": "50"},
    "up to 0": {"start": "-1e-3", "max": "0", "nominal": "50"},
    "both": {"start": "7", "min": "-1", "max": "7"},
    "whole": {"type": "Integer", "start": "1", "min": "0", "max": "9"},
    "truth": {"type": "Boolean"},
    "literal": {"type": "Enumeration", "declaredType": LEVELS, "start": "5"},
}
"""Inputs by what is declared of them."""


@pytest.mark.parametrize("begin", [0.0, 2.5])
@pytest.mark.parametrize("shape", SHAPES)
def test_inputs_move_within_any_declared_range(shape: str, begin: float) -> None:
    usual = {"causality": "input", "type": "Real", "declaredType": None}
    usual |= dict.fromkeys(("min", "max", "nominal", "start"))
    variables = [SimpleNamespace(**{**usual, "name": name, **of}) for name, of in RANGES.items()]
    subject: Any = SimpleNamespace(description=SimpleNamespace(modelVariables=variables))
    columns = excite_inputs(subject, shape, np.linspace(begin, begin + 1.0, 2001))
    least = {"truth": 0.0, "literal": 3.0}
    most = {"truth": 1.0, "literal": 8.0}
    for name, of in RANGES.items():
        values = columns[name]
        assert len(np.unique(values)) > 1, name
        assert values.min() >= float(of.get("min", least.get(name, -np.inf))), name
        assert values.max() <= float(of.get("max", most.get(name, np.inf))), name
        assert of.get("type", "Real") == "Real" or (values == np.round(values)).all(), name


@pytest.mark.parametrize(
    ("type_", "variability"), [("Real", "discrete"), ("Integer", None), ("Boolean", None)]
)
@pytest.mark.parametrize("begin", [0.0, 0.1, -0.3, 1e3])
def test_discrete_inputs_change_in_their_row(type_: str, variability: str | None, begin: float) -> None:
    """However times are rounded: as they are written in a file, and as a number of steps."""
    variable = SimpleNamespace(name="u", causality="input", type=type_, variability=variability)
    subject: Any = SimpleNamespace(variables={"u": variable})
    times = begin + 1e-3 * np.arange(1001)
    rows = np.array([float(f"{t:.9g}") for t in times])
    values = np.arange(1001.0) % 2 if type_ == "Boolean" else np.arange(1001.0)
    inputs = sample_inputs(subject, {"time": rows, "u": values}, times)
    np.testing.assert_array_equal(inputs["u"], values)
    expected = values[: len(rows[::10])]
    between = sample_inputs(subject, {"time": rows[::10], "u": expected}, times)
    np.testing.assert_array_equal(between["u"], expected[np.arange(1001) // 10])
