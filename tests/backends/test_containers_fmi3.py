"""A system as one FMU for FMI 3.0: it gives the bits of a run, as that for FMI 2.0 does."""

import re
import zipfile
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path
from typing import Any

import fmpy
import lief
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu
from lxml import etree

import emla_cosim as ec
from emla_cosim.base.errors import CommandError
from tests.backends.test_containers import STEP, all_types, assert_same, load, outputs, without_sources

__all__ = ["all_types"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("containers")


@pytest.fixture(scope="module")
def lift(fmu_folder: Path, folder: Path) -> Path:
    return load("lift", fmu_folder).export(folder / "lift.fmu", outputs=["*"], fmi=3)


@pytest.fixture(scope="module")
def older(fmu_folder: Path, folder: Path) -> Path:
    """The same for FMI 2.0."""
    return load("lift", fmu_folder).export(folder / "older.fmu", outputs=["*"])


@pytest.fixture(scope="module")
def pair(fmu_folder: Path, folder: Path, all_types: Path) -> Path:
    """Two FMUs that are carried along, with variables of all types of FMI 2.0."""
    system = ec.System.of({"a": all_types, "b": all_types}, ["a.high -> b.on"])
    scenario = load(system, fmu_folder, step_size=0.01, stop_time=0.5, output_interval=0.02)
    return scenario.export(folder / "pair.fmu", outputs=["*"], fmi=3)


class Host:
    """An instance in FMPy. Its files are in a folder with characters that a URI does not have."""

    def __init__(self, fmu: Path, folder: Path, **options: Any) -> None:
        description = fmpy.read_model_description(str(fmu))
        self.references = {v.name: v.valueReference for v in description.modelVariables}
        self.messages = list[str]()
        place = folder / "é 100% #1"
        fmpy.extract(str(fmu), str(place))
        self.fmu: Any = FMU3Slave(
            guid=description.instantiationToken,
            unzipDirectory=str(place),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="host",
        )
        self.fmu.instantiate(logMessage=lambda *message: self.messages.append(message[3].decode()), **options)

    def begin(self, **times: float) -> None:
        self.fmu.enterInitializationMode(**times)
        self.fmu.exitInitializationMode()

    def read(self, *names: str) -> list[float]:
        return list(self.fmu.getFloat64([self.references[name] for name in names]))


@pytest.fixture
def host(lift: Path, tmp_path: Path) -> Iterator[Host]:
    made = Host(lift, tmp_path)
    yield made
    made.fmu.freeInstance()


def test_a_joint_has_the_bits_of_a_run(lift: Path, fmu_folder: Path) -> None:
    assert_same(lift, load("lift", fmu_folder), 1e-3)


def test_strong_coupling_in_a_system_of_ours(fmu_folder: Path, tmp_path: Path) -> None:
    """The machine as one FMU for FMI 3.0 is a component of another system."""
    scenario = load("hdrm-coupled", fmu_folder, stop_time=0.01)
    fmu = scenario.export(tmp_path / "machine.fmu", fmi=3, outputs=["*.x_L", "*.F_L"])
    with scenario.prepare() as simulation:
        expected = simulation.run()
    outer = ec.System.of({"machine": fmu})
    with load(outer, fmu_folder, step_size=1e-3, stop_time=0.01).prepare() as simulation:
        found = simulation.run()
    compared = [n for n in outputs(fmu) if n in expected.names]
    assert len(compared) >= 6
    for name in compared:
        np.testing.assert_array_equal(found[f"machine.{name}"], expected[name])


def test_documents_follow_the_published_schemas(lift: Path, pair: Path) -> None:
    for fmu in (lift, pair):
        assert validate_fmu(str(fmu)) == []
    found = {"modelDescription.xml": "ModelDescription", "sources/buildDescription.xml": "BuildDescription"}
    with zipfile.ZipFile(lift) as archive:
        for name, schema in found.items():
            place = files("fmpy").joinpath("schema", "fmi3", f"fmi3{schema}.xsd")
            etree.XMLSchema(etree.parse(str(place))).assertValid(etree.fromstring(archive.read(name)))
        names = archive.namelist()
    assert not [n for n in names if re.match(r"sources/fmi2_", n)]
    with zipfile.ZipFile(pair) as archive:  # its sources alone are no FMU
        assert "sources/buildDescription.xml" not in archive.namelist()


def test_its_description_is_that_of_fmi_2(lift: Path, older: Path) -> None:
    """Variables with units, ranges and start values, and the structure."""
    with zipfile.ZipFile(lift) as three, zipfile.ZipFile(older) as two:
        new, old = (etree.fromstring(a.read("modelDescription.xml")) for a in (three, two))
    found = {v.get("name"): dict(v.attrib) for v in new.find("ModelVariables")}
    time = found.pop("time")
    assert (time["causality"], time["unit"]) == ("independent", "s")
    expected = {
        v.get("name"): {k: x for k, x in (*v.items(), *v[0].items()) if k != "declaredType"}
        for v in old.find("ModelVariables")
    }
    assert {n: {k: x for k, x in v.items() if k != "declaredType"} for n, v in found.items()} == expected
    structure = new.find("ModelStructure")
    for tag, place in (("Output", "Outputs"), ("InitialUnknown", "InitialUnknowns")):
        indices = [int(u.get("index")) - 1 for u in old.find(f"ModelStructure/{place}")]
        assert [int(u.get("valueReference")) for u in structure.findall(tag)] == indices


def test_all_types(pair: Path, tmp_path: Path) -> None:
    """A library is loaded from the resources; enumerations are Int64, and texts pass."""
    host = Host(pair, tmp_path)
    kinds = {v.name: v.type for v in fmpy.read_model_description(str(pair)).modelVariables}
    assert {kinds[f"a.{n}"] for n in ("u", "count", "mode", "high", "text")} == {
        *("Float64", "Int32", "Enumeration", "Boolean", "String")
    }
    reference, fmu = host.references, host.fmu
    fmu.setFloat64([reference["a.u"]], [3.0])
    fmu.setInt32([reference["a.first"]], [5])
    fmu.setBoolean([reference["a.on"]], [True])
    host.begin()
    for k in range(10):
        fmu.doStep(k * 0.01, 0.01)
    assert host.read("a.x", "time") == pytest.approx([0.3, 0.1])
    assert list(fmu.getInt32([reference["a.count"]])) == [5 + 1]
    assert list(fmu.getInt64([reference["a.mode"]])) in ([1], [2], [4])
    assert list(fmu.getBoolean([reference["a.high"], reference["b.high"]])) == [True, False]
    assert list(fmu.getString([reference["a.text"]])) == ["count is 6, high"]
    with pytest.raises(FMICallException):
        fmu.getInt32([reference["a.mode"]])
    assert "a.mode is of type Enumeration (Int64)" in host.messages[-1]
    fmu.freeInstance()


def test_a_state_is_continued_with_the_same_bits(lift: Path, host: Host) -> None:
    names, fmu = outputs(lift), host.fmu
    host.begin()
    fmu.doStep(0.0, 30 * STEP)
    state = fmu.getFMUState()
    content = fmu.serializeFMUState(state)
    fmu.doStep(30 * STEP, 30 * STEP)
    expected = host.read(*names)
    fmu.setFMUState(state)
    assert host.read("time") == [30 * STEP]
    fmu.doStep(30 * STEP, 30 * STEP)
    assert host.read(*names) == expected
    fmu.freeFMUState(state)
    fmu.reset()
    host.begin()
    fmu.setFMUState(fmu.deserializeFMUState(content))
    fmu.doStep(30 * STEP, 30 * STEP)
    assert host.read(*names) == expected


def test_steps_and_their_answers(host: Host) -> None:
    host.begin(stopTime=0.01)
    assert host.fmu.doStep(0.0, STEP)[1:] == (False, False, STEP)
    for step, message in ((1.5 * STEP, "not a multiple"), (0.02, "goes past the stop time")):
        with pytest.raises(FMICallException):
            host.fmu.doStep(STEP, step)
        assert message in host.messages[-1]
    assert host.fmu.doStep(STEP, STEP)[3] == 2 * STEP


def test_what_it_has_not_is_refused(host: Host, lift: Path, tmp_path: Path) -> None:
    for call in (host.fmu.enterEventMode, host.fmu.enterStepMode, host.fmu.enterConfigurationMode):
        with pytest.raises(FMICallException):
            call()
        assert "this FMU has no" in host.messages[-1]
    with pytest.raises(Exception, match="instantiate"):
        Host(lift, tmp_path / "other", eventModeUsed=True)


def test_its_functions_are_those_of_the_standard(lift: Path, older: Path) -> None:
    """Of FMI 2.0 those of co-simulation."""
    for fmi, fmu in ((2, older), (3, lift)):
        assert list(exported(fmu).values()) == [functions(fmi)]


@pytest.mark.slow
@pytest.mark.parametrize("fmi", [2, 3])
def test_every_platform_has_them(fmi: int, tmp_path: Path) -> None:
    platforms = ["linux64", "win64", "darwin64", "aarch64-linux", "aarch64-darwin"]
    fmu = load("lift", tmp_path / "fmus").export(tmp_path / "all.fmu", platform=platforms, fmi=fmi)
    found = exported(fmu)
    folders = {"x86_64-linux", "x86_64-windows", "x86_64-darwin", "aarch64-linux", "aarch64-darwin"}
    assert set(found) == (set(platforms) if fmi == 2 else folders)
    for platform, names in found.items():
        assert names == functions(fmi), platform


def functions(fmi: int) -> set[str]:
    """The functions that a co-simulation FMU needs, from the standard's header."""
    header = files("fmpy").joinpath("c-code", f"fmi{fmi}Functions.h").read_text()
    if fmi == 2:
        first, _, rest = header.rpartition("Functions for FMI2 for Model Exchange")
        header = first + rest.partition("Functions for FMI2 for Co-Simulation")[2]
    found = set(re.findall(rf"^\s*FMI{fmi}_Export\s+fmi{fmi}\w+TYPE\s+(fmi{fmi}\w+);", header, re.MULTILINE))
    assert len(found) == {2: 34, 3: 75}[fmi]
    return found


def exported(fmu: Path) -> dict[str, set[str]]:
    """All names that the libraries export, by the folder in binaries/."""
    found = {}
    with zipfile.ZipFile(fmu) as archive:
        for name in archive.namelist():
            if not name.startswith("binaries/"):
                continue
            parsed = lief.parse(list(archive.read(name)))
            assert parsed is not None, name
            if isinstance(parsed, lief.PE.Binary):
                table = parsed.get_export()
                assert table is not None
                names = {str(entry.name) for entry in table.entries}
            else:
                names = {str(symbol.name) for symbol in parsed.exported_symbols}
            if isinstance(parsed, lief.MachO.Binary):  # the other names are of the linker
                names = {n.removeprefix("_") for n in names if n.startswith("_fmi")}
            found[name.split("/")[1]] = names
    return found


def test_only_fmus_have_a_version(fmu_folder: Path, tmp_path: Path) -> None:
    for file, flag in (("x.ssp", "an SSP cannot hold --fmi"), ("x.c", "a C file cannot hold --fmi")):
        with pytest.raises(CommandError, match=flag):
            load("lift", fmu_folder).export(tmp_path / file, fmi=3)
    with pytest.raises(CommandError, match="choose from 2 and 3"):
        load("lift", fmu_folder).export(tmp_path / "x.fmu", fmi=4)
    assert list(tmp_path.iterdir()) == []


def test_a_foreign_plant_is_carried_along(fmu_folder: Path, tmp_path: Path) -> None:
    plant = without_sources(fmu_folder / "EmlaPlant/EmlaPlant.fmu", tmp_path / "Plant.fmu")
    changed = load("lift", fmu_folder, replace={"lift.plant": plant})
    assert_same(changed.export(tmp_path / "carried.fmu", outputs=["*"], fmi=3), changed)
