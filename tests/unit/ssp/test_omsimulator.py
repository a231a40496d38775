"""What OMSimulator 3.0.0 needs of a package, compared with the XML that is exported.

It refuses elements that it does not know, stops reading a parameter set at the first name that the component
does not have, and reads no system that does not say how it is run. It accepts identifiers only as names.
"""

import re
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

import emla_cosim as ec
from emla_cosim import Fault
from emla_cosim.fmu.interface import read_interface
from emla_cosim.run.scenarios.built_in import SCENARIOS
from tests.support.paths import FOREIGN_MAPPING
from tests.support.paths import ROOT as REPOSITORY
from tests.support.tiers import mostly_slow

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


IDENTIFIER = re.compile("[a-zA-Z][a-zA-Z0-9_]*")
"""Its `ComRef::isValidIdent`."""

TYPES = {"Real", "Integer", "Boolean"}
"""The types of parameters that it reads; it leaves out all others, logs an error, and runs."""

FAULTS = {
    "freeze": Fault("lift.plant.x_measured", "freeze", 0.001),
    "offset": Fault("lift.plant.x_measured", "offset", 0.001, 0.0005, 1e-6),
    "gain": Fault("lift.observer.y", "gain", 0.001, value=0.999),
    "constant": Fault("lift.plant.d_2", "constant", 0.001, value=0.1),
}
CASES: dict[str, tuple[str, dict[str, Any]]] = {name: (name, {}) for name in SCENARIOS}
CASES |= {f"{kind} fault": ("lift", {"fault": [fault]}) for kind, fault in FAULTS.items()}
CASES |= {
    "published gains": ("study-drive", {"gains": "published"}),
    "commanded current": ("lift", {"set": {"lift.plant.use_commanded_current": True}}),
    "input": ("lift", {"input": "load.csv"}),
    "actuator": ("prototype", {"actuator": {"prototype": "axis.toml"}}),
}

QUICK = [name for name in CASES if name not in ("tilt", "telescope", "experiment-2")]


def unpack(scenario: ec.Scenario, folder: Path) -> Path:
    """The files of a scenario's package."""
    with zipfile.ZipFile(scenario.export(folder / "x.ssp")) as archive:
        archive.extractall(folder)
    return folder


def described(case: str, folder: Path, **more: Any) -> ec.Scenario:
    """The scenario of a case, with the files that it reads."""
    name, options = CASES[case]
    if "input" in options:
        table = folder / "load-force.csv"
        table.write_text("time,force in N\n0,1000\n0.001,2000\n0.01,1500\n")
        options = {"input": [f"{table}:lift.plant.F_L=force in N"]}
    if "actuator" in options:
        sheet = folder / "axis.toml"
        sheet.write_text((REPOSITORY / "docs/actuator.toml").read_text())
        options = {"actuator": {"prototype": sheet}}
    return ec.load(name, **options, **more)


@pytest.mark.parametrize("case", mostly_slow(CASES, QUICK))
def test_names_and_parameters_are_those_that_all_tools_read(
    case: str, fmu_folder: Path, tmp_path: Path
) -> None:
    package = unpack(described(case, tmp_path, fmus=fmu_folder), tmp_path)
    root = ElementTree.parse(package / "SystemStructure.ssd").getroot()
    components = elements(package, "Component")
    names = [root.attrib["name"], *(e.attrib["name"] for e in (*elements(package, "System"), *components))]
    assert [name for name in names if not IDENTIFIER.fullmatch(name)] == []
    assert len({c.attrib["name"] for c in components}) == len(components)
    for component in components:
        interface = read_interface(package / component.attrib["source"])
        connectors = component.findall("ssd:Connectors/ssd:Connector", NAMESPACES)
        assert {c.attrib["name"] for c in connectors} <= interface.variables.keys()
        for source, mapping in files(package, component):
            assert mapping is None
            for parameter in ElementTree.parse(package / source).iterfind(".//ssv:Parameter", NAMESPACES):
                (value,) = parameter
                name = parameter.attrib["name"]
                assert interface.variables[name].type == local(value)
                assert local(value) in TYPES and interface.is_settable(name)


@pytest.mark.parametrize("case", mostly_slow(CASES, QUICK))
def test_the_package_gives_the_same_bits(case: str, fmu_folder: Path, tmp_path: Path) -> None:
    original = described(case, tmp_path, fmus=fmu_folder)
    package = ec.load(original.export(tmp_path / "x.ssp"))
    assert package.name == original.name and package.notes == ()
    options = {"algorithm": original.options.algorithm, **original.options.own}
    step = original.options.step_size
    times = {"stop_time": float(f"{20 * step:.12g}"), "output_interval": step}
    with original.prepare() as simulation:
        expected = simulation.attempt(**times)  # the printed gains diverge on a drive
    with package.prepare(**options) as simulation:
        found = simulation.attempt(**times)
    assert found.signals.keys() == expected.signals.keys()
    for signal in expected.signals:
        assert found[signal].tobytes() == expected[signal].tobytes(), signal


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


@pytest.fixture(scope="module")
def package(fmu_folder: Path, foreign_plant: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The printed study, which has Booleans, with a plant of somebody else; unpacked."""
    replaced = {"tilt.plant": {"fmu": foreign_plant, "mapping": FOREIGN_MAPPING}}
    return unpack(ec.load("published", fmus=fmu_folder, replace=replaced), tmp_path_factory.mktemp("package"))


def test_every_system_says_its_step_size(package: Path) -> None:
    path = (
        "ssd:Annotations/ssc:Annotation[@type='org.openmodelica']/oms:Annotations"
        "/oms:SimulationInformation/oms:FixedStepMaster"
    )
    (system,) = elements(package, "System")  # it has no fixed steps in systems inside of another
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
