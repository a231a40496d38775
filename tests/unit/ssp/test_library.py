"""Exported packages as pyssp_standard reads them: a reader that is not ours, and the standard's schemas."""

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
from typer.testing import CliRunner

import emla_cosim.ssp.documents
from emla_cosim.cli.app import app
from emla_cosim.fmu.interface import read_interface
from emla_cosim.ssp.documents.parameter_sets import parse_mapping, parse_parameter_set
from emla_cosim.ssp.documents.ssd_data import ComponentElement, FileReference, SystemElement
from emla_cosim.ssp.documents.ssd_reader import parse_structure
from emla_cosim.ssp.reader.flat_document import read_ssp
from tests.support.paths import FOREIGN_MAPPING

MAPPING = FOREIGN_MAPPING
SCHEMAS = Path(emla_cosim.ssp.documents.__file__).parent / "schemas"


@pytest.fixture(scope="module")
def exported(fmu_folder: Path, foreign_plant: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The study with one plant of somebody else."""
    path = tmp_path_factory.mktemp("exported") / "study.ssp"
    options = ["--replace", f"tilt.plant={foreign_plant}", "--mapping", f"tilt.plant={MAPPING}"]
    result = CliRunner().invoke(app, ["export", "study", str(path), "--fmus", str(fmu_folder), *options])
    assert result.exit_code == 0, result.output
    return path


@pytest.fixture
def unpacked(exported: Path, tmp_path: Path) -> Path:
    with zipfile.ZipFile(exported) as archive:
        archive.extractall(tmp_path)
    return tmp_path


def test_all_files_are_valid(unpacked: Path) -> None:
    for kind, reader, least in (("ssd", SSD, 1), ("ssv", SSV, 15), ("ssm", SSM, 1)):
        files = list(unpacked.rglob(f"*.{kind}"))
        assert len(files) >= least
        for file in files:
            with reader(file) as document:
                document.__check_compliance__()


def test_our_schemas_are_the_ones_it_has() -> None:
    """But for line breaks inside tags."""
    compared = 0
    for version, suffix in (("1.0", ""), ("2.0", "2")):
        for kind in ("ssc", "ssd", "ssm", "ssv"):
            theirs = Path(ModelicaStandard.schemas[f"{kind}{suffix}"])
            ours = SCHEMAS / version / theirs.name
            assert canonical(ours) == canonical(theirs), ours
            compared += 1
    assert len(list(SCHEMAS.rglob("*.xsd"))) == compared


def canonical(file: Path) -> str:
    return ElementTree.canonicalize(from_file=file)


CONVERTED: dict[str, Callable[[str], Any]] = {"Real": float, "Integer": int, "Boolean": "true".__eq__}


def theirs(system: TheirSystem) -> dict[str, Any]:
    """A system as their reader has it."""
    return {
        "name": system.name,
        "connectors": [(c.name, c.kind, c.type_.unit) for c in system.connectors],
        "connections": [
            (c.start_element, c.start_connector, c.end_element, c.end_connector) for c in system.connections
        ],
        "elements": [
            theirs(e)
            if isinstance(e, TheirSystem)
            else (
                e.name,
                e.source,
                [(c.name, c.kind, c.type_.unit) for c in e.connectors],
                [
                    (b.source, b.parameter_mapping.source if b.parameter_mapping else None)
                    for b in e.parameter_bindings or ()
                ],
            )
            for e in system.elements
        ],
    }


def connectors(element: ComponentElement | SystemElement) -> list[tuple[str, str, str | None]]:
    return [(c.name, c.kind, c.unit.name if c.unit else None) for c in element.connectors]


def ours(system: SystemElement) -> dict[str, Any]:
    """The same of our reader."""
    return {
        "name": system.name,
        "connectors": connectors(system),
        "connections": [
            (c.start_element, c.start_connector, c.end_element, c.end_connector) for c in system.connections
        ],
        "elements": [
            ours(e)
            if isinstance(e, SystemElement)
            else (
                e.name,
                e.source,
                connectors(e),
                [(source(b.values), source(b.mapping)) for b in e.bindings],
            )
            for e in system.elements
            if isinstance(e, (SystemElement, ComponentElement))
        ],
    }


def source(content: object) -> str | None:
    return content.source if isinstance(content, FileReference) else None


def test_structures_are_the_same(unpacked: Path) -> None:
    file = unpacked / "SystemStructure.ssd"
    with SSD(file) as document:
        found = parse_structure(file.read_bytes(), file.name)
        assert ours(found.system) == theirs(document.system)
        assert set(document.units.units) == units(found.system)
        assert document.name == found.name
        assert document.default_experiment.stop_time == found.stop_time
    assert len(list(leaves(found.system))) == 15


def units(element: Any) -> set[str]:
    inside = [units(e) for e in getattr(element, "elements", ())]
    return {c.unit.name for c in element.connectors if c.unit is not None}.union(*inside)


def leaves(system: SystemElement) -> Iterator[ComponentElement]:
    for element in system.elements:
        if isinstance(element, SystemElement):
            yield from leaves(element)
        elif isinstance(element, ComponentElement):
            yield element


def their_values(file: Path) -> dict[str, tuple[str, str, str | None]]:
    with SSV(file) as document:
        found = {
            p["name"]: (
                p["type_name"],
                p["type_value"].parameter["value"],
                p["type_value"].parameter.get("unit"),
            )
            for p in document.parameters
        }
        assert {u for _, _, u in found.values() if u} == set(document.units.units)
    return found


def test_parameters_are_the_same(unpacked: Path) -> None:
    for file in unpacked.rglob("*.ssv"):
        expected = their_values(file)
        found = parse_parameter_set(file.read_bytes(), file.name).parameters
        assert [p.name for p in found] == list(expected)
        for parameter in found:
            type_, value, unit = expected[parameter.name]
            assert (parameter.type, parameter.unit and parameter.unit.name) == (type_, unit)
            assert parameter.value == CONVERTED[type_](value)


def test_mappings_are_the_same(unpacked: Path) -> None:
    (file,) = unpacked.rglob("*.ssm")
    with SSM(file) as document:
        expected = [(e.source, e.target, e.suppress_unit_conversion, linear(e)) for e in document.mappings]
    found = [
        (
            e.source,
            e.target,
            str(e.suppress_unit_conversion).lower(),
            e.transformation and e.transformation(2.0),
        )
        for e in parse_mapping(file.read_bytes(), file.name)
    ]
    assert found == expected


def linear(entry: Any) -> float | None:
    if entry.transformation is None:
        return None
    given = entry.transformation.transformation
    return float(given["factor"]) * 2.0 + float(given.get("offset") or 0.0)


def test_values_are_those_of_the_sets_that_fit(exported: Path, unpacked: Path) -> None:
    """What the standard makes of the files that their reader reads, for components without a mapping."""
    with SSD(unpacked / "SystemStructure.ssd") as document, read_ssp(exported) as found:
        elements = dict(flat(document.system, ()))
        for component in found.system.components:
            element = elements[component.name.replace(".", "_")]
            (bound,) = element.parameter_bindings
            if bound.parameter_mapping is not None:
                assert component.name == "tilt.plant"
                continue
            interface = read_interface(unpacked / element.source)
            driven = {x.input for x in found.system.connections if x.target == component.name}
            expected = {
                name: CONVERTED[type_](value)
                for name, (type_, value, _) in their_values(unpacked / bound.source).items()
                if name in interface.variables and interface.is_settable(name) and name not in driven
            }
            assert component.parameters == expected


def flat(system: TheirSystem, path: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
    for element in system.elements:
        inside = (*path, element.name)
        if isinstance(element, TheirSystem):
            yield from flat(element, inside)
        else:
            yield "_".join(inside), element
