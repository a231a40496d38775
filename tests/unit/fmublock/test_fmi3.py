"""FMUs for FMI 3.0, against those for FMI 2.0 of the same block, differences and the published schemas."""

import re
from collections.abc import Sequence
from ctypes import byref, c_double, c_int, c_size_t, c_uint32
from importlib.resources import files
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi3 import FMU3Model
from fmpy.validation import validate_fmu
from lxml import etree

from emla_cosim.base.errors import CommandError
from emla_cosim.fmu.models import build as build_model
from emla_cosim.fmu.models import fmu_path
from fmublock import Block, BuildError, Output, build
from fmublock.__main__ import main
from fmublock.archive import read_built
from fmublock.platforms import host_platform
from tests.support.blocks import OWN
from tests.support.c_programs import needs_cc
from tests.support.fmi3_host import Host, call_at_random, root_of
from tests.support.sessions import DISCARD, ERROR
from tests.support.tiers import mostly_slow
from tests.support.toy import Toy

REFERENCE = Toy.layout().reference
FORCE, GAINS, X, V, POWER = (REFERENCE(n) for n in ("force", "spring.k[1]", "x", "v[1]", "power"))
RATES = len(Toy.layout().scalars)
"""Value reference of the first derivative; the time follows the three of them."""
TIME = RATES + 3


def test_documents_follow_the_published_schemas(fmi3_toy_fmu: Path) -> None:
    assert validate_fmu(str(fmi3_toy_fmu)) == []
    assert read_built(fmi3_toy_fmu).platforms == {host_platform()}
    for name, schema in {
        "modelDescription.xml": "ModelDescription",
        "sources/buildDescription.xml": "BuildDescription",
        "terminalsAndIcons/terminalsAndIcons.xml": "TerminalsAndIcons",
    }.items():
        schema_file = files("fmpy").joinpath("schema", "fmi3", f"fmi3{schema}.xsd")
        etree.XMLSchema(etree.parse(str(schema_file))).assertValid(root_of(fmi3_toy_fmu, name))


def test_arrays_are_arrays(fmi3_toy_fmu: Path) -> None:
    variables = {
        v.get("name"): v for v in root_of(fmi3_toy_fmu, "modelDescription.xml").find("ModelVariables")
    }
    gains, rate = variables["spring.k"], variables["der(v)"]
    assert (gains.tag, gains.get("start"), gains.get("unit")) == ("Float64", "3.0 0.25", "N/m")
    assert [d.get("start") for d in gains.findall("Dimension")] == ["2"]
    assert [d.get("start") for d in rate.findall("Dimension")] == ["2"]
    assert (rate.get("derivative"), rate.get("unit")) == (str(V), "m/s2")
    assert not [name for name in variables if "[" in name]
    assert {variables[n].tag for n in ("count", "seed")} == {"Int32"}
    assert (variables["shape"].tag, variables["shape"].get("declaredType")) == ("Enumeration", "Shape")
    assert (variables["damped"].tag, variables["damped"].get("start")) == ("Boolean", "true")
    assert (variables["time"].get("causality"), variables["time"].get("valueReference")) == (
        "independent",
        str(TIME),
    )


class Watch(Block):
    """A block with a variable named time, and none in seconds."""

    time = Output()

    def outputs(self, v: Any) -> dict[str, Any]:
        return {"time": 2.0}


def test_variable_of_the_block_can_be_named_time(tmp_path: Path) -> None:
    fmu = build(Watch, tmp_path / "Watch.fmu", fmi=3)
    assert validate_fmu(str(fmu)) == []
    host = Host(fmu, tmp_path / "fmu")
    causalities = {v.name: v.causality for v in host.description.modelVariables}
    assert causalities == {"time": "output", "time_": "independent"}
    slave = host.started()
    slave.doStep(0.0, 0.5)
    assert slave.getFloat64([0, 1]) == [2.0, 0.5]
    host.close()


def test_every_function_of_the_standard_is_exported(host: Host) -> None:
    header = files("fmpy").joinpath("c-code", "fmi3Functions.h").read_text()
    names = set(re.findall(r"^FMI3_Export fmi3\w+TYPE\s+(fmi3\w+);", header, re.MULTILINE))
    library = host.new().dll
    assert len(names) > 70
    assert [name for name in sorted(names) if not hasattr(library, name)] == []


def compare(two: Path, three: Path, kind: str, signal: Any = None, stop_time: float = 0.2) -> None:
    """Check that both versions give the same bits of every output, of vectors element by element."""
    options = {"fmi_type": kind, "stop_time": stop_time, "output_interval": 0.01, "input": signal}
    columns = []
    for fmu in (two, three):
        outputs = [
            v.name for v in fmpy.read_model_description(str(fmu)).modelVariables if v.causality == "output"
        ]
        rows = fmpy.simulate_fmu(str(fmu), output=outputs, **options)
        assert len(rows) == round(stop_time / 0.01) + 1
        columns.append(np.column_stack([rows[name] for name in rows.dtype.names]))
    assert columns[0].shape[1] > 1
    assert columns[0].tobytes() == columns[1].tobytes()


@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
def test_both_versions_give_the_same_bits(fmi3_toy_fmu: Path, native_toy_fmu: Path, kind: str) -> None:
    signal = np.array([(0.0, 0.5), (0.07, 1.5), (0.2, -1.0)], dtype=[("time", float), ("force", float)])
    compare(native_toy_fmu, fmi3_toy_fmu, kind, signal)


@pytest.mark.parametrize("model", mostly_slow(OWN, ["Reference"]))
def test_our_models_are_valid_and_give_the_same_bits(model: str, fmu_folder: Path, tmp_path: Path) -> None:
    two, three = fmu_path(model, "native", fmu_folder), build_model(model, "native", [], tmp_path, fmi=3)
    assert validate_fmu(str(three)) == []
    compare(two, three, "CoSimulation")
    if fmpy.read_model_description(str(three)).modelExchange is not None:
        compare(two, three, "ModelExchange", stop_time=0.05)


def test_values_of_arrays_and_types(host: Host) -> None:
    slave = host.new()
    slave.setFloat64([GAINS, FORCE], [5.0, 6.0, 7.0])
    slave.setInt64([REFERENCE("shape")], [2])
    slave.setInt32([REFERENCE("count")], [4])
    slave.setBoolean([REFERENCE("damped")], [False])
    slave.enterInitializationMode(startTime=1.5)
    assert slave.getFloat64([FORCE, GAINS, TIME], nValues=4) == [7.0, 5.0, 6.0, 1.5]
    assert (slave.getInt64([REFERENCE("shape")]), slave.getInt32([REFERENCE("count")])) == ([2], [4])
    assert slave.getBoolean([REFERENCE("damped")]) == [False]
    assert "2 values were announced" in host.refused(slave.setFloat64, [GAINS, FORCE], [1.0, 2.0])
    assert "no variable" in host.refused(slave.getFloat64, [GAINS + 1])
    assert "no variable" in host.refused(slave.getFloat64, [TIME + 1])
    assert "Enumeration" in host.refused(slave.getInt32, [REFERENCE("shape")])
    assert "computed" in host.refused(slave.setFloat64, [TIME], [2.0])
    for get in (slave.getFloat32, slave.getInt8, slave.getUInt64, slave.getString):
        assert "force is of type Float64" in host.refused(get, [FORCE])
    assert slave.getFloat64([FORCE]) == [7.0]


KNOWNS, N_KNOWNS = [FORCE, GAINS, V], 5
UNKNOWNS, N_UNKNOWNS = [POWER, V, RATES, RATES + 1], 6


def matrix(slave: Any) -> np.ndarray:
    """The matrix of partial derivatives, column by column."""
    columns = [
        slave.getDirectionalDerivative(UNKNOWNS, KNOWNS, seed, nSensitivity=N_UNKNOWNS)
        for seed in np.eye(N_KNOWNS)
    ]
    return np.array(columns).T


@pytest.mark.parametrize("running", [False, True])
def test_adjoint_derivatives_are_the_transposed_directional_ones(host: Host, running: bool) -> None:
    slave = host.started(running=running)
    for seed in (*np.eye(N_UNKNOWNS), [1.0, -2.0, 0.5, 3.0, 0.25, -1.0]):
        actual = slave.getAdjointDerivative(UNKNOWNS, KNOWNS, list(seed), nSensitivity=N_KNOWNS)
        np.testing.assert_allclose(actual, matrix(slave).T @ seed, rtol=1e-14, atol=1e-15)
    assert "computed" in host.refused(slave.setFloat64, [POWER], [1.0])
    assert "announced" in host.refused(slave.getAdjointDerivative, UNKNOWNS, KNOWNS, [1.0], N_KNOWNS)
    assert "to differentiate" in host.refused(slave.getAdjointDerivative, [TIME], [FORCE], [1.0], 1)
    assert "by" in host.refused(slave.getAdjointDerivative, [POWER], [TIME], [1.0], 1)


def test_output_derivatives_match_the_states(host: Host) -> None:
    slave = host.started()
    slave.doStep(0.0, 0.1)
    assert slave.getOutputDerivatives([X], [1]) == slave.getFloat64([RATES])
    assert "order 2" in host.refused(slave.getOutputDerivatives, [X], [2])


def dependencies_of(slave: Any, unknown: int) -> tuple[Sequence[int], ...]:
    """Return elements of the unknown, value references of the knowns, and elements of these."""
    n = c_size_t()
    slave.fmi3GetNumberOfVariableDependencies(slave.component, unknown, byref(n))
    actual = [(kind * n.value)() for kind in (c_size_t, c_uint32, c_size_t, c_int)]
    slave.fmi3GetVariableDependencies(slave.component, unknown, *actual, n.value)
    return tuple(map(list, actual[:3]))


def test_dependencies_by_element_match_the_derivatives(host: Host, fmi3_toy_fmu: Path) -> None:
    slave = host.started()
    actual = set(zip(*dependencies_of(slave, RATES + 1), strict=True))
    assert actual == {(1, FORCE, 1), (1, X, 1), (1, V, 1), (2, V, 2), (2, TIME, 1)}
    structure = {
        int(u.get("valueReference")): {int(reference) for reference in u.get("dependencies").split()}
        for u in root_of(fmi3_toy_fmu, "modelDescription.xml").find("ModelStructure")
        if u.tag != "InitialUnknown"
    }
    for unknown, knowns in structure.items():
        assert set(dependencies_of(slave, unknown)[1]) == knowns
    message = host.refused(slave.fmi3GetVariableDependencies, slave.component, X, None, None, None, None, 99)
    assert "99" in message


def test_calls_in_the_invalid_order_are_refused(host: Host) -> None:
    slave = host.new()
    assert "phase instantiated" in host.refused(slave.exitInitializationMode)
    assert "phase instantiated" in host.refused(slave.doStep, 0.0, 0.1)
    assert "phase instantiated" in host.refused(slave.terminate)
    assert "not after the start" in host.refused(slave.enterInitializationMode, None, 1.0, 0.0)
    slave.enterInitializationMode()
    assert "phase initialization" in host.refused(slave.enterInitializationMode)
    slave.exitInitializationMode()
    assert "phase step" in host.refused(slave.enterEventMode)
    assert "phase step" in host.refused(slave.enterStepMode)
    assert "the step starts" in host.refused(slave.doStep, 5.0, 0.1)
    slave.doStep(0.0, 0.1)
    slave.terminate()
    assert "phase terminated" in host.refused(slave.doStep, 0.1, 0.1)
    slave.reset()
    model = host.started(FMU3Model)
    assert "phase event" in host.refused(model.setContinuousStates, (c_double * 3)(), 3)
    model.updateDiscreteStates()
    model.enterContinuousTimeMode()
    assert "phase continuous-time" in host.refused(model.enterContinuousTimeMode)
    for call, expected in (
        (model.fmi3GetNumberOfContinuousStates, 3),
        (model.fmi3GetNumberOfEventIndicators, 0),
    ):
        count = c_size_t(99)
        call(model.component, byref(count))
        assert count.value == expected


def test_missing_features_are_refused(host: Host) -> None:
    slave = host.started()
    for call, word in (
        (slave.fmi3EnterConfigurationMode, "structural parameters"),
        (slave.fmi3EvaluateDiscreteStates, "discrete states"),
    ):
        assert word in host.refused(call, slave.component)
    assert "clocks" in host.refused(slave.getClock, [0])
    wrong: dict[str, dict[str, Any]] = {"event mode": {"eventModeUsed": True}, "token": {"token": "{other}"}}
    for word, options in wrong.items():
        with pytest.raises(Exception, match="instantiate"):
            host.new(**options)
        assert word in host.lines[-1][1]


def test_step_to_infinity_is_discarded(host: Host) -> None:
    """With the status for it; that it is undone, test_steps.py shows."""
    slave = host.started()
    slave.setFloat64([FORCE], [1e308])
    assert "discarded" in host.refused(slave.doStep, 0.0, 10.0, status=DISCARD)
    slave.setFloat64([FORCE], [0.0])
    assert slave.doStep(0.0, 1e-3)[1:] == (False, False, 1e-3)


def test_python_and_other_versions_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(BuildError, match=r"PythonFMU builds FMUs for FMI 2\.0 only"):
        build(Toy, tmp_path / "Toy.fmu", flavour="python", fmi=3)
    with pytest.raises(BuildError, match="FMI 1 is not supported"):
        build(Toy, tmp_path / "Toy.fmu", fmi=1)
    with pytest.raises(CommandError, match="PythonFMU"):
        build_model("Reference", "python", [], tmp_path, fmi=3)
    with pytest.raises(CommandError, match=r"'fmus' is for FMUs for FMI 2\.0"):
        build_model("Reference", "native", [], fmi=3)
    block = f"{files('tests.support')}/toy.py:Toy"
    assert main(["build", block, "--fmi", "3", "--flavour", "python", "--output", str(tmp_path)]) == 2
    assert "PythonFMU" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


CHECKED = (
    "DoStep",
    "GetFloat64",
    "SetFloat64",
    "GetAdjointDerivative",
    "SetFMUState",
    "GetFloat64WithinStep",
)


@needs_cc
@pytest.mark.slow
def test_random_calls_do_not_crash_the_fmu(host: Host, tmp_path: Path) -> None:
    counts = call_at_random(host, tmp_path, 20_000, TIME + 1, 0, X, POWER)
    for function in CHECKED:
        assert counts[function][0] > 0 and counts[function][ERROR] > 0, function
