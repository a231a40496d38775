"""Manifests of layered standards: valid ones pass, and faults are named."""

from pathlib import Path

import pytest

from fmu_verify.check import Verdict
from tests.support.broken.editing import with_files
from tests.support.broken.examining import examine
from tests.support.broken.layered import with_manifest, write_terminal

CHECK = "layered.manifests"

TRANSCEIVER = write_terminal(
    "org.fmi-ls-bus.network-terminal",
    "org.fmi-ls-bus.transceiver",
    {name: (name, "signal") for name in ("Tx_Data", "Tx_Clock", "Rx_Data", "Rx_Clock")},
)
CAN = "application/org.fmi-standard.fmi-ls-bus.can; version=&quot;1.0.0&quot;"
VARIABLES = f"""
<Clock name="Rx_Clock" valueReference="94" causality="input" intervalVariability="triggered"/>
<Clock name="Tx_Clock" valueReference="95" causality="input" intervalVariability="countdown"/>
<Binary name="Rx_Data" valueReference="96" causality="input" clocks="94" mimeType="{CAN}">
  <Start value=""/></Binary>
<Binary name="Tx_Data" valueReference="97" causality="output" clocks="95" initial="calculated"
  mimeType="{CAN}"/>
"""
GRID = write_terminal(
    "org.fmi-standard.fmi-ls-struct.map.rectilinearGrid",
    "org.fmi-standard.fmi-ls-struct.map",
    {
        name: (name, f"org.fmi-standard.fmi-ls-struct.map.{kind}")
        for name, kind in {"a": "domain", "b": "domain", "c": "codomain", "d": "codomainOutput"}.items()
    },
)
ARRAYS = """
<Float64 name="a" valueReference="91" variability="constant" start="0 1"><Dimension start="2"/></Float64>
<Float64 name="b" valueReference="92" variability="constant" start="0 1 2"><Dimension start="3"/></Float64>
<Float64 name="c" valueReference="93" variability="constant" start="0">
  <Dimension start="2"/><Dimension start="3"/></Float64>
<Float64 name="d" valueReference="94" variability="continuous"/>
"""


@pytest.mark.parametrize("name", ["ref", "bus", "xcp", "struct"])
def test_valid_manifests_pass(name: str, tmp_path: Path) -> None:
    finding = examine(with_manifest(name)(tmp_path), CHECK)[CHECK]
    assert finding.verdict == Verdict.PASSED, finding.outcome
    assert finding.sentence == "1 manifests of layered standards are valid."
    absolute = "The related file https://example.com/requirements is not in the FMU, and was not examined."
    assert finding.outcome.gaps == ((absolute,) if name == "ref" else ())


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("", "", ""),
        (
            'causality="output" clocks="95" initial="calculated"',
            'causality="local" clocks="95"',
            "not output",
        ),
        ('clocks="94"', 'clocks="95"', "Rx_Data, does not belong to its Clock Rx_Clock"),
        (CAN, "application/octet-stream", "the mimeType application/octet-stream, which is of no bus"),
        ("bus.can", "bus.lin", "have the mimeTypes of "),
        ('Clock name="Tx_Clock"', 'Clock name="Other"', ""),  # `description.terminals` reports it
        ('<Binary name="Rx_Data"', '<String name="Rx_Data"', "is of type String, not Binary"),
    ],
)
def test_bus_terminals(old: str, new: str, words: str, tmp_path: Path) -> None:
    variables = VARIABLES.replace(old, new, 1) if old else VARIABLES
    if "String" in new:
        variables = variables.replace("</Binary>", "</String>").replace(f' mimeType="{CAN}"', "", 1)
    finding = examine(with_manifest("bus", terminal=TRANSCEIVER, variables=variables)(tmp_path), CHECK)[CHECK]
    assert finding.verdict == (Verdict.FAILED if words else Verdict.PASSED), finding.sentence
    assert words in finding.sentence


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("", "", ""),
        ('start="0 1 2"><Dimension start="3"/>', 'start="0"><Dimension start="4"/>', "c of the map"),
        ('start="0 1"><Dimension start="2"/>', 'start="0">', "a has 0 dimensions"),
        ('<Float64 name="d"', '<Float32 name="d"', "d in the map t is of type Float32, but c is of type"),
    ],
)
def test_maps_on_grids(old: str, new: str, words: str, tmp_path: Path) -> None:
    variables = ARRAYS.replace(old, new) if old else ARRAYS
    finding = examine(with_manifest("struct", terminal=GRID, variables=variables)(tmp_path), CHECK)[CHECK]
    assert finding.verdict == (Verdict.FAILED if words else Verdict.PASSED), finding.sentence
    assert words in finding.sentence


def test_recommendations_for_other_standards_are_not_examined(tmp_path: Path) -> None:
    manifest = '<a xmlns:m="http://fmi-standard.org/fmi-ls-manifest" m:fmi-ls-name="b" m:fmi-ls-version=""/>'
    path = "extra/com.example.b/fmi-ls-manifest.xml"
    fmu = with_files(lambda files: files.update({path: manifest.encode()}))(tmp_path)
    finding = examine(fmu, CHECK)[CHECK]
    assert finding.verdict == Verdict.PASSED and finding.sentence not in finding.outcome.gaps
    assert finding.outcome.gaps == (
        f"The fmi-ls-version of {path} is empty.",
        f"{path} has no fmi-ls-description.",
        f"The fmi-ls-name of {path}, b, is not in reverse domain notation.",
    )


def test_manifest_without_attributes_warns(tmp_path: Path) -> None:
    fmu = with_files(lambda files: files.update({"extra/com.example/fmi-ls-manifest.xml": b"<a/>"}))(tmp_path)
    finding = examine(fmu, CHECK)[CHECK]
    assert finding.verdict == Verdict.WARNING
    assert finding.sentence.startswith("extra/com.example/fmi-ls-manifest.xml has no fmi-ls-name.")
