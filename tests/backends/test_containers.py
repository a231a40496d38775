"""A system as one FMU: in FMPy it gives the bits of a run, whatever the algorithm."""

import re
import zipfile
from collections.abc import Iterator, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave
from fmpy.validation import validate_fmu
from lxml import etree
from typer.testing import CliRunner

import emla_cosim as ec
from emla_cosim.base.errors import CommandError
from emla_cosim.cli.app import app
from fmublock.archive import write_archive
from tests.support.handwritten_fmu import build_handwritten_fmu
from tests.support.paths import ALL_TYPES

STEP = 1e-4


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("containers")


@pytest.fixture(scope="module")
def lift(fmu_folder: Path, folder: Path) -> Path:
    return load("lift", fmu_folder).export(folder / "lift.fmu", outputs=["*"])


@pytest.fixture(scope="module")
def machine(fmu_folder: Path, folder: Path) -> Path:
    return load("hdrm-coupled", fmu_folder).export(folder / "machine.fmu", outputs=["*"])


@pytest.fixture(scope="module")
def all_types(folder: Path) -> Path:
    return build_handwritten_fmu(folder / "AllTypes.fmu", ALL_TYPES)


def load(source: Any, fmus: Path, **options: Any) -> ec.Scenario:
    return ec.load(source, **{"stop_time": 0.05, "output_interval": 1e-3, "fmus": fmus} | options)


def outputs(fmu: Path) -> list[str]:
    description = fmpy.read_model_description(str(fmu))
    return [v.name for v in description.modelVariables if v.causality == "output"]


def assert_same(fmu: Path, scenario: ec.Scenario, step: float = STEP, **starts: Any) -> None:
    """FMPy gets the bits of the run, at the points of the output interval."""
    options = scenario.options
    with scenario.prepare() as simulation:
        run = simulation.run()
    rows = fmpy.simulate_fmu(
        str(fmu),
        start_time=options.start_time or 0.0,
        stop_time=options.stop_time,
        step_size=step,
        output_interval=options.output_interval,
        output=outputs(fmu),
        start_values=starts,
    )
    compared = [name for name in outputs(fmu) if name in run.names]
    assert compared
    different = [name for name in compared if not np.array_equal(rows[name], run[name])]
    assert different == []


def without_sources(fmu: Path, path: Path) -> Path:
    """The same FMU as somebody else would deliver it: its library is all that there is."""
    with zipfile.ZipFile(fmu) as archive:
        content = {n: archive.read(n) for n in archive.namelist() if not n.startswith("sources/")}
    write_archive(path, content)
    return path


class Host:
    """An instance in FMPy, step by step."""

    def __init__(self, fmu: Path, folder: Path, start: float = 0.0, stop: float | None = None) -> None:
        description = fmpy.read_model_description(str(fmu))
        self.references = {v.name: v.valueReference for v in description.modelVariables}
        self.messages = list[str]()
        fmpy.extract(str(fmu), str(folder))
        self.fmu = FMU2Slave(
            guid=description.guid,
            unzipDirectory=str(folder),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="host",
        )
        self.callbacks = fmpy.fmi2.fmi2CallbackFunctions()
        self.callbacks.logger = fmpy.fmi2.fmi2CallbackLoggerTYPE(self._log)
        self.callbacks.allocateMemory = fmpy.fmi2.fmi2CallbackAllocateMemoryTYPE(fmpy.calloc)
        self.callbacks.freeMemory = fmpy.fmi2.fmi2CallbackFreeMemoryTYPE(fmpy.free)
        self.fmu.instantiate(callbacks=self.callbacks, loggingOn=False)
        self.start, self.stop = start, stop

    def _log(self, _: Any, name: bytes, status: int, category: bytes, message: bytes) -> None:
        self.messages.append(message.decode())

    def begin(self, **values: float) -> None:
        self.fmu.setupExperiment(startTime=self.start, stopTime=self.stop)
        for name, value in values.items():
            self[name] = value
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def __getitem__(self, name: str) -> float:
        return self.fmu.getReal([self.references[name]])[0]

    def __setitem__(self, name: str, value: float) -> None:
        self.fmu.setReal([self.references[name]], [value])

    def read(self, names: Sequence[str]) -> list[float]:
        return self.fmu.getReal([self.references[name] for name in names])


@pytest.fixture
def host(lift: Path, tmp_path: Path) -> Iterator[Host]:
    made = Host(lift, tmp_path)
    yield made
    made.fmu.freeInstance()


@pytest.mark.parametrize("step", [STEP, 1e-3])
def test_a_joint_has_the_bits_of_a_run(lift: Path, fmu_folder: Path, step: float) -> None:
    assert_same(lift, load("lift", fmu_folder), step)


def test_strong_coupling_inside_of_a_host_without_any(machine: Path, fmu_folder: Path) -> None:
    assert_same(machine, load("hdrm-coupled", fmu_folder), 1e-3)


WAYS = {
    "jacobi, extrapolated": {"algorithm": "jacobi", "extrapolation": "master"},
    "lines and samples": {
        "extrapolation": "fmu",
        "step_multiples": {"lift.controller": 5, "lift.observer": 2},
    },
    "strong without loops": {"algorithm": "strong", "step_multiples": {"lift.controller": 10}},
    "another order": {
        "order": ["lift.controller", "lift.observer", "lift.plant", "lift.reference", "lift.disturbance"]
    },
    "a late start": {"start_time": 0.3, "stop_time": 0.35},
    "seven steps per unit": {"step_size": 1e-3 / 7, "stop_time": 0.05},
}


@pytest.mark.parametrize(
    "way",
    [way if way == "lines and samples" else pytest.param(way, marks=pytest.mark.slow) for way in WAYS],
)
def test_every_way_to_step(way: str, fmu_folder: Path, tmp_path: Path) -> None:
    scenario = load("lift", fmu_folder, **WAYS[way])
    fmu = scenario.export(tmp_path / "way.fmu", outputs=["*"])
    assert_same(fmu, scenario, scenario.options.step_size or STEP)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["study", "study-drive", "study-compliant", "prototype", "hdrm-merged"])
def test_other_scenarios(name: str, fmu_folder: Path, tmp_path: Path) -> None:
    scenario = load(name, fmu_folder, stop_time=0.2)
    assert_same(scenario.export(tmp_path / "way.fmu", outputs=["*"]), scenario)


def test_start_values_of_the_host(lift: Path, machine: Path, fmu_folder: Path) -> None:
    """Without a loop these give the bits of --set; in a loop, what the coupling tolerance allows."""
    changed = {"lift.plant.motor.R_s": 0.3, "lift.plant.screw.M_BS": 300.0}
    assert_same(lift, load("lift", fmu_folder, set=changed), **changed)
    with load("hdrm-coupled", fmu_folder, set=changed).prepare() as simulation:
        run = simulation.run()
    rows = fmpy.simulate_fmu(
        str(machine),
        stop_time=0.05,
        step_size=STEP,
        output_interval=1e-3,
        output=["lift.plant.x_L"],
        start_values=changed,
    )
    np.testing.assert_allclose(rows["lift.plant.x_L"], run["lift.plant.x_L"], atol=1e-10)


def test_exported_start_values(fmu_folder: Path, tmp_path: Path) -> None:
    scenario = load("lift", fmu_folder, set={"lift.plant.motor.R_s": 0.3})
    fmu = scenario.export(tmp_path / "changed.fmu", outputs=["*"])
    starts = {v.name: v.start for v in fmpy.read_model_description(str(fmu)).modelVariables}
    assert float(starts["lift.plant.motor.R_s"]) == 0.3
    assert_same(fmu, scenario)


def test_a_state_is_continued_with_the_same_bits(lift: Path, host: Host, tmp_path: Path) -> None:
    names = outputs(lift)
    host.begin()
    for k in range(30):
        host.fmu.doStep(k * STEP, STEP)
    state = host.fmu.getFMUstate()
    content = host.fmu.serializeFMUstate(state)
    for k in range(30, 60):
        host.fmu.doStep(k * STEP, STEP)
    expected = host.read(names)
    host.fmu.setFMUstate(state)
    for k in range(30, 60):
        host.fmu.doStep(k * STEP, STEP)
    assert host.read(names) == expected
    host.fmu.freeFMUstate(state)
    other = Host(lift, tmp_path / "other")
    other.begin()
    other.fmu.setFMUstate(other.fmu.deSerializeFMUstate(content))
    for k in range(30, 60):
        other.fmu.doStep(k * STEP, STEP)
    assert other.read(names) == expected
    damaged = content[:-9] + bytes([content[-9] ^ 1]) + content[-8:]
    with pytest.raises(FMICallException):
        other.fmu.deSerializeFMUstate(damaged)
    assert any("damaged" in m for m in other.messages)
    other.fmu.freeInstance()


def test_a_state_from_before_the_start_has_its_start_values(lift: Path, host: Host) -> None:
    host.begin()
    host.fmu.doStep(0.0, 20 * STEP)
    expected = host.read(outputs(lift))
    host.fmu.reset()
    state = host.fmu.getFMUstate()
    host["lift.plant.motor.R_s"] = 0.5
    host.fmu.setFMUstate(state)
    host.begin()
    host.fmu.doStep(0.0, 20 * STEP)
    assert host.read(outputs(lift)) == expected
    host.fmu.freeFMUstate(state)


def test_reset_begins_anew(lift: Path, host: Host) -> None:
    names = outputs(lift)
    host.begin()
    for k in range(20):
        host.fmu.doStep(k * STEP, STEP)
    expected = host.read(names)
    host.fmu.reset()
    host.begin(**{"lift.plant.motor.R_s": 0.5})
    host.fmu.doStep(0.0, 20 * STEP)
    assert host.read(names) != expected
    host.fmu.reset()
    host.begin()
    host.fmu.doStep(0.0, 20 * STEP)
    assert host.read(names) == expected


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
def test_steps_that_are_none(lift: Path, tmp_path: Path, time: float, step: float, message: str) -> None:
    host = Host(lift, tmp_path, stop=0.1)
    host.begin()
    with pytest.raises(FMICallException):
        host.fmu.doStep(time, step)
    assert any(message in m for m in host.messages), host.messages
    host.fmu.doStep(0.0, 1e-4)  # nothing has changed
    host.fmu.freeInstance()


def test_rounded_times_of_a_host(lift: Path, host: Host, tmp_path: Path) -> None:
    """A host that adds up its steps gets the bits of one that multiplies."""
    host.begin()
    other, time = Host(lift, tmp_path / "other"), 0.0
    other.begin()
    for k in range(200):
        host.fmu.doStep(k * STEP, STEP)
        other.fmu.doStep(time, STEP)
        time += STEP
    assert other.read(outputs(lift)) == host.read(outputs(lift))
    other.fmu.freeInstance()


def test_what_a_part_says_has_its_name(host: Host) -> None:
    with pytest.raises(FMICallException):
        host.begin(**{"lift.plant.motor.R_s": -1.0})
    assert any("lift.plant: motor.R_s = -1 is outside its range" in m for m in host.messages), host.messages
    host.fmu.reset()
    host.begin()


def test_fmpy_and_the_schema_say_nothing(lift: Path) -> None:
    assert validate_fmu(str(lift)) == []


def test_the_page_draws_the_inside(lift: Path, machine: Path, fmu_folder: Path) -> None:
    for fmu, name in ((lift, "lift"), (machine, "hdrm-coupled")):
        system = load(name, fmu_folder).system
        with zipfile.ZipFile(fmu) as archive:
            page = archive.read("documentation/index.html").decode()
        (picture,) = re.findall(r"<svg.*?</svg>", page)
        drawing = etree.fromstring(picture)
        svg = "{http://www.w3.org/2000/svg}"
        boxes = [group[0].text.partition(": ")[0] for group in drawing.findall(f"{svg}g")]
        assert sorted(boxes) == sorted(c.name for c in system.components)
        wires = [path[0].text.split("; ") for path in drawing.findall(f"{svg}path")]
        connections = [f"{x.source}.{x.output} → {x.target}.{x.input}" for x in system.connections]
        assert sorted(wire for bundle in wires for wire in bundle) == sorted(connections)


def test_terminals_of_what_is_outside(lift: Path, fmu_folder: Path, tmp_path: Path) -> None:
    """Also of a container in a container."""
    inner = load(ec.System.of({"plant": "EmlaPlant"}), fmu_folder, step_size=STEP)
    plant = inner.export(tmp_path / "plant.fmu", inputs=["plant.F_L", "plant.u_q"], outputs=["plant.v_L"])
    scenario = load(ec.System.of({"machine": plant}), fmu_folder, step_size=STEP)
    outer = scenario.export(tmp_path / "outer.fmu")
    place = files("fmpy").joinpath("schema", "fmi3", "fmi3TerminalsAndIcons.xsd")
    schema = etree.XMLSchema(etree.parse(str(place)))
    for fmu, prefix in ((plant, ""), (outer, "machine.")):
        with zipfile.ZipFile(fmu) as archive:
            root = etree.fromstring(archive.read("terminalsAndIcons/terminalsAndIcons.xml"))
        schema.assertValid(root)
        found = {
            (terminal.get("name"), member.get("memberName")): member.get("variableName")
            for terminal in root.iter("Terminal")
            for member in terminal
        }
        assert found == {
            (f"{prefix}plant.load", "F_L"): f"{prefix}plant.F_L",
            (f"{prefix}plant.load", "v_L"): f"{prefix}plant.v_L",
            (f"{prefix}plant.drive", "u_q"): f"{prefix}plant.u_q",
        }
    with zipfile.ZipFile(lift) as archive:
        named = etree.fromstring(archive.read("terminalsAndIcons/terminalsAndIcons.xml"))
    shown = [m.get("variableName") for m in named.iter("TerminalMemberVariable")]
    assert "lift.plant.x_measured" in shown and set(shown) <= set(outputs(lift))


def test_its_variables(lift: Path, fmu_folder: Path, tmp_path: Path) -> None:
    description = fmpy.read_model_description(str(lift))
    variables = {v.name: v for v in description.modelVariables}
    assert variables["lift.plant.motor.R_s"].unit == "Ohm"
    assert variables["lift.plant.motor.R_s"].causality == "parameter"
    assert "lift.plant.u_q" not in variables  # a connection drives it
    assert variables["der(lift.plant.x_L)"].causality == "local"
    shown = load("lift", fmu_folder).export(tmp_path / "shown.fmu")
    assert outputs(shown) == ["lift.reference.x_d", "lift.plant.x_L"]


def test_inputs_act_from_the_next_step_on(fmu_folder: Path, tmp_path: Path) -> None:
    """The plant alone: its open inputs are those of the FMU, and a current follows a voltage."""
    system = ec.System.of({"plant": "EmlaPlant"})
    scenario = load(system, fmu_folder, step_size=STEP)
    fmu = scenario.export(tmp_path / "plant.fmu", inputs=["plant.u_*"])
    description = fmpy.read_model_description(str(fmu))
    causality = {v.name: v.causality for v in description.modelVariables}
    assert {n for n, c in causality.items() if c == "input"} == {"plant.u_q", "plant.u_d"}
    assert causality["plant.F_L"] == "parameter"
    host = Host(fmu, tmp_path / "host")
    host.begin()
    host["plant.u_q"] = 10.0
    assert host["plant.i_q"] == 0.0
    host.fmu.doStep(0.0, STEP)
    assert host["plant.i_q"] > 0.0
    host.fmu.freeInstance()
    with scenario.prepare() as simulation:
        simulation["plant.u_q"] = 10.0
        simulation.advance(STEP)
        assert simulation["plant.i_q"] > 0.0


def test_fmus_of_others_are_carried_along(fmu_folder: Path, all_types: Path, tmp_path: Path) -> None:
    """Libraries without sources, of which one has connections of all types."""
    scenario = load("lift", fmu_folder)
    models = {c.name: c.model for c in scenario.system.components}
    plant = without_sources(fmu_folder / "EmlaPlant/EmlaPlant.fmu", tmp_path / "Plant.fmu")
    assert models["lift.plant"] == "EmlaPlant"
    changed = load("lift", fmu_folder, replace={"lift.plant": plant})
    fmu = changed.export(tmp_path / "carried.fmu", outputs=["*"])
    with zipfile.ZipFile(fmu) as archive:
        assert any(n.startswith("resources/EmlaPlant/binaries/") for n in archive.namelist())
    assert_same(fmu, changed)
    wires = ["a.high -> b.on", "a.count -> b.u"]
    pair = ec.System.of({"a": all_types, "b": all_types}, wires, set={"a.u": 2.0})
    both = load(pair, fmu_folder, step_size=0.01, stop_time=0.5, output_interval=0.02)
    assert_same(both.export(tmp_path / "types.fmu", outputs=["*"]), both, 0.01)


def test_a_container_in_a_container(lift: Path, fmu_folder: Path, tmp_path: Path) -> None:
    system = ec.System.of({"inner": lift})
    scenario = load(system, fmu_folder, step_size=STEP)
    fmu = scenario.export(tmp_path / "outer.fmu", outputs=["inner.*.x_*"])
    rows = fmpy.simulate_fmu(str(fmu), stop_time=0.05, step_size=STEP, output_interval=1e-3)
    with load("lift", fmu_folder).prepare() as simulation:
        run = simulation.run()
    np.testing.assert_array_equal(rows["inner.lift.plant.x_L"], run["lift.plant.x_L"])


def test_data_and_faults_inside(fmu_folder: Path, tmp_path: Path) -> None:
    data = tmp_path / "load.csv"
    data.write_text("time,lift.plant.F_L\n0,1000\n0.02,5000\n0.05,2000\n")
    scenario = load("lift", fmu_folder, input=[data], fault=["lift.plant.x_measured=offset:1e-5@0.01+0.02"])
    assert_same(scenario.export(tmp_path / "data.fmu", outputs=["*"]), scenario)


@pytest.mark.slow
def test_equal_content_gives_equal_bytes(fmu_folder: Path, lift: Path, tmp_path: Path) -> None:
    again = load("lift", fmu_folder).export(tmp_path / "lift.fmu", outputs=["*"])
    assert again.read_bytes() == lift.read_bytes()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"inputs": ["nothing"]}, "no input matches 'nothing'"),
        ({"outputs": ["lift.plant.nothing"]}, "no output matches 'lift.plant.nothing'"),
        ({"kind": {"lift.plant": "me"}}, "lift.plant would run as Model Exchange"),
    ],
)
def test_what_cannot_be_one_fmu(
    options: dict[str, Any], message: str, fmu_folder: Path, tmp_path: Path
) -> None:
    with pytest.raises(CommandError, match=message):
        load("lift", fmu_folder).export(tmp_path / "no.fmu", **options)
    assert not (tmp_path / "no.fmu").exists()


def test_steps_of_other_lengths_are_refused(fmu_folder: Path, tmp_path: Path) -> None:
    with pytest.raises(CommandError, match="steps of one size"):
        load("hdrm-coupled", fmu_folder, error_tolerance=1e-4).export(tmp_path / "no.fmu")


def test_texts_that_xml_cannot_hold_are_refused(fmu_folder: Path, tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text('system = "lift"\nstop_time = 0.02\ndescription = "a \\u0001 b"\n')
    with pytest.raises(CommandError, match=r"the description 'a \\x01 b' has a character"):
        load(file, fmu_folder).export(tmp_path / "no.fmu")
    assert not (tmp_path / "no.fmu").exists()


def test_a_file_of_the_users_stays(fmu_folder: Path, tmp_path: Path) -> None:
    mine = tmp_path / "mine.fmu"
    mine.write_text("years of work")
    with pytest.raises(CommandError, match="was not written by emla"):
        load("lift", fmu_folder).export(mine)
    assert mine.read_text() == "years of work"


def test_the_command(fmu_folder: Path, tmp_path: Path) -> None:
    file = tmp_path / "joint.fmu"
    arguments = ["export", "lift", str(file), "--fmus", str(fmu_folder), "--outputs", "lift.plant.x_*"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert outputs(file) == ["lift.plant.x_L", "lift.plant.x_measured"]


@pytest.mark.slow
def test_every_platform(tmp_path: Path) -> None:
    """In a folder of its own: its FMUs get more binaries, and checkpoints of other tests do not fit them."""
    platforms = ["linux64", "win64", "darwin64", "aarch64-linux", "aarch64-darwin"]
    fmu = load("lift", tmp_path / "fmus").export(tmp_path / "all.fmu", platform=platforms)
    with zipfile.ZipFile(fmu) as archive:
        assert {n.split("/")[1] for n in archive.namelist() if n.startswith("binaries/")} == set(platforms)


def test_units_of_other_fmus(all_types: Path, fmu_folder: Path, tmp_path: Path) -> None:
    """A unit without definition keeps its name; one that two FMUs define otherwise gets another."""
    other = tmp_path / "Other.fmu"
    with zipfile.ZipFile(all_types) as archive:
        content = {n: archive.read(n) for n in archive.namelist()}
    description = content["modelDescription.xml"]
    changed = description.replace(b'<Unit name="m"><BaseUnit m="1"/></Unit>', b"")
    changed = changed.replace(b'<BaseUnit m="1" s="-1"/>', b'<BaseUnit m="1" s="-1" factor="0.001"/>')
    assert changed != description
    write_archive(other, content | {"modelDescription.xml": changed})
    system = ec.System.of({"a": all_types, "b": other})
    scenario = load(system, fmu_folder, step_size=0.01, stop_time=0.1, output_interval=0.01, lenient=True)
    fmu = scenario.export(tmp_path / "units.fmu")
    read = fmpy.read_model_description(str(fmu), validate=False)
    units = {v.name: v.unit for v in read.modelVariables}
    factors = {u.name: None if u.baseUnit is None else float(u.baseUnit.factor) for u in read.unitDefinitions}
    assert units["a.x"] == "m" and units["b.x"] in ("m", "m_2")
    assert factors[units["a.u"]] == 1.0
    assert factors[units["b.u"]] == 0.001
    assert units["a.u"] != units["b.u"]


def test_one_name_for_two_variables_is_refused(all_types: Path, fmu_folder: Path, tmp_path: Path) -> None:
    dotted = tmp_path / "Dotted.fmu"
    with zipfile.ZipFile(all_types) as archive:
        content = {n: archive.read(n) for n in archive.namelist()}
    description = content["modelDescription.xml"].replace(b'name="twice"', b'name="b.twice"')
    write_archive(dotted, content | {"modelDescription.xml": description})
    system = ec.System.of({"a": dotted, "a.b": all_types})
    scenario = load(system, fmu_folder, step_size=0.01, stop_time=0.1, output_interval=0.01)
    with pytest.raises(CommandError, match=r"two variables have the name 'a\.b\.twice'"):
        scenario.export(tmp_path / "twice.fmu")


def test_hostile_names_stay_text(all_types: Path, fmu_folder: Path, tmp_path: Path) -> None:
    """Of files from elsewhere, in the page, in C and in XML."""
    evil = tmp_path / "Evil.fmu"
    with zipfile.ZipFile(all_types) as archive:
        content = {n: archive.read(n) for n in archive.namelist()}
    name = 'x"); system("true"); //<script>alert(1)</script>'
    escaped = name.replace("<", "&lt;").replace('"', "&quot;").encode()
    content["modelDescription.xml"] = content["modelDescription.xml"].replace(
        b'name="twice"', b'name="' + escaped + b'"'
    )
    write_archive(evil, content)
    scenario = load(
        ec.System.of({"a": evil}), fmu_folder, step_size=0.01, stop_time=0.1, output_interval=0.01
    )
    fmu = scenario.export(tmp_path / "evil.fmu", outputs=["*"])
    with zipfile.ZipFile(fmu) as archive:
        page = archive.read("documentation/index.html")
    assert b"<script>" not in page
    assert len(etree.fromstring(re.findall(rb"<svg.*?</svg>", page)[0])) > 0
    names = [v.name for v in fmpy.read_model_description(str(fmu), validate=False).modelVariables]
    assert f"a.{name}" in names
    assert_same(fmu, scenario, 0.01)
