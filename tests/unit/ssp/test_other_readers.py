"""Exported packages as other tools read them: pyssp_standard with the schemas, and OMSimulator 3.0.0.

OMSimulator refuses elements that it does not know, stops reading a parameter set at the first name that the
component does not have, reads no system without its step size, and accepts only identifiers as names.
"""

import re
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from pyssp_standard.ssd import SSD
from pyssp_standard.ssd import System as TheirSystem
from pyssp_standard.ssm import SSM
from pyssp_standard.ssv import SSV
from pyssp_standard.standard import ModelicaStandard

import emla_cosim as ec
import emla_cosim.fmu.parameters
import emla_cosim.study.loading  # registers the built-in scenarios
from emla_cosim import Fault
from emla_cosim.fmu.interface import read_interface
from emla_cosim.run.scenarios.scenario_file import SCENARIOS
from emla_cosim.ssp.reader.flat_document import read_ssp
from tests.support.paths import FOREIGN_MAPPING, ROOT
from tests.support.tiers import mostly_slow

SCHEMAS = Path(emla_cosim.fmu.parameters.__file__).parent / "schemas"
STANDARD = "http://ssp-standard.org/SSP1/SystemStructure"
NAMESPACES = {
    "ssd": f"{STANDARD}Description",
    "ssc": f"{STANDARD}Common",
    "ssv": f"{STANDARD}ParameterValues",
    "ssm": f"{STANDARD}ParameterMapping",
}


def unpack(scenario: ec.Scenario, folder: Path) -> Path:
    """The files of a scenario's package, and the package as x.ssp."""
    with zipfile.ZipFile(scenario.export(folder / "x.ssp")) as archive:
        archive.extractall(folder)
    return folder


@pytest.fixture(scope="module")
def package(fmu_folder: Path, foreign_plant: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The printed study, which has Booleans, with a plant of another author; unpacked."""
    replaced = {"tilt.plant": {"fmu": foreign_plant, "mapping": FOREIGN_MAPPING}}
    return unpack(ec.load("published", fmus=fmu_folder, replace=replaced), tmp_path_factory.mktemp("package"))


# ---- pyssp_standard ----------------------------------------------------------------------------


def test_all_files_are_valid(package: Path) -> None:
    for kind, reader, least in (("ssd", SSD, 1), ("ssv", SSV, 15), ("ssm", SSM, 1)):
        files = list(package.rglob(f"*.{kind}"))
        assert len(files) >= least
        for file in files:
            with reader(file) as document:
                document.__check_compliance__()


def test_schemas_are_those_of_the_standard() -> None:
    """Except line breaks inside tags."""
    compared = 0
    for version, suffix in (("1.0", ""), ("2.0", "2")):
        for kind in ("ssc", "ssd", "ssm", "ssv"):
            standard_schema = Path(ModelicaStandard.schemas[f"{kind}{suffix}"])
            ours = SCHEMAS / version / standard_schema.name
            texts = [ElementTree.canonicalize(from_file=file) for file in (ours, standard_schema)]
            assert texts[0] == texts[1], ours
            compared += 1
    assert len(list(SCHEMAS.rglob("*.xsd"))) == compared


CONVERTED: dict[str, Callable[[str], Any]] = {"Real": float, "Integer": int, "Boolean": "true".__eq__}


def their_values(file: Path) -> dict[str, tuple[str, str, str | None]]:
    """Type, value and unit of each parameter as pyssp_standard reads them."""
    actual = {}
    with SSV(file) as document:
        for p in document.parameters:
            parameter = p["type_value"].parameter
            actual[p["name"]] = p["type_name"], parameter["value"], parameter.get("unit")
        assert {u for _, _, u in actual.values() if u} == set(document.units.units)
    return actual


def test_connections_and_values(package: Path) -> None:
    """What the standard makes of the files that pyssp_standard reads, for components without a mapping."""
    with SSD(package / "SystemStructure.ssd") as document, read_ssp(package / "x.ssp") as actual:
        joined = {
            f"{x.start_element}.{x.start_connector} -> {x.end_element}.{x.end_connector}"
            for x in document.system.connections
        }
        expected = [
            f"{x.source.replace('.', '_')}.{x.output} -> {x.target.replace('.', '_')}.{x.input}"
            for x in actual.system.connections
        ]
        assert joined == set(expected)
        leaves = dict(flat(document.system, ()))
        for component in actual.system.components:
            element = leaves[component.name.replace(".", "_")]
            (bound,) = element.parameter_bindings
            if bound.parameter_mapping is not None:
                assert component.name == "tilt.plant"
                continue
            interface = read_interface(package / element.source)
            driven = {x.input for x in actual.system.connections if x.target == component.name}
            assert component.parameters == {
                name: CONVERTED[type_](value)
                for name, (type_, value, _) in their_values(package / bound.source).items()
                if name in interface.variables and interface.is_settable(name) and name not in driven
            }


def flat(system: TheirSystem, path: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    for element in system.elements:
        inside = (*path, element.name)
        if isinstance(element, TheirSystem):
            yield from flat(element, inside)
        else:
            yield "_".join(inside), element


# ---- OMSimulator -------------------------------------------------------------------------------

OF_COMPONENT = {"Connectors", "ElementGeometry", "ParameterBindings"}
READ_ELEMENTS = {
    "System": OF_COMPONENT | {"Elements", "Connections", "Annotations"},
    "Component": OF_COMPONENT,
}
"""The elements that it reads inside a system and a component."""
IDENTIFIER = re.compile("[a-zA-Z][a-zA-Z0-9_]*")
"""Its `ComRef::isValidIdent`."""
TYPES = {"Real", "Integer", "Boolean"}
"""The types of parameters that it reads; it logs an error for all others, and runs without them."""


def check_for_omsimulator(package: Path) -> tuple[int, int]:
    """Check all that OMSimulator needs. Return how many components have values, and how many a mapping."""
    root = ElementTree.parse(package / "SystemStructure.ssd").getroot()
    systems, parts = (root.findall(f".//ssd:{kind}", NAMESPACES) for kind in READ_ELEMENTS)
    assert len(systems) == 1  # it has no fixed steps in systems inside of another
    names = [e.attrib["name"] for e in (root, *systems, *parts)]
    assert [name for name in names if not IDENTIFIER.fullmatch(name)] == []
    for element in (*systems, *parts):
        assert {local(e) for e in element} <= READ_ELEMENTS[local(element)], element.get("name")
    sources, mappings = [], 0
    for part in parts:
        interface = read_interface(package / part.attrib["source"])
        ports = part.findall("ssd:Connectors/ssd:Connector", NAMESPACES)
        assert {c.attrib["name"] for c in ports} <= interface.variables.keys()
        bindings = part.findall("ssd:ParameterBindings/ssd:ParameterBinding", NAMESPACES)
        assert len(bindings) <= 1  # it runs without those behind the first one
        if not bindings:
            continue
        (binding,), targets = bindings, dict[str, str]()
        sources.append(binding.attrib["source"])
        if (mapping := binding.find("ssd:ParameterMapping", NAMESPACES)) is not None:
            mappings += 1
            entries = ElementTree.parse(package / mapping.attrib["source"]).getroot()
            targets = {e.attrib["source"]: e.attrib["target"] for e in entries}
        parameters = ElementTree.parse(package / sources[-1]).findall(".//ssv:Parameter", NAMESPACES)
        assert parameters
        for parameter in parameters:
            (value,) = parameter
            name = targets.get(parameter.attrib["name"], parameter.attrib["name"])
            assert interface.variables[name].type == local(value)
            assert local(value) in TYPES and interface.is_settable(name)
    assert len({part.attrib["name"] for part in parts}) == len(parts)
    assert len(set(sources)) == len(sources)
    assert {f"resources/{f.name}" for f in package.rglob("*.ssv")} == set(sources)
    return len(sources), mappings


def local(element: ElementTree.Element) -> str:
    return element.tag.rpartition("}")[2]


def test_replaced_component_has_a_mapping(package: Path) -> None:
    assert check_for_omsimulator(package) == (15, 1)


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
    "input": ("lift", {"input": ["load.csv:lift.plant.F_L=force in N"]}),
    "actuator": ("prototype", {"actuator": {"prototype": ROOT / "docs/actuator.toml"}}),
}


@pytest.mark.parametrize("case", mostly_slow(CASES, ["study-compliant", "lift", "freeze fault", "input"]))
def test_package_of_a_scenario(
    case: str, fmu_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All tools can read its names and parameters; its run has the same bits as that of the scenario."""
    monkeypatch.chdir(tmp_path)
    Path("load.csv").write_text("time,force in N\n0,1000\n0.001,2000\n0.01,1500\n")
    name, options = CASES[case]
    original = ec.load(name, **options, fmus=fmu_folder)
    assert check_for_omsimulator(unpack(original, tmp_path))[1] == 0
    read = ec.load("x.ssp")
    assert read.name == original.name and read.notes == ()
    step, algorithm = original.options.step_size, original.options.algorithm
    times = {"stop_time": float(f"{20 * step:.12g}"), "output_interval": step}
    with original.prepare() as simulation:
        expected = simulation.attempt(**times)  # the printed gains diverge on a drive
    with read.prepare(algorithm=algorithm, **original.options.class_options) as simulation:
        result = simulation.attempt(**times)
    assert result.signals.keys() == expected.signals.keys()
    for signal in expected.signals:
        assert result[signal].tobytes() == expected[signal].tobytes(), signal
