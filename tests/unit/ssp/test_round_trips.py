"""Packages that are exported, read and exported again are the same, byte for byte."""

import zipfile
from pathlib import Path
from typing import Any

import pytest

from emla_cosim.base.errors import CommandError
from emla_cosim.study.loading import load
from tests.support.paths import FOREIGN_MAPPING
from tests.support.ssp_documents import Understood, folder, understood

POWER = "lift.plant.tau_m * lift.plant.v_L"


@pytest.fixture(autouse=True)
def working_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def there_and_back(scenario: str, fmus: Path, **options: Any) -> Understood:
    """Export, export what was read, compare; return what is read at last."""
    load(scenario, fmus=fmus, **options).export(Path("first.ssp"))
    load("first.ssp", fmus=fmus).export(Path("second.ssp"))
    with zipfile.ZipFile("first.ssp") as first, zipfile.ZipFile("second.ssp") as second:
        assert first.namelist() == second.namelist()
        assert [n for n in first.namelist() if first.read(n) != second.read(n)] == []
    assert Path("first.ssp").read_bytes() == Path("second.ssp").read_bytes()
    return understood(Path("second.ssp"))


def replaced(name: str, plant: Path | str) -> dict[str, Any]:
    return {"replace": {name: {"fmu": plant, "mapping": FOREIGN_MAPPING}}}


def test_replaced_component(fmu_folder: Path, foreign_plant: Path) -> None:
    """Its file may have any name; a value set by the FMU's name leaves the mapping."""
    folder(Path("strange"), **{"Plant #1 100%__fmu": foreign_plant})
    options = replaced("lift.plant", "strange/Plant #1 100%.fmu")
    actual = there_and_back("lift", fmu_folder, **options)
    with zipfile.ZipFile("first.ssp") as archive:
        assert {"resources/lift_plant.ssm", "resources/Plant__1_100_.fmu"} < set(archive.namelist())
    plant, values = actual.system.component("lift.plant"), actual.values("lift.plant")
    assert plant.aliases["start.x_L"].variable == "Screw.Start_mm"
    assert values["Screw.Start_mm"] == pytest.approx(1e3 * 0.24 + 850.0)
    assert values["Motor.Rs_mOhm"] == pytest.approx(1e3 * plant.parameters["motor.R_s"])
    actual = there_and_back("first.ssp", fmu_folder, set={"lift.plant.Motor.Rs_mOhm": 77.0})
    assert actual.values("lift.plant")["Motor.Rs_mOhm"] == 77.0
    with pytest.raises(CommandError, match=r"lift\.plant\.motor\.R_s = much is not a number\."):
        load("lift", fmus=fmu_folder, **options, set={"lift.plant.motor.R_s": "much"}).export(Path("x.ssp"))


@pytest.fixture
def bonded(fmu_folder: Path) -> Path:
    """The unpacked package of a lift with two bonds."""
    scenario = load("lift", fmus=fmu_folder, bonds={"axis": POWER, "other": POWER})
    with zipfile.ZipFile(scenario.export(Path("lift.ssp"))) as archive:
        archive.extractall("unpacked")
    return Path("unpacked")


def test_sampled_components_and_bonds(bonded: Path, fmu_folder: Path) -> None:
    scenario, actual = load("lift", fmus=fmu_folder), load(bonded)
    samples = {c.name for c in scenario.system.components if c.samples}
    assert samples and samples < {c.name for c in actual.system.components}
    assert {c.name for c in actual.system.components if c.samples} == samples
    assert {name: str(bond) for name, bond in actual.system.bonds.items()} == {"axis": POWER, "other": POWER}
    assert not actual.notes
    repeated = load("lift.ssp", fmus=fmu_folder).export(Path("again.ssp"))
    assert repeated.read_bytes() == Path("lift.ssp").read_bytes()


@pytest.mark.parametrize(
    ("before", "after", "notes"),
    [
        ('Samples component="lift.observer"', 'Samples component="lift.o"', ["component 'lift.o' does"]),
        ('flow="lift.plant.v_L"', 'flow="lift.plant.v"', ["bond 'axis' is", "signal 'lift.plant.v' does"]),
        ('effort="lift.plant.tau_m"', 'effort="tau_m"', ["bond 'axis' is", "signal 'tau_m' does"]),
    ],
    ids=["component", "signal", "no component"],
)
def test_unknown_names_in_our_annotation_are_reported(
    before: str, after: str, notes: list[str], bonded: Path
) -> None:
    document = bonded / "SystemStructure.ssd"
    assert before in document.read_text()
    document.write_text(document.read_text().replace(before, after, 1))
    (note,) = load(bonded).notes
    assert all(words in note for words in notes)


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        (' flow="lift.plant.v_L"', "", "the element Bond has no flow"),
        ('name="other"', 'name="axis"', "two power bonds have the name 'axis'"),
    ],
)
def test_invalid_bonds(before: str, after: str, message: str, bonded: Path) -> None:
    document = bonded / "SystemStructure.ssd"
    document.write_text(document.read_text().replace(before, after))
    with pytest.raises(CommandError, match=message):
        load(bonded)
