"""What is exported, read and exported again is the same, byte for byte."""

import zipfile
from pathlib import Path

import pytest
from typer.testing import CliRunner

from emla_cosim.base.errors import CommandError
from emla_cosim.base.progress import Progress
from emla_cosim.cli.app import app
from emla_cosim.fmu.interface import read_interface
from emla_cosim.run.preparation import prepare_system
from emla_cosim.study.loading import load
from emla_cosim.system.resolution import resolve_system
from tests.support.paths import FOREIGN_MAPPING
from tests.support.ssp_documents import folder, understood

MAPPING = FOREIGN_MAPPING


@pytest.fixture(autouse=True)
def working_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def export(source: str, file: str, fmus: Path, *options: str) -> dict[str, bytes]:
    """The files of an exported package."""
    result = CliRunner().invoke(app, ["export", source, file, "--fmus", str(fmus), *options])
    assert result.exit_code == 0, result.output
    with zipfile.ZipFile(file) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def there_and_back(scenario: str, fmus: Path, *options: str) -> dict[str, bytes]:
    """Export, export what was read, and compare; returns the files."""
    first = export(scenario, "first.ssp", fmus, *options)
    assert export("first.ssp", "second.ssp", fmus) == first
    assert Path("first.ssp").read_bytes() == Path("second.ssp").read_bytes()
    return first


@pytest.mark.parametrize("scenario", ["study", "published"])
def test_scenarios(scenario: str, fmu_folder: Path) -> None:
    there_and_back(scenario, fmu_folder)


def test_sampled_components_and_bonds(fmu_folder: Path) -> None:
    bonds = {"axis": "lift.plant.tau_m * lift.plant.v_L"}
    scenario = load("lift", fmus=fmu_folder, bonds=bonds)
    file = scenario.export("sampled.ssp")
    found = load(file).system
    samples = {c.name for c in scenario.system.components if c.samples}
    assert samples and samples < {c.name for c in found.components}
    assert {c.name for c in found.components if c.samples} == samples
    assert {name: str(bond) for name, bond in found.bonds.items()} == bonds
    again = load(file, fmus=fmu_folder).export("again.ssp")
    assert again.read_bytes() == file.read_bytes()


def test_bond_without_a_signal_is_refused(fmu_folder: Path) -> None:
    scenario = load("lift", fmus=fmu_folder, bonds={"axis": "lift.plant.tau_m * lift.plant.v_L"})
    with zipfile.ZipFile(scenario.export("lift.ssp")) as archive:
        archive.extractall("unpacked")
    document = Path("unpacked/SystemStructure.ssd")
    document.write_text(document.read_text().replace(' flow="lift.plant.v_L"', ""))
    with pytest.raises(CommandError, match="the Bond has no 'flow'"):
        load("unpacked")


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
    before: str, after: str, notes: list[str], fmu_folder: Path
) -> None:
    scenario = load("lift", fmus=fmu_folder, bonds={"axis": "lift.plant.tau_m * lift.plant.v_L"})
    with zipfile.ZipFile(scenario.export("lift.ssp")) as archive:
        archive.extractall("unpacked")
    assert not load("unpacked").notes
    document = Path("unpacked/SystemStructure.ssd")
    assert before in document.read_text()
    document.write_text(document.read_text().replace(before, after))
    (note,) = load("unpacked").notes
    assert all(words in note for words in notes)


def test_two_bonds_of_one_name_are_refused(fmu_folder: Path) -> None:
    power = "lift.plant.tau_m * lift.plant.v_L"
    scenario = load("lift", fmus=fmu_folder, bonds={"axis": power, "other": power})
    with zipfile.ZipFile(scenario.export("lift.ssp")) as archive:
        archive.extractall("unpacked")
    document = Path("unpacked/SystemStructure.ssd")
    document.write_text(document.read_text().replace('name="other"', 'name="axis"'))
    with pytest.raises(CommandError, match="two power bonds have the name 'axis'"):
        load("unpacked")


def test_a_replaced_component(fmu_folder: Path, foreign_plant: Path) -> None:
    options = ["--replace", f"lift.plant={foreign_plant}", "--mapping", f"lift.plant={MAPPING}"]
    files = there_and_back("study", fmu_folder, *options)
    assert "resources/lift_plant.ssm" in files
    found = understood(Path("second.ssp"))
    plant = found.system.component("lift.plant")
    assert plant.aliases["start.x_L"].variable == "Screw.Start_mm"
    assert found.values("lift.plant")["Screw.Start_mm"] == pytest.approx(1e3 * 0.24 + 850.0)
    assert found.values("lift.plant")["Motor.Rs_mOhm"] == pytest.approx(1e3 * plant.parameters["motor.R_s"])


def test_one_name_with_a_value_for_each_component(fmu_folder: Path) -> None:
    step, force = "solver.internal_step", "model.A_eq"
    options = ["--set", f"lift.plant.{step}=3e-5", "--set", f"tilt.controller.{force}=0.0456"]
    there_and_back("study", fmu_folder, *options)
    found = understood(Path("second.ssp"))
    assert found.values("lift.plant")[step] == 3e-5
    assert step not in found.values("lift.controller")
    assert found.values("tilt.controller")[force] == 0.0456
    assert found.values("tilt.observer")[force] != 0.0456


def test_what_is_read_is_what_was_exported(fmu_folder: Path) -> None:
    """Names, connections and values."""
    export("study", "first.ssp", fmu_folder)
    study = load("study", fmus=fmu_folder)
    system, fmus = prepare_system(study.system, study.options, Progress())
    interfaces = {name: read_interface(file) for name, file in fmus.items()}
    expected, found = resolve_system(system, interfaces), understood(Path("first.ssp")).plain
    assert found.connections == expected.connections
    assert {c.name: c.parameters for c in found.components} == {
        c.name: c.parameters for c in expected.components
    }


def test_a_variable_set_by_the_name_of_the_fmu(fmu_folder: Path, foreign_plant: Path) -> None:
    """Our name for it is another one, which the mapping then leaves out."""
    options = ["--replace", f"lift.plant={foreign_plant}", "--mapping", f"lift.plant={MAPPING}"]
    export("lift", "first.ssp", fmu_folder, *options)
    export("first.ssp", "second.ssp", fmu_folder, "--set", "lift.plant.Motor.Rs_mOhm=77")
    export("second.ssp", "third.ssp", fmu_folder)
    assert Path("second.ssp").read_bytes() == Path("third.ssp").read_bytes()
    assert understood(Path("third.ssp")).values("lift.plant")["Motor.Rs_mOhm"] == 77.0


def test_a_value_of_a_replaced_component_that_is_no_number(fmu_folder: Path, foreign_plant: Path) -> None:
    options = ["--replace", f"lift.plant={foreign_plant}", "--mapping", f"lift.plant={MAPPING}"]
    more = ["--set", "lift.plant.motor.R_s=much", "--fmus", str(fmu_folder)]
    result = CliRunner().invoke(app, ["export", "lift", "first.ssp", *options, *more])
    assert result.exit_code == 2, result.output
    assert "lift.plant.motor.R_s = much is not a number." in result.stderr


def test_files_of_strange_names(fmu_folder: Path, foreign_plant: Path) -> None:
    folder(Path("strange"), **{"Plant #1 100%__fmu": foreign_plant})
    options = ["--replace", "lift.plant=strange/Plant #1 100%.fmu", "--mapping", f"lift.plant={MAPPING}"]
    files = there_and_back("lift", fmu_folder, *options)
    assert "resources/Plant__1_100_.fmu" in files
