"""Data sheets and their entries vary like edited files."""

from pathlib import Path
from typing import Any

import pytest

import emla_cosim as ec
from tests.support.commands import Emla, sentence
from tests.support.paths import ROOT
from tests.support.rigid_load import Half

pytestmark = pytest.mark.usefixtures("on_one_cluster")

SHEET = ROOT / "docs/actuator.toml"
SHORT_RUN: dict[str, Any] = {"stop_time": 0.4}


def edited(folder: Path, name: str, before: str, after: str) -> Path:
    """The data sheet with another text in it."""
    text = SHEET.read_text(encoding="utf-8")
    assert before in text
    (folder / name).write_text(text.replace(before, after), encoding="utf-8")
    return folder / name


def peak(file: Path, fmus: Path) -> float:
    result = ec.load("prototype", actuator={"prototype": file}, fmus=fmus, **SHORT_RUN).prepare().run()
    return result.metrics["joints"]["prototype"]["torque_peak_N_m"]


def test_derived_values_vary_with_an_entry(fmu_folder: Path, tmp_path: Path) -> None:
    """A lead changes plant, models of controller and observer, limits and gains."""
    lead = 'lead = "10 mm"'
    files = [edited(tmp_path, f"{mm}.toml", lead, f'lead = "{mm} mm"') for mm in (10, 14)]
    base = {"actuator": {"prototype": SHEET}, "fmus": fmu_folder, **SHORT_RUN}
    result = ec.sweep("prototype", {"actuator.screw.lead": "10mm:14mm:2"}, **base)
    assert result.variants["actuator.screw.lead"].to_list() == [10.0, 14.0]
    peaks = result.variants["prototype.torque_peak_N_m"].to_list()
    assert peaks == pytest.approx([peak(file, fmu_folder) for file in files], rel=1e-12)
    assert peaks[0] != pytest.approx(peaks[1], rel=0.01)
    assert result.options(1)["sheet"] == {"prototype.screw.lead": "14.0 mm"}


def test_files_vary_like_entries(fmu_folder: Path, tmp_path: Path) -> None:
    files = [edited(tmp_path, f"{n}.toml", 'M_BS = "60 kg"', f'M_BS = "{n} kg"') for n in (60, 200)]
    names = ",".join(map(str, files))
    result = ec.sweep("prototype", {"actuator.prototype": names}, fmus=fmu_folder, **SHORT_RUN)
    peaks = result.variants["prototype.torque_peak_N_m"].to_list()
    assert peaks == pytest.approx([peak(file, fmu_folder) for file in files], rel=1e-12)
    assert result.variants["actuator.prototype"].to_list() == [str(file) for file in files]


def test_entries_of_one_actuator_vary_together(fmu_folder: Path) -> None:
    vary = {
        "actuator.prototype.motor.R": "2 Ohm line to line,3 Ohm line to line",
        "actuator.gearbox.ratio": "4,5",
    }
    base = {"actuator": {"prototype": SHEET}, "stop_time": 0.01, "fmus": fmu_folder}
    result = ec.sweep("prototype", vary, **base)
    assert [result.options(i)["sheet"] for i in range(4)] == [
        {"prototype.motor.R": f"{R} Ohm line to line", "prototype.gearbox.ratio": ratio}
        for R in (2.0, 3.0)
        for ratio in (4, 5)
    ]


@pytest.mark.parametrize(
    ("scenario", "name", "values", "message"),
    [
        ("prototype", "actuator.screw.leed", "5mm,6mm", "did you mean 'lead'?"),
        ("prototype", "actuator.screw.lead", "5mm,1cm", "in different units: cm and mm"),
        ("prototype", "actuator.screw.lead", "5,6", "without a unit"),
        ("prototype", "actuator.scew.lead", "5mm,6mm", "'prototype.scew.lead' of a data sheet does not"),
        ("prototype", "actuator.screw", "5mm,6mm", "write actuator.JOINT"),
        ("study", "actuator.screw.lead", "5mm,6mm", "write actuator.JOINT"),
        ("prototype", "actuator.screw.lead", "80%:120%", "need values with their units"),
    ],
)
def test_invalid_names_are_refused(
    scenario: str, name: str, values: str, message: str, fmu_folder: Path
) -> None:
    with pytest.raises(ec.CommandError, match=message.replace("?", r"\?")):
        ec.sweep(scenario, {name: values}, stop_time=0.01, fmus=fmu_folder)


def test_entry_of_a_single_run(emla: Emla) -> None:
    change = ("--sheet", "prototype.screw.lead=8 mm")
    result = emla("run", "prototype", *change, "--stop-time", "0.01", "--no-plots")
    assert result.exit_code == 0, result.output
    assert "screw.lead 8 mm" in result.stdout
    text = 'system = "prototype"\nstop_time = 0.01\n\n[sheet]\nprototype.screw.lead = "7 mm"\n'
    Path("mine.toml").write_text(text, encoding="utf-8")
    assert "screw.lead 7 mm" in emla("run", "mine.toml", "--no-plots").stdout
    refused = emla("run", "lift", "--sheet", "tilt.screw.lead=8 mm", "--stop-time", "0.01")
    assert "there is no joint 'tilt'" in sentence(refused, 2)


def test_component_named_actuator_keeps_its_parameters() -> None:
    """Other people's systems have such components."""
    system = ec.System.of({"actuator": Half, "other": Half}, [])
    result = ec.sweep(system, {"actuator.k": "100:400:2"}, step_size=1e-2, stop_time=1e-2)
    assert [result.options(i)["set"] for i in range(2)] == [{"actuator.k": 100.0}, {"actuator.k": 400.0}]
