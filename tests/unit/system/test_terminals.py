"""Terminals of the FMUs: connecting terminals of the same name wires a joint."""

import zipfile
from importlib.resources import files
from pathlib import Path
from xml.etree.ElementTree import fromstring

import pytest
from fmpy import read_model_description
from lxml import etree

from emla_cosim.fmu.models import MODELS, fmu_path
from emla_cosim.study.loading import load
from emla_cosim.system.model import Connection
from tests.support.tiers import mostly_slow

FILE = "terminalsAndIcons/terminalsAndIcons.xml"
Terminals = dict[tuple[str, str], str]


def terminals(fmu: Path) -> Terminals:
    """Names of variables by terminal and member."""
    with zipfile.ZipFile(fmu) as archive:
        root = fromstring(archive.read(FILE))
    return {
        (terminal.attrib["name"], member.attrib["memberName"]): member.attrib["variableName"]
        for terminal in root.iter("Terminal")
        for member in terminal.iter("TerminalMemberVariable")
    }


@pytest.mark.parametrize("flavour", mostly_slow(["native", "python"], ["native"]))
def test_file_follows_the_schema_and_has_its_icon(flavour: str, request: pytest.FixtureRequest) -> None:
    folder = request.getfixturevalue("fmu_folder" if flavour == "native" else "python_fmu_folder")
    schema = etree.XMLSchema(
        etree.parse(str(files("fmpy") / "schema" / "fmi3" / "fmi3TerminalsAndIcons.xsd"))
    )
    for model in MODELS:
        with zipfile.ZipFile(fmu_path(model, flavour, folder)) as archive:
            schema.assertValid(etree.fromstring(archive.read(FILE)))
            assert archive.read("terminalsAndIcons/icon.png") == archive.read("model.png"), model


def test_connecting_terminals_of_the_same_name_wires_a_joint(fmu_folder: Path) -> None:
    """As in a tool that knows terminals: every input finds the one output of its terminal and member."""
    system = load("lift").system
    fmus = {c.name: fmu_path(c.model, "native", fmu_folder) for c in system.components}
    outputs: dict[tuple[str, str], tuple[str, str]] = {}
    inputs: list[tuple[tuple[str, str], str, str]] = []
    for component, fmu in fmus.items():
        causality = {v.name: v.causality for v in read_model_description(str(fmu)).modelVariables}
        for member, variable in terminals(fmu).items():
            if causality[variable] == "input":
                inputs.append((member, component, variable))
            else:
                assert member not in outputs, "two sources for one member"
                outputs[member] = component, variable
    wired = {Connection(*outputs[member], component, variable) for member, component, variable in inputs}
    assert wired == set(system.connections)
