"""FMUs that play tables: `emla build data.csv`."""

from pathlib import Path

import numpy as np
import polars
import pytest

import emla_cosim as ec
from emla_cosim.base.errors import CommandError
from emla_cosim.fmu.interface import read_interface
from emla_cosim.inputs.wired_inputs import build_data_fmu
from fmu_verify.check import Verdict
from fmublock.platforms import host_platform
from tests.support.commands import Emla, sentence

MEASURED = """t [ms];Force [kN];Weg (mm);Motor speed / rpm;note
0;3,0;240;10;a
100;3,4;240,4;20;b
200;3,1;241,5;30;c
"""


def build(folder: Path, content: str, settings: str = "", fmi: int = 2) -> tuple[Path, list[str]]:
    (folder / "measured.csv").write_text(content)
    return build_data_fmu(f"{folder / 'measured.csv'}{settings}", folder, [host_platform()], fmi=fmi)


def played(fmu: Path, **options) -> ec.Result:
    with ec.load(str(fmu), **options).prepare() as simulation:
        return simulation.run()


@pytest.mark.parametrize("fmi", [2, 3])
def test_outputs_have_values_and_units_of_the_columns(fmi: int, tmp_path: Path) -> None:
    fmu, notes = build(tmp_path, MEASURED, fmi=fmi)
    assert fmu == tmp_path / "measured" / "measured.fmu"
    assert any("columns of texts, which are left out: note" in note for note in notes)
    interface = read_interface(fmu)
    assert [str(interface.unit(n)) for n in ("Force", "Weg", "Motor speed")] == ["kN", "mm", "rpm"]
    result = played(fmu)
    np.testing.assert_allclose(result["time"], [0.0, 0.1, 0.2], atol=1e-15)
    assert result["measured.Force"].tolist() == [3.0, 3.4, 3.1]
    assert result["measured.Motor speed"].tolist() == [10.0, 20.0, 30.0]


@pytest.mark.slow
@pytest.mark.parametrize("fmi", [2, 3])
def test_fmus_of_data_conform(fmi: int, tmp_path: Path) -> None:
    fmu, _ = build(tmp_path, MEASURED, ":interpolation=cubic,x=Weg,v=der(Weg)", fmi)
    report = ec.verify(fmu)
    assert report.passed and not report.counts[Verdict.WARNING], str(report)
    assert str(read_interface(fmu).unit("v")) == "mm/s"


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize(
    ("settings", "values"),
    [
        (":interpolation=held", [0.0, 0.0, 2.0, 2.0, 1.0, 1.0]),
        (":interpolation=linear", [0.0, 1.0, 2.0, 1.5, 1.0, 1.0]),
        (":end=repeat", [0.0, 1.0, 2.0, 1.5, 0.0, 1.0]),
    ],
)
def test_settings_are_those_of_inputs(settings: str, values: list[float], fmi: int, tmp_path: Path) -> None:
    fmu, _ = build(tmp_path, "time,u\n0,0\n1,2\n2,1\n", settings, fmi)
    result = played(fmu, step_size=0.5, stop_time=2.5)
    assert result["measured.u"].tolist() == pytest.approx(values)


def test_booleans_beside_numbers_are_refused(tmp_path: Path) -> None:
    text = "time,on,u\n0,true,1\n1,false,2\n"
    with pytest.raises(CommandError, match=r"has Booleans \(on\) beside numbers, .*measured\.csv:on'"):
        build(tmp_path, text)
    fmu, _ = build(tmp_path, text, ":on")
    assert played(fmu, step_size=0.5)["measured.on"].tolist() == [True, True, False]


def test_parquet_with_units_in_its_metadata(tmp_path: Path) -> None:
    file = tmp_path / "p.parquet"
    frame = polars.DataFrame({"time": [0.0, 1.0], "F": [1.0, 2.0]})
    frame.write_parquet(file, metadata={"units": '{"time": "ms", "F": "kN"}'})
    fmu, _ = build_data_fmu(str(file), tmp_path, [host_platform()])
    assert str(read_interface(fmu).unit("F")) == "kN"
    assert played(fmu)["p.F"].tolist() == [1.0, 2.0]


def test_command_replaces_fmus_of_data_only(
    tmp_path: Path, emla: Emla, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("measured.csv").write_text(MEASURED)
    arguments = ["build", "measured.csv", "--platform", host_platform(), "--output", "fmus"]
    for _ in range(2):
        result = emla(*arguments)
        assert result.exit_code == 0 and Path("fmus/measured/measured.fmu").is_file(), result.output
    Path("fmus/measured/measured.fmu").write_bytes(b"mine")
    assert "was not written by emla" in sentence(emla(*arguments), 2)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["none.csv"], "the input 'none.csv' cannot be read"),
        (["measured.csv", "--set", "a=1"], "has data, for which there are only --fmi"),
        (["measured.csv", "--flavour", "python"], "for which there are only"),
        (["measured.csv:Weg", "measured.csv:Force"], "have the same name; build one at a time"),
        (["measured.csv:note"], "has no column of numbers"),
    ],
)
def test_wrong_commands(
    arguments: list[str], message: str, emla: Emla, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("measured.csv").write_text(MEASURED)
    assert message in sentence(emla("build", *arguments, "--output", "fmus"), 2)
