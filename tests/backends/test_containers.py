"""A system as one FMU: its interface, its states and what it refuses, for both versions of FMI.

That its rows are those of a run is shown in test_matrix.py.
"""

import re
import zipfile
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

import fmpy
import lief
import numpy as np
import pytest
from click.testing import CliRunner
from fmpy.fmi1 import FMICallException
from fmpy.validation import validate_fmu
from lxml import etree

import emla_cosim as ec
from emla_cosim.base.errors import CommandError
from emla_cosim.cli.app import app
from fmublock.archive import write_archive
from fmublock.platforms import host_platform
from tests.support.container_host import Host
from tests.support.hand_written_fmus import build_all_types_3_fmu, build_all_types_fmu, edit_description
from tests.support.tiers import mostly_slow

STEP = 1e-4
SHORT_RUN: dict[str, Any] = {"step_size": 0.01, "stop_time": 0.1, "output_interval": 0.01}
TYPES = ("Float32", "Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64", "UInt64")
both_versions = pytest.mark.parametrize("fmi", [2, 3])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("containers")


@pytest.fixture(scope="module")
def lifts(fmu_folder: Path, folder: Path) -> Mapping[int, Path]:
    """The lift as one FMU, by the version of FMI."""
    return {
        fmi: load("lift", fmu_folder).export(folder / f"lift{fmi}.fmu", outputs=["*"], fmi=fmi)
        for fmi in (2, 3)
    }


@pytest.fixture(scope="module")
def all_types(folder: Path) -> Path:
    return build_all_types_fmu(folder / "AllTypes.fmu")


@pytest.fixture(scope="module")
def third(folder: Path) -> Path:
    return build_all_types_3_fmu(folder / "Third.fmu")


@pytest.fixture(scope="module")
def pair(third: Path, all_types: Path, fmu_folder: Path, folder: Path) -> Path:
    """Two FMUs of FMI 3.0 and one of FMI 2.0, with variables of all types and arrays, for FMI 3.0."""
    wires = ["a.y -> b.u", "a.UInt64_out -> b.Int8_in", "a.Int64_out -> b.UInt32_in", "a.Boolean_out -> c.on"]
    values = {"a.u[1,1]": 3.0, "a.gain[2,1]": 7.0, "a.UInt64_in": 99, "a.Int64_in": 2**32 - 2}
    system = ec.System.of({"a": third, "b": third, "c": all_types}, wires, values)
    scenario = load(system, fmu_folder, step_size=0.125, stop_time=2.0, output_interval=0.125)
    return scenario.export(folder / "pair.fmu", outputs=["*"], fmi=3)


def load(source: Any, fmus: Path, **options: Any) -> ec.Scenario:
    return ec.load(source, **{"stop_time": 0.05, "output_interval": 1e-3, "fmus": fmus} | options)


def assert_same(fmu: Path, scenario: ec.Scenario, step: float = STEP, **starts: Any) -> None:
    """FMPy gets the bits of the run, at the points of the output interval."""
    with scenario.prepare() as simulation:
        run = simulation.run()
    names = [v.name for v in fmpy.read_model_description(str(fmu)).modelVariables if v.causality == "output"]
    interval = scenario.options.output_interval
    times = {"stop_time": scenario.options.stop_time, "step_size": step, "output_interval": interval}
    rows = fmpy.simulate_fmu(str(fmu), **times, output=names, start_values=starts)
    compared = [name for name in names if name in run.names]
    assert compared
    assert [name for name in compared if not np.array_equal(rows[name], run[name])] == []


def without_sources(fmu: Path, path: Path) -> Path:
    """Write the same FMU with nothing but its library."""
    with zipfile.ZipFile(fmu) as archive:
        content = {n: archive.read(n) for n in archive.namelist() if not n.startswith("sources/")}
    write_archive(path, content)
    return path


# ---- states and steps ----------------------------------------------------------------------------


@both_versions
def test_saved_state_continues_with_the_same_bits(
    fmi: int, lifts: Mapping[int, Path], tmp_path: Path
) -> None:
    with Host(lifts[fmi], tmp_path) as host, Host(lifts[fmi], tmp_path / "other") as second:
        host.start()
        host.step(0.0, 30 * STEP)
        state = host.save()
        content = host.serialize(state)
        host.step(30 * STEP, 30 * STEP)
        expected = host.read()
        host.restore(state)
        for k in range(30, 60):
            host.step(k * STEP, STEP)
        assert host.read() == expected
        host.free(state)
        second.start()
        second.restore(second.deserialize(content))
        second.step(30 * STEP, 30 * STEP)
        assert second.read() == expected
        damaged = content[:-9] + bytes([content[-9] ^ 1]) + content[-8:]
        with pytest.raises(FMICallException):
            second.deserialize(damaged)
        assert "damaged" in second.messages[-1]


@both_versions
def test_reset_restores_start_values(fmi: int, lifts: Mapping[int, Path], tmp_path: Path) -> None:
    """So does a state from before the start."""
    with Host(lifts[fmi], tmp_path) as host:
        host.start()
        host.step(0.0, 20 * STEP)
        expected = host.read()
        host.fmu.reset()
        host.start({"lift.plant.motor.R_s": 0.5})
        host.step(0.0, 20 * STEP)
        assert host.read() != expected
        host.fmu.reset()
        if fmi == 2:
            state = host.save()
            host["lift.plant.motor.R_s"] = 0.5
            host.restore(state)
            host.free(state)
        host.start()
        host.step(0.0, 20 * STEP)
        assert host.read() == expected


@both_versions
@pytest.mark.parametrize(
    ("time", "step", "message"),
    [
        (0.0, 1.5e-4, "not a multiple of the system's step of 0.0001 s"),
        (0.0, 1e-5, "not a multiple"),
        (1e-3, 1e-4, "the step starts at t = 0.001 s, but the system is at t = 0 s"),
        (0.0, 0.2, "goes past the stop time 0.1 s"),
        (0.0, -1e-4, "is not possible"),
        (0.0, 0.0, "is not possible"),
        (0.0, float("nan"), "is not possible"),
    ],
)
def test_impossible_steps_are_refused(
    fmi: int, time: float, step: float, message: str, lifts: Mapping[int, Path], tmp_path: Path
) -> None:
    with Host(lifts[fmi], tmp_path) as host:
        host.start(stop=0.1)
        with pytest.raises(FMICallException):
            host.step(time, step)
        assert message in host.messages[-1]
        answer = host.step(0.0, 1e-4)  # nothing has changed
        assert fmi == 2 or answer[1:] == (False, False, 1e-4)


def test_rounded_times_of_a_host_give_the_same_bits(lifts: Mapping[int, Path], tmp_path: Path) -> None:
    with Host(lifts[2], tmp_path) as host, Host(lifts[2], tmp_path / "other") as rounding:
        time = 0.0
        host.start()
        rounding.start()
        for k in range(200):
            host.step(k * STEP, STEP)
            rounding.step(time, STEP)
            time += STEP
        assert rounding.read() == host.read()


@both_versions
def test_messages_of_a_component_have_its_name(fmi: int, lifts: Mapping[int, Path], tmp_path: Path) -> None:
    with Host(lifts[fmi], tmp_path) as host:
        with pytest.raises(FMICallException):
            host.start({"lift.plant.motor.R_s": -1.0})
        assert any("lift.plant: motor.R_s = -1 is outside its range" in m for m in host.messages)
        host.fmu.reset()
        host.start()


def test_start_values_of_the_host_match_set(lifts: Mapping[int, Path], fmu_folder: Path) -> None:
    values = {"lift.plant.motor.R_s": 0.3, "lift.plant.screw.M_BS": 300.0}
    assert_same(lifts[2], load("lift", fmu_folder, set=values), 1e-3, **values)


def test_functions_that_an_fmu_lacks_are_refused(lifts: Mapping[int, Path], tmp_path: Path) -> None:
    with Host(lifts[3], tmp_path) as host:
        for call in (host.fmu.enterEventMode, host.fmu.enterStepMode, host.fmu.enterConfigurationMode):
            with pytest.raises(FMICallException):
                call()
            assert "this FMU has no" in host.messages[-1]
    with pytest.raises(Exception, match="instantiate"):
        Host(lifts[3], tmp_path / "other", eventModeUsed=True)


# ---- types ---------------------------------------------------------------------------------------


def test_each_type_has_its_function(pair: Path, tmp_path: Path) -> None:
    """An element of an array leaves the others."""
    kinds = {v.name: v.type for v in fmpy.read_model_description(str(pair)).modelVariables}
    assert [kinds[f"a.{kind}_in"] for kind in (*TYPES, "Boolean")] == [*TYPES, "Boolean"]
    assert [kinds[f"c.{n}"] for n in ("u", "count", "mode", "high", "text")] == [
        *("Float64", "Int32", "Enumeration", "Boolean", "String")
    ]
    with Host(pair, tmp_path) as host:
        fmu, reference = host.fmu, host.references
        for kind in (*TYPES, "Boolean"):
            if kind not in ("UInt64", "Int64"):  # which have other values
                getattr(fmu, f"set{kind}")([reference[f"a.{kind}_in"]], [1])
        fmu.setInt64([reference["a.Enumeration_in"]], [1])
        fmu.setInt32([reference["c.first"]], [5])
        host["a.gain[1,2]"], host["a.u[2,2]"], host["c.u"] = 10.0, 4.0, 3.0
        host.start()
        host.step(0.0, 0.125)
        assert [list(getattr(fmu, f"get{k}")([reference[f"a.{k}_out"]])) for k in TYPES[:7]] == [[1]] * 7
        assert list(fmu.getInt64([reference["a.Int64_out"], reference["a.Enumeration_out"]])) == [
            2**32 - 2,
            1,
        ]
        # y = gain * u, elementwise
        assert host.read([f"a.y[{e}]" for e in ("1,1", "1,2", "2,1", "2,2")]) == [3.0, 5.0, 3.5, 16.0]
        assert host.read(["a.gain[2,1]", "a.gain[1,2]", "a.gain[2,2]"]) == [7.0, 10.0, 4.0]
        assert host.read(["c.x", "time"]) == pytest.approx([0.375, 0.125])
        assert list(fmu.getInt64([reference["c.mode"]])) in ([1], [2], [4])
        assert fmu.getString([reference["c.text"]])[0].startswith("count is ")
        with pytest.raises(FMICallException):
            fmu.getInt32([reference["c.mode"]])
        assert "c.mode is of type Enumeration (Int64)" in host.messages[-1]
        with pytest.raises(FMICallException):
            host["a.gain[1,1]"] = 2.0
        assert "a.gain[1,1] cannot be set after initialization" in host.messages[-1]
        fmu.setUInt64([reference["a.UInt64_in"]], [200])  # the input of b is an Int8
        with pytest.raises(FMICallException):
            for k in range(1, 4):
                host.step(k * 0.125, 0.125)
        assert any("= 200 does not fit into an input of b, whose type is Int8" in m for m in host.messages)
        fmu.reset()
        with pytest.raises(FMICallException):
            fmu.setUInt64([reference["a.UInt64_in"]], [2**53 + 1])
        assert "does not fit into the type of a, UInt64" in host.messages[-1]
        fmu.setString([reference["a.text"]], ["é"])
        assert fmu.getString([reference["a.text"]]) == ["é"]


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (1, "a discarded the step from t = 0.5 s"),
        (2, "a asks to end the simulation at t = 0.5 s"),
        (3, "a returned early at t = 0.5 s, which was not allowed"),
        (4, "a asked for event mode, which is not used"),
    ],
)
def test_failures_of_steps_are_reported(fault: int, message: str, pair: Path, tmp_path: Path) -> None:
    with Host(pair, tmp_path) as host:
        host.fmu.setDebugLogging(True, [])
        host.fmu.setInt32([host.references["a.fault"]], [fault])
        host.start({"a.end": 0.5})
        with pytest.raises(FMICallException):
            for k in range(8):
                host.step(k * 0.125, 0.125)
        assert any(message in m for m in host.messages), host.messages


# ---- documents -----------------------------------------------------------------------------------


def read(fmu: Path, name: str) -> Any:
    with zipfile.ZipFile(fmu) as archive:
        return etree.fromstring(archive.read(name))


@pytest.mark.slow
def test_documents_follow_the_published_schemas(lifts: Mapping[int, Path], pair: Path) -> None:
    for fmu in (*lifts.values(), pair):
        assert validate_fmu(str(fmu)) == []
    schemas = {
        "modelDescription.xml": "ModelDescription",
        "sources/buildDescription.xml": "BuildDescription",
        "terminalsAndIcons/terminalsAndIcons.xml": "TerminalsAndIcons",
    }
    for name, schema in schemas.items():
        path = files("fmpy").joinpath("schema", "fmi3", f"fmi3{schema}.xsd")
        etree.XMLSchema(etree.parse(str(path))).assertValid(read(lifts[3], name))
    assert not [n for n in zipfile.ZipFile(lifts[3]).namelist() if n.startswith("sources/fmi2_")]
    # its sources alone are not an FMU
    assert "sources/buildDescription.xml" not in zipfile.ZipFile(pair).namelist()


def test_both_versions_have_the_same_variables_and_structure(lifts: Mapping[int, Path]) -> None:
    old, new = (read(lifts[fmi], "modelDescription.xml") for fmi in (2, 3))
    variables = {v.get("name"): dict(v.attrib) for v in new.find("ModelVariables")}
    time = variables.pop("time")
    assert (time["causality"], time["unit"]) == ("independent", "s")
    expected = {
        v.get("name"): {k: x for k, x in (*v.items(), *v[0].items()) if k != "declaredType"}
        for v in old.find("ModelVariables")
    }
    assert {n: {k: x for k, x in v.items() if k != "declaredType"} for n, v in variables.items()} == expected
    structure = new.find("ModelStructure")
    for tag, element in (("Output", "Outputs"), ("InitialUnknown", "InitialUnknowns")):
        indices = [int(u.get("index")) - 1 for u in old.find(f"ModelStructure/{element}")]
        assert [int(u.get("valueReference")) for u in structure.findall(tag)] == indices


def test_variables_have_units_and_causalities(lifts: Mapping[int, Path]) -> None:
    variables = {v.name: v for v in fmpy.read_model_description(str(lifts[2])).modelVariables}
    assert variables["lift.plant.motor.R_s"].unit == "Ohm"
    assert variables["lift.plant.motor.R_s"].causality == "parameter"
    assert "lift.plant.u_q" not in variables  # a connection drives it
    assert variables["der(lift.plant.x_L)"].causality == "local"


def test_page_draws_components_and_connections(lifts: Mapping[int, Path], fmu_folder: Path) -> None:
    system = load("lift", fmu_folder).system
    page = zipfile.ZipFile(lifts[2]).read("documentation/index.html").decode()
    (picture,) = re.findall(r"<svg.*?</svg>", page)
    drawing = etree.fromstring(picture)
    svg = "{http://www.w3.org/2000/svg}"
    boxes = [group[0].text.partition(": ")[0] for group in drawing.findall(f"{svg}g")]
    assert sorted(boxes) == sorted(c.name for c in system.components)
    wires = [path[0].text.split("; ") for path in drawing.findall(f"{svg}path")]
    connections = [f"{x.source}.{x.output} → {x.target}.{x.input}" for x in system.connections]
    assert sorted(wire for bundle in wires for wire in bundle) == sorted(connections)


def functions(fmi: int) -> set[str]:
    """Return the functions that a co-simulation FMU needs, from the standard's header."""
    header = files("fmpy").joinpath("c-code", f"fmi{fmi}Functions.h").read_text()
    if fmi == 2:
        first, _, rest = header.rpartition("Functions for FMI2 for Model Exchange")
        header = first + rest.partition("Functions for FMI2 for Co-Simulation")[2]
    names = set(re.findall(rf"^\s*FMI{fmi}_Export\s+fmi{fmi}\w+TYPE\s+(fmi{fmi}\w+);", header, re.MULTILINE))
    assert len(names) == {2: 34, 3: 75}[fmi]
    return names


def exported(fmu: Path) -> dict[str, set[str]]:
    """Return all names that the libraries export, by the folder in binaries/."""
    names_by_folder = {}
    with zipfile.ZipFile(fmu) as archive:
        for name in [n for n in archive.namelist() if n.startswith("binaries/")]:
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
            names_by_folder[name.split("/")[1]] = names
    return names_by_folder


PLATFORMS = {
    "linux64": "x86_64-linux",
    "win64": "x86_64-windows",
    "darwin64": "x86_64-darwin",
    "aarch64-linux": "aarch64-linux",
    "aarch64-darwin": "aarch64-darwin",
}
"""Folders of binaries for FMI 3.0, by that for FMI 2.0."""
HOST = [host_platform()]


@both_versions
@pytest.mark.parametrize("platforms", mostly_slow([HOST, list(PLATFORMS)], [HOST]), ids=len)
def test_container_exports_the_functions_of_the_standard(
    fmi: int, platforms: list[str], lifts: Mapping[int, Path], tmp_path: Path
) -> None:
    fmu = lifts[fmi]
    if platforms != HOST:  # its FMUs are built for all of them
        fmu = load("lift", tmp_path / "fmus").export(tmp_path / "lift.fmu", platform=platforms, fmi=fmi)
    assert exported(fmu) == {(p if fmi == 2 else PLATFORMS[p]): functions(fmi) for p in platforms}


@pytest.mark.slow
def test_equal_content_gives_equal_bytes(lifts: Mapping[int, Path], fmu_folder: Path, tmp_path: Path) -> None:
    second = load("lift", fmu_folder).export(tmp_path / "lift2.fmu", outputs=["*"])
    assert second.read_bytes() == lifts[2].read_bytes()


# ---- other containers ----------------------------------------------------------------------------


@pytest.mark.slow
def test_open_inputs_and_terminals_match_the_fmu(fmu_folder: Path, tmp_path: Path) -> None:
    """Inputs act from the next step on. A container in a container has the same terminals."""
    scenario = load(ec.System.of({"plant": "EmlaPlant"}), fmu_folder, step_size=STEP)
    plant = scenario.export(tmp_path / "plant.fmu", inputs=["plant.u_q", "plant.F_L"], outputs=["plant.*"])
    variables = fmpy.read_model_description(str(plant)).modelVariables
    assert {v.name for v in variables if v.causality == "input"} == {"plant.u_q", "plant.F_L"}
    assert {v.name: v.causality for v in variables}["plant.u_d"] == "parameter"
    with Host(plant, tmp_path / "host") as host:
        host.start()
        host["plant.u_q"] = 10.0
        assert host["plant.i_q"] == 0.0
        host.step(0.0, STEP)
        current = host["plant.i_q"]
    with scenario.prepare() as simulation:
        simulation["plant.u_q"] = 10.0
        simulation.advance(STEP)
        assert simulation["plant.i_q"] == current > 0.0
    outer = load(ec.System.of({"machine": plant}), fmu_folder, step_size=STEP)
    for fmu, prefix in ((plant, ""), (outer.export(tmp_path / "outer.fmu", outputs=["*"]), "machine.")):
        terminals = {
            (terminal.get("name"), member.get("memberName"), member.get("variableName"))
            for terminal in read(fmu, "terminalsAndIcons/terminalsAndIcons.xml").iter("Terminal")
            for member in terminal
        }
        assert {
            (f"{prefix}plant.load", "F_L", f"{prefix}plant.F_L"),
            (f"{prefix}plant.load", "v_L", f"{prefix}plant.v_L"),
            (f"{prefix}plant.drive", "u_q", f"{prefix}plant.u_q"),
        } <= terminals


@pytest.mark.slow
@both_versions
def test_libraries_without_sources_are_included(fmi: int, fmu_folder: Path, tmp_path: Path) -> None:
    plant = without_sources(fmu_folder / "EmlaPlant/EmlaPlant.fmu", tmp_path / "Plant.fmu")
    scenario = load("lift", fmu_folder, replace={"lift.plant": plant}, set={"lift.plant.motor.R_s": 0.3})
    fmu = scenario.export(tmp_path / "lift.fmu", outputs=["*"], fmi=fmi)
    assert any(n.startswith("resources/EmlaPlant/binaries/") for n in zipfile.ZipFile(fmu).namelist())
    starts = {v.name: v.start for v in fmpy.read_model_description(str(fmu)).modelVariables}
    assert float(starts["lift.plant.motor.R_s"]) == 0.3
    assert_same(fmu, scenario)


@pytest.mark.slow
def test_units_with_different_definitions_get_different_names(
    all_types: Path, fmu_folder: Path, tmp_path: Path
) -> None:
    """A unit without definition keeps its name."""
    velocity = '<BaseUnit m="1" s="-1"/>'
    slower = '<BaseUnit m="1" s="-1" factor="0.001"/>'
    edits = ('<Unit name="m"><BaseUnit m="1"/></Unit>', "", velocity, slower)
    slower_fmu = edit_description(all_types, tmp_path / "Other.fmu", *edits)
    scenario = load(ec.System.of({"a": all_types, "b": slower_fmu}), fmu_folder, **SHORT_RUN, lenient=True)
    description = fmpy.read_model_description(str(scenario.export(tmp_path / "units.fmu")), validate=False)
    units = {v.name: v.unit for v in description.modelVariables}
    factors = {
        u.name: None if u.baseUnit is None else float(u.baseUnit.factor) for u in description.unitDefinitions
    }
    assert units["a.x"] == "m" and units["b.x"] in ("m", "m_2")
    assert (factors[units["a.u"]], factors[units["b.u"]]) == (1.0, 0.001)


@pytest.mark.slow
def test_hostile_names_stay_text(all_types: Path, fmu_folder: Path, tmp_path: Path) -> None:
    """In the page, in C and in XML."""
    name = 'x"); system("true"); //<script>alert(1)</script>'
    escaped = name.replace("<", "&lt;").replace('"', "&quot;")
    evil = edit_description(all_types, tmp_path / "Evil.fmu", 'name="twice"', f'name="{escaped}"')
    scenario = load(ec.System.of({"a": evil}), fmu_folder, **SHORT_RUN)
    fmu = scenario.export(tmp_path / "evil.fmu", outputs=["*"])
    page = zipfile.ZipFile(fmu).read("documentation/index.html")
    assert b"<script>" not in page
    assert len(etree.fromstring(re.findall(rb"<svg.*?</svg>", page)[0])) > 0
    names = [v.name for v in fmpy.read_model_description(str(fmu), validate=False).modelVariables]
    assert f"a.{name}" in names
    assert_same(fmu, scenario, 0.01)


@pytest.mark.slow
def test_command_exports_the_outputs_of_a_pattern(fmu_folder: Path, tmp_path: Path) -> None:
    for options, names in (
        ([], ["lift.reference.x_d", "lift.plant.x_L"]),
        (["--outputs", "lift.plant.x_*"], ["lift.plant.x_L", "lift.plant.x_measured"]),
    ):
        file = tmp_path / f"joint{len(options)}.fmu"
        result = CliRunner().invoke(app, ["export", "lift", str(file), "--fmus", str(fmu_folder), *options])
        assert result.exit_code == 0, result.output
        variables = fmpy.read_model_description(str(file)).modelVariables
        assert [v.name for v in variables if v.causality == "output"] == names


# ---- refusals ------------------------------------------------------------------------------------

REFUSED: dict[str, tuple[dict[str, Any], dict[str, Any], str]] = {
    "an input": ({}, {"inputs": ["nothing"]}, "no input matches 'nothing'"),
    "an output": ({}, {"outputs": ["lift.plant.nothing"]}, "no output matches 'lift.plant.nothing'"),
    "Model Exchange": ({}, {"kind": {"lift.plant": "me"}}, "lift.plant would run as Model Exchange"),
    "error control": ({"error_tolerance": 1e-4}, {}, "steps of one size"),
    "a version": ({}, {"fmi": 4}, "choose from 2 and 3"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_options_that_an_exported_fmu_does_not_support(case: str, fmu_folder: Path, tmp_path: Path) -> None:
    options, exported_with, message = REFUSED[case]
    with pytest.raises(CommandError, match=message):
        load("lift", fmu_folder, **options).export(tmp_path / "no.fmu", **exported_with)
    assert list(tmp_path.iterdir()) == []


def clash(all_types: Path, third: Path, folder: Path) -> ec.System:
    """One name for two variables."""
    dotted = edit_description(all_types, folder / "Dotted.fmu", 'name="twice"', 'name="b.twice"')
    return ec.System.of({"a": dotted, "a.b": all_types})


@pytest.mark.parametrize(
    ("make", "message"),
    mostly_slow(
        [
            (clash, r"two variables have the name 'a\.b\.twice'"),
            (
                lambda all_types, third, folder: ec.System.of({"a": third}, [], {"a.UInt32_in": 2**32 - 1}),
                r"a\.UInt32_in = 4294967295 does not fit into an Integer of FMI 2",
            ),
        ],
        [(clash, r"two variables have the name 'a\.b\.twice'")],
    ),
)
def test_systems_that_cannot_be_one_fmu_are_refused(
    make: Any, message: str, all_types: Path, third: Path, fmu_folder: Path, tmp_path: Path
) -> None:
    system = make(all_types, third, tmp_path)
    with pytest.raises(CommandError, match=message):
        load(system, fmu_folder, **SHORT_RUN).export(tmp_path / "no.fmu", fmi=2)


def test_texts_that_xml_cannot_hold_are_refused(fmu_folder: Path, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text('system = "lift"\nstop_time = 0.02\ndescription = "a \\u0001 b"\n')
    with pytest.raises(CommandError, match=r"the description 'a \\x01 b' has a character"):
        load(file, fmu_folder).export(tmp_path / "no.fmu")
    assert not (tmp_path / "no.fmu").exists()


def test_files_of_the_user_are_not_replaced(fmu_folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "mine.fmu"
    path.write_text("years of work")
    with pytest.raises(CommandError, match="was not written by emla"):
        load("lift", fmu_folder).export(path)
    assert path.read_text() == "years of work"
