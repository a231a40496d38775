"""What OMSimulator 3.0.0 needs of a package, held against the XML that is exported.

It refuses elements that it does not know, stops reading a parameter set at the first name that the component
does not have, and reads no system that does not say how it is run.
"""

import zipfile
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import pytest
from typer.testing import CliRunner

from emla_cosim.cli.app import app
from emla_cosim.fmu.interface import read_interface
from tests.support.paths import FOREIGN_MAPPING

ROOT = "http://ssp-standard.org/SSP1/SystemStructure"
NAMESPACES = {
    "ssd": f"{ROOT}Description",
    "ssc": f"{ROOT}Common",
    "ssv": f"{ROOT}ParameterValues",
    "ssm": f"{ROOT}ParameterMapping",
    "oms": "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd",
}
KNOWN = {
    "System": {
        "Connectors",
        "ElementGeometry",
        "ParameterBindings",
        "Elements",
        "Connections",
        "Annotations",
    },
    "Component": {"Connectors", "ElementGeometry", "ParameterBindings"},
}
"""The elements that it reads inside a system and a component."""


@pytest.fixture(scope="module", params=["flat", "nested"])
def package(
    request: pytest.FixtureRequest,
    fmu_folder: Path,
    foreign_plant: Path,
    tmp_path_factory: pytest.TempPathFactory,
) -> Path:
    """The printed study, which has enumerations and Booleans, with a plant of somebody else; unpacked."""
    folder = tmp_path_factory.mktemp("package")
    options = ["--nested"] if request.param == "nested" else []
    options += ["--replace", f"tilt.plant={foreign_plant}", "--mapping", f"tilt.plant={FOREIGN_MAPPING}"]
    command = ["export", "published", str(folder / "x.ssp"), "--fmus", str(fmu_folder), *options]
    result = CliRunner().invoke(app, command)
    assert result.exit_code == 0, result.output
    with zipfile.ZipFile(folder / "x.ssp") as archive:
        archive.extractall(folder)
    return folder


def elements(package: Path, kind: str) -> list[ElementTree.Element]:
    """All systems or components of the package."""
    found = ElementTree.parse(package / "SystemStructure.ssd").findall(f".//ssd:{kind}", NAMESPACES)
    assert found
    return found


def local(element: ElementTree.Element) -> str:
    return element.tag.rpartition("}")[2]


@pytest.mark.parametrize("kind", KNOWN)
def test_elements_are_those_that_it_knows(package: Path, kind: str) -> None:
    for element in elements(package, kind):
        assert {local(e) for e in element} <= KNOWN[kind], element.get("name")


def test_every_system_says_its_step_size(package: Path) -> None:
    path = (
        "ssd:Annotations/ssc:Annotation[@type='org.openmodelica']/oms:Annotations"
        "/oms:SimulationInformation/oms:FixedStepMaster"
    )
    systems = elements(package, "System")
    nested = any(s.find("ssd:Elements/ssd:System", NAMESPACES) is not None for s in systems)
    assert len(systems) == (4 if nested else 1)
    for system in systems:
        (master,) = system.findall(path, NAMESPACES)
        assert float(master.attrib["stepSize"]) == 5e-6


def files(package: Path, component: ElementTree.Element) -> Iterator[tuple[str, str | None]]:
    """The parameter sets that a component names, each with its mapping."""
    for binding in component.findall("ssd:ParameterBindings/ssd:ParameterBinding", NAMESPACES):
        mapping = binding.find("ssd:ParameterMapping", NAMESPACES)
        yield binding.attrib["source"], None if mapping is None else mapping.attrib["source"]


def test_every_component_has_a_parameter_set_of_its_own(package: Path) -> None:
    named = [source for c in elements(package, "Component") for source, _ in files(package, c)]
    assert len(named) == 15
    assert len(set(named)) == 15
    assert {f"resources/{f.name}" for f in package.rglob("*.ssv")} == set(named)


def test_a_set_names_nothing_that_its_component_does_not_have(package: Path) -> None:
    mapped = 0
    for component in elements(package, "Component"):
        interface = read_interface(package / component.attrib["source"])
        ((source, mapping),) = files(package, component)
        tree = ElementTree.parse(package / source)
        names = [p.attrib["name"] for p in tree.findall("ssv:Parameters/ssv:Parameter", NAMESPACES)]
        if mapping is not None:
            mapped += 1
            entries = ElementTree.parse(package / mapping).findall("ssm:MappingEntry", NAMESPACES)
            targets = {e.attrib["source"]: e.attrib["target"] for e in entries}
            names = [targets[name] for name in names]
        assert names
        assert [n for n in names if n not in interface.variables or not interface.is_settable(n)] == []
    assert mapped == 1
