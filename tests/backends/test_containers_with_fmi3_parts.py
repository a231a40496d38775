"""A system as one FMU with parts of FMI 3.0: it gives the bits of a run with the same parts."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

import emla_cosim as ec
import fmublock
from emla_cosim.base.errors import CommandError
from emla_cosim.fmu.fmi_3_calls import NUMBER_TYPES
from emla_cosim.fmu.models import MODELS
from tests.backends.test_containers import STEP, Host, assert_same, load, outputs
from tests.backends.test_containers_fmi3 import Host as Host3
from tests.support.event_fmu import build_event_fmu
from tests.support.handwritten_fmu import build_handwritten_fmu
from tests.support.paths import SUPPORT

SOURCE = SUPPORT / "fmi3" / "fmi3.c"
DISCARDS, TERMINATES, RETURNS_EARLY, WANTS_EVENT = 1, 2, 3, 4
WIRES = [
    "a.y -> b.u",
    *("a.Float32_out -> b.Float32_in", "a.Int8_out -> b.UInt64_in", "a.UInt64_out -> b.Int8_in"),
    *("a.UInt8_out -> b.Int16_in", "a.Int16_out -> b.UInt8_in", "a.UInt16_out -> b.Int32_in"),
    *("a.Int32_out -> b.UInt16_in", "a.UInt32_out -> b.Int64_in", "a.Int64_out -> b.UInt32_in"),
    *("a.Boolean_out -> b.Boolean_in", "a.Enumeration_out -> b.Enumeration_in"),
]
STARTS: dict[str, Any] = {
    "a.u[1,1]": 3.0,
    "a.gain[2,1]": 7.0,
    "b.gain[1,2]": -2.0,
    "a.Float32_in": 0.1,
    "a.Int8_in": 127,
    "a.UInt8_in": 255,
    "a.Int16_in": 250,
    "a.UInt16_in": 65535,
    "a.Int32_in": 65000,
    "a.UInt32_in": 2**32 - 1,
    "a.Int64_in": 2**32 - 2,
    "a.UInt64_in": 99,
    "a.Boolean_in": True,
    "a.Enumeration_in": "two",
}
TIMES = {"step_size": 0.125, "stop_time": 2.0, "output_interval": 0.125}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("parts")


@pytest.fixture(scope="module")
def third(folder: Path) -> Path:
    """An FMU with variables of all types and arrays."""
    return build_handwritten_fmu(folder / "Third.fmu", SOURCE, platform=fmpy.platform_tuple)


Replace = Callable[[str, Sequence[str]], dict[str, Path]]


@pytest.fixture(scope="module")
def replace(fmu_folder: Path, folder: Path) -> Replace:
    """Return the FMUs of a scenario built for FMI 3.0, of components with these ends of their names."""
    built: dict[str, Path] = {}

    def replace(scenario: str, ends: Sequence[str]) -> dict[str, Path]:
        found = {}
        for component in load(scenario, fmu_folder).system.components:
            model = component.model
            if model in MODELS and component.name.endswith(tuple(ends)):
                if model not in built:
                    built[model] = fmublock.build(MODELS[model], folder / f"{model}.fmu", fmi=3)
                found[component.name] = built[model]
        assert found
        return found

    return replace


@pytest.fixture(scope="module")
def lift(fmu_folder: Path, folder: Path, replace: Replace) -> Path:
    scenario = load("lift", fmu_folder, replace=replace("lift", [""]))
    return scenario.export(folder / "lift.fmu", outputs=["*"], fmi=3)


@pytest.fixture(scope="module")
def pair(third: Path, folder: Path, fmu_folder: Path) -> Path:
    return typed(third, fmu_folder).export(folder / "pair.fmu", outputs=["*"], fmi=3)


def typed(third: Path, fmus: Path) -> ec.Scenario:
    return load(ec.System.of({"a": third, "b": third}, WIRES, STARTS), fmus, **TIMES)


PARTS = {"all": [""], "plants": [".plant", ".drive"]}


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("parts", PARTS)
def test_a_joint_has_the_bits_of_a_run(
    parts: str, fmi: int, fmu_folder: Path, replace: Replace, tmp_path: Path
) -> None:
    """Also those of its parts for FMI 2.0, and with steps of the host of two sizes."""
    scenario = load("lift", fmu_folder, replace=replace("lift", PARTS[parts]))
    fmu = scenario.export(tmp_path / "lift.fmu", outputs=["*"], fmi=fmi)
    for step in (STEP, 1e-3):
        assert_same(fmu, scenario, step)
    assert_same(fmu, load("lift", fmu_folder), 1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("algorithm", ["jacobi", "gauss-seidel", "strong"])
@pytest.mark.parametrize("parts", PARTS)
@pytest.mark.parametrize("name", ["lift", "study-drive", "hdrm-coupled"])
def test_algorithms(
    name: str, parts: str, algorithm: str, fmu_folder: Path, replace: Replace, tmp_path: Path
) -> None:
    options = {"algorithm": algorithm, "stop_time": 0.01}
    if name == "hdrm-coupled" and algorithm != "strong":
        options["stop_time"] = 0.002  # without strong coupling it diverges
    scenario = load(name, fmu_folder, replace=replace(name, PARTS[parts]), **options)
    fmu = scenario.export(tmp_path / "system.fmu", outputs=["*"], fmi=3 if parts == "all" else 2)
    for step in (STEP, 1e-3):
        assert_same(fmu, scenario, step)


def test_strong_coupling_in_a_system_of_ours(fmu_folder: Path, replace: Replace, tmp_path: Path) -> None:
    """The machine, with plants of FMI 3.0, is a component of another system."""
    plants = replace("hdrm-coupled", PARTS["plants"])
    scenario = load("hdrm-coupled", fmu_folder, replace=plants, stop_time=0.01)
    fmu = scenario.export(tmp_path / "machine.fmu", fmi=3, outputs=["*.x_L", "*.F_L"])
    with scenario.prepare() as simulation:
        expected = simulation.run()
    with load(ec.System.of({"m": fmu}), fmu_folder, step_size=1e-3, stop_time=0.01).prepare() as simulation:
        found = simulation.run()
    compared = [n for n in outputs(fmu) if n in expected.names]
    assert len(compared) >= 6
    for name in compared:
        np.testing.assert_array_equal(found[f"m.{name}"], expected[name])


def test_second_start_and_saved_state(lift: Path, tmp_path: Path) -> None:
    names, host = outputs(lift), Host3(lift, tmp_path)
    fmu = host.fmu
    host.begin()
    fmu.doStep(0.0, 30 * STEP)
    state = fmu.getFMUState()
    content = fmu.serializeFMUState(state)
    fmu.doStep(30 * STEP, 30 * STEP)
    expected = host.read(*names)
    fmu.setFMUState(state)
    fmu.doStep(30 * STEP, 30 * STEP)
    assert host.read(*names) == expected
    fmu.freeFMUState(state)
    fmu.reset()
    resistance = host.references["lift.plant.motor.R_s"]
    fmu.setFloat64([resistance], [0.5])
    host.begin()
    fmu.doStep(0.0, 60 * STEP)
    assert host.read(*names) != expected
    fmu.reset()
    host.begin()
    fmu.doStep(0.0, 60 * STEP)
    assert host.read(*names) == expected
    fmu.setFMUState(fmu.deserializeFMUState(content))
    fmu.doStep(30 * STEP, 30 * STEP)
    assert host.read(*names) == expected
    fmu.terminate()
    fmu.freeInstance()


def test_fixed_parameters_stay_after_initialization(pair: Path, tmp_path: Path) -> None:
    """Also of parts that accept others at any time, whose inputs can be set."""
    host = Host3(pair, tmp_path)
    host.begin()
    with pytest.raises(FMICallException):
        host.fmu.setFloat64([host.references["a.gain[1,1]"]], [2.0])
    assert "a.gain[1,1] cannot be set after initialization" in host.messages[-1]
    host.fmu.setFloat64([host.references["a.u[1,1]"]], [2.0])
    host.fmu.freeInstance()


def test_messages_of_a_part_have_its_name(lift: Path, tmp_path: Path) -> None:
    host = Host3(lift, tmp_path)
    host.fmu.setFloat64([host.references["lift.plant.motor.R_s"]], [-1.0])
    with pytest.raises(FMICallException):
        host.begin()
    assert any("lift.plant: motor.R_s = -1 is outside its range" in m for m in host.messages), host.messages
    host.fmu.reset()
    host.begin()
    host.fmu.freeInstance()


@pytest.mark.parametrize("fmi", [2, 3])
def test_all_types_and_arrays(fmi: int, third: Path, fmu_folder: Path, tmp_path: Path) -> None:
    scenario = typed(third, fmu_folder)
    if fmi == 2:
        with pytest.raises(
            CommandError, match=r"a\.UInt32_in = 4294967295 does not fit into an Integer of FMI 2"
        ):
            scenario.export(tmp_path / "pair.fmu", fmi=2)
        system = ec.System.of(
            {"a": third, "b": third}, WIRES, {**STARTS, "a.UInt32_in": 7, "a.Int64_in": 2**31 - 1}
        )
        scenario = load(system, fmu_folder, **TIMES)
    fmu = scenario.export(tmp_path / "pair.fmu", outputs=["*"], fmi=fmi)
    assert_same(fmu, scenario, 0.25 / 2)


def test_values_of_a_host(pair: Path, tmp_path: Path) -> None:
    """Each type has its function, and an element of an array leaves the others."""
    host = Host3(pair, tmp_path)
    fmu, reference = host.fmu, host.references
    kinds = {v.name: v.type for v in fmpy.read_model_description(str(pair)).modelVariables}
    for kind in (*NUMBER_TYPES[1:], "Boolean"):  # Float64 is set below
        assert kinds[f"a.{kind}_in"] == kind
        if kind not in ("UInt64", "Int64", "Int32", "Int16"):  # which b could not take
            getattr(fmu, f"set{kind}")([reference[f"a.{kind}_in"]], [1])
    fmu.setInt64([reference["a.Enumeration_in"]], [1])
    fmu.setFloat64([reference["a.gain[1,2]"], reference["a.u[2,2]"]], [10.0, 4.0])
    host.begin()
    fmu.doStep(0.0, 0.125)
    assert list(fmu.getUInt8([reference["a.UInt8_out"]])) == [1]
    assert list(fmu.getUInt16([reference["a.UInt16_out"]])) == [1]
    assert list(fmu.getInt64([reference["a.Int64_out"], reference["a.Enumeration_out"]])) == [2**32 - 2, 1]
    # y = gain * u, elementwise
    assert host.read(*(f"a.y[{e}]" for e in ("1,1", "1,2", "2,1", "2,2"))) == [3.0, 5.0, 3.5, 16.0]
    assert host.read("a.gain[2,1]", "a.gain[1,2]", "a.gain[2,2]") == [7.0, 10.0, 4.0]
    fmu.setUInt64([reference["a.UInt64_in"]], [200])  # b's input is an Int8
    with pytest.raises(FMICallException):
        for k in range(1, 4):
            fmu.doStep(k * 0.125, 0.125)
    assert any("= 200 does not fit into an input of b, whose type is Int8" in m for m in host.messages)
    fmu.reset()
    with pytest.raises(FMICallException):
        fmu.setUInt64([reference["a.UInt64_in"]], [2**53 + 1])
    assert "does not fit into the type of a, UInt64" in host.messages[-1]
    fmu.setString([reference["a.text"]], ["é"])
    assert fmu.getString([reference["a.text"]]) == ["é"]
    fmu.freeInstance()


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (DISCARDS, "a discarded the step from t = 0.5 s"),
        (TERMINATES, "a asks to end the simulation at t = 0.5 s"),
        (RETURNS_EARLY, "a returned early at t = 0.5 s, which was not allowed"),
        (WANTS_EVENT, "a asked for event mode, which is not used"),
    ],
)
def test_what_a_step_says_is_not_ignored(
    fault: int, words: str, third: Path, fmu_folder: Path, tmp_path: Path
) -> None:
    scenario = load(ec.System.of({"a": third}, [], {"a.fault": fault, "a.end": 0.5}), fmu_folder, **TIMES)
    host = Host(scenario.export(tmp_path / "faulty.fmu"), tmp_path / "host")
    host.fmu.setDebugLogging(True, [])
    host.begin()
    with pytest.raises(FMICallException):
        for k in range(8):
            host.fmu.doStep(k * 0.125, 0.125)
    assert any(words in m for m in host.messages), host.messages
    host.fmu.freeInstance()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"early": False}, r"FMUs with event mode \(hasEventMode\); a has it"),
        ({"events": False}, r"FMUs with early return \(mightReturnEarlyFromDoStep\); a has it"),
        ({"clock": "periodic"}, "FMUs with clocks; a has it"),
    ],
)
def test_what_it_cannot_step_is_refused(
    options: dict[str, Any], message: str, fmu_folder: Path, tmp_path: Path
) -> None:
    fmu = build_event_fmu(tmp_path / "Events.fmu", **options)
    scenario = load(ec.System.of({"a": fmu}), fmu_folder, **TIMES)
    with pytest.raises(CommandError, match=message):
        scenario.export(tmp_path / "no.fmu")
