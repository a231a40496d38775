"""References of FMUs with inputs of all types, judged by FMPy with the same input file."""

from enum import IntEnum
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.util import read_csv

import emla_cosim as ec
from emla_cosim.verification.settings import Settings
from emla_cosim.verification.verdict import Verdict
from fmublock import Block, DefaultExperiment, Input, Output, build
from tests.support.broken.examining import examine


class Mode(IntEnum):
    """An enumeration."""

    OFF = 1
    ON = 2


class Typed(Block):
    """Outputs that are the inputs."""

    default_experiment = DefaultExperiment(stop_time=2.0, step_size=0.1)

    u = Input(0.0)
    i = Input(0)
    b = Input(False)
    e = Input(Mode.OFF)
    u_out = Output(0.0)
    i_out = Output(0)
    b_out = Output(False)
    e_out = Output(Mode.OFF)

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"u_out": v.u, "i_out": v.i, "b_out": v.b, "e_out": v.e}


EVENTS = "time,u,i,b,e\n0,0,1,0,1\n0.5,1,1,0,1\n0.5,3,-7,1,2\n1.3,4,-7,1,2\n1.3,4,99,0,1\n2,0,99,0,1\n"
"""Two events, each with a row before and one after."""


@pytest.fixture(scope="module")
def fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(Typed, tmp_path_factory.mktemp("typed") / "Typed.fmu")


@pytest.mark.parametrize("source", ["steps", "events"])
def test_fmpy_computes_what_is_recorded(fmu: Path, tmp_path: Path, source: str) -> None:
    given = tmp_path / "given.csv"
    given.write_text(EVENTS)
    new = tmp_path / "new"
    new.mkdir()
    recording = ec.Recording(new, inputs=given if source == "events" else None)
    assert examine(fmu, settings=Settings(recording=recording), apart=()).passed
    inputs, expected = read_csv(new / "Typed_in.csv"), read_csv(new / "Typed_ref.csv")
    if source == "events":
        assert inputs["i"].tolist() == [1, 1, -7, -7, 99, 99]
        assert "given.csv" in (new / "Typed_ref.toml").read_text()
    found = fmpy.simulate_fmu(
        str(fmu),
        stop_time=2.0,
        output_interval=0.1,
        input=inputs,
        output=list(expected.dtype.names[1:]),
        fmi_type="CoSimulation",
    )
    for name in expected.dtype.names:
        assert np.abs(found[name].astype(float) - expected[name]).max() < 1e-12, name
        assert name == "time" or len(np.unique(expected[name])) > 1
    again = examine(fmu, "reference", settings=Settings(reference=new), apart=())["reference.agrees"]
    assert again.verdict == Verdict.PASSED, again.sentence


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("0,0,1.5,0,1", "the input i is 1.5 at t = 0 s; it is of type Integer and must be a whole number"),
        ("0,0,3e9,0,1", "the input i is 3e+09 at t = 0 s"),
        ("0,0,1,2,1", "the input b is 2 at t = 0 s; it is of type Boolean and must be 0 or 1"),
        ("0,0,1,nan,1", "the input b is nan at t = 0 s"),
    ],
)
def test_invalid_values_of_inputs(fmu: Path, tmp_path: Path, row: str, message: str) -> None:
    given = tmp_path / "given.csv"
    given.write_text(f"time,u,i,b,e\n{row}\n2,0,1,0,1\n")
    with pytest.raises(ec.CommandError) as error:
        ec.verify(fmu, record=ec.Recording(tmp_path / "new", inputs=given))
    assert message in str(error.value)


def test_folder_stands_for_its_fmus_and_git_lfs_pointers_are_named(fmu: Path, tmp_path: Path) -> None:
    folder = tmp_path / "many"
    (folder / "deep").mkdir(parents=True)
    (folder / "deep" / "Typed.fmu").write_bytes(fmu.read_bytes())
    (folder / "Stored.fmu").write_text("version https://git-lfs.github.com/spec/v1\noid sha256:0\nsize 9\n")
    report = ec.verify(folder, only="archive.safe")
    assert [one.label for one in report.examined] == [f"{folder}/Stored.fmu", f"{folder}/deep/Typed.fmu"]
    assert report["Stored.fmu"]["archive.safe"].sentence == "The file is a pointer of Git LFS, not the FMU."
    assert report["Typed.fmu"].passed
    (tmp_path / "empty").mkdir()
    with pytest.raises(ec.CommandError, match="has no FMU and no SSP"):
        ec.verify(tmp_path / "empty")
