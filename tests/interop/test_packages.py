"""libcosim and Ecos run exported packages (SSP) and systems as one FMU, with the bits of `emla run`."""

import zipfile
from collections.abc import Callable
from pathlib import Path

import fmpy
import numpy as np
import pytest
from ecospy import EcosSimulation, EcosSimulationStructure
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimSlave import CosimLocalSlave
from lxml import etree

import emla_cosim as ec
from emla_cosim.fmu.models import build
from emla_cosim.study.loading import load
from tests.support.hand_written_fmus import build_event_fmu
from tests.support.joint_run import Array
from tests.support.package_hosts import Signal, ecos_run, libcosim_run, observed, stepped

pytestmark = pytest.mark.slow

STEP, STEPS = 1e-4, 500
NAMESPACES = {
    "ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
    "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
    "oms": "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd",
    "osp": "http://opensimulationplatform.com/SSP/OSPAnnotations",
}


def our_run(scenario: ec.Scenario, signals: list[Signal], step: float) -> Array:
    with scenario.prepare(algorithm="jacobi", output_interval=step) as simulation:
        result = simulation.run()
    return np.array([result[f"{component}.{name}"] for component, name in signals]).T


Case = tuple[Path, list[Signal], float, int, Array]


def study(fmus: Path, folder: Path) -> Case:
    """All 57 connected signals of the study; our values come from a run of the package."""
    package = load("study", fmus=fmus).export(folder / "study.ssp")
    scenario = load(str(package), step_size=STEP, stop_time=STEP * STEPS)
    signals = list(dict.fromkeys((x.source, x.output) for x in load("study").system.connections))
    assert len(signals) == 57
    return package, signals, STEP, STEPS, our_run(scenario, signals, STEP)


def data(fmus: Path, folder: Path) -> Case:
    """The lift with a load and a reference from one file, which the package carries."""
    file = folder / "measured.csv"
    times = np.arange(0.0, 0.4, 0.007).tolist()
    rows = [f"{t!r},{float(240 + 5 * np.sin(9 * t))!r},{float(3 + np.cos(40 * t))!r}" for t in times]
    file.write_text("\n".join(["t,x [mm],F [kN]", *rows, ""]))
    columns = {
        "lift.disturbance.F_L": "F",
        "lift.reference.x_d": "x",
        "lift.reference.v_d": "der(x)",
        "lift.reference.a_d": "der(der(x))",
    }
    source = {"file": file, "signals": columns, "interpolation": "cubic", "end": "repeat"}
    step, count = 1e-3, 500
    scenario = load("lift", input=[source], fmus=fmus, step_size=step, stop_time=step * count)
    signals = [("input", "lift.disturbance.F_L"), ("lift.reference", "x_d"), ("lift.reference", "v_d")]
    signals.append(("lift.plant", "x_L"))
    return scenario.export(folder / "lift.ssp"), signals, step, count, our_run(scenario, signals, step)


@pytest.fixture(scope="module", params=[study, data], ids=["study", "data"])
def case(request: pytest.FixtureRequest, fmu_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Case:
    return request.param(fmu_folder, tmp_path_factory.mktemp("package"))


@pytest.mark.parametrize("host", [libcosim_run, ecos_run], ids=["libcosim", "Ecos"])
def test_package_has_the_values_of_our_run(
    host: Callable[..., Array], case: Case, capfd: pytest.CaptureFixture[str]
) -> None:
    *arguments, expected = case
    values = host(*arguments)
    assert values.shape == expected.shape and np.isfinite(expected).all()
    allowed = 1e-12 * np.abs(expected).max(axis=0)
    if arguments[1][0][0] == "input":  # which these tools hold over a step
        allowed[-1] = 5e-3 * np.abs(expected[:, -1]).max()
    assert (np.abs(values - expected).max(axis=0) <= allowed).all()
    lines = "".join(capfd.readouterr()).splitlines()
    assert [line for line in lines if "FMI status" not in line] == [], "no warnings of the host"


def test_ecos_runs_packages_with_fmus_of_fmi_3(fmu_folder: Path, tmp_path: Path) -> None:
    """Of components without arrays: Ecos knows only scalars."""
    names = {"lift.plant": "EmlaPlant", "lift.observer": "EmlaObserver"}
    newer = {name: build(model, "native", [], tmp_path, fmi=3) for name, model in names.items()}
    times = {"step_size": STEP, "stop_time": 300 * STEP}
    scenario = load("lift", fmus=fmu_folder, replace=newer, **times)
    signals = [("lift.plant", "x_L"), ("lift.observer", "x_hat"), ("lift.controller", "u_q")]
    values = ecos_run(scenario.export(tmp_path / "lift.ssp"), signals, STEP, 300)
    np.testing.assert_array_equal(values, our_run(load("lift", fmus=fmu_folder, **times), signals, STEP))


def test_package_has_the_step_size_for_each_tool(fmu_folder: Path, tmp_path: Path) -> None:
    """In the places where OMSimulator and libcosim look for it."""
    with zipfile.ZipFile(load("lift", fmus=fmu_folder).export(tmp_path / "lift.ssp")) as archive:
        root = etree.fromstring(archive.read("SystemStructure.ssd"))

    def attributes(path: str) -> dict[str, str]:
        (element,) = root.xpath(path, namespaces=NAMESPACES)
        return dict(element.attrib)

    openmodelica = "ssd:System/ssd:Annotations/ssc:Annotation[@type='org.openmodelica']"
    master = f"{openmodelica}/oms:Annotations/oms:SimulationInformation/oms:FixedStepMaster"
    assert attributes(master) == {
        "description": "oms-ma",
        "stepSize": "0.0001",
        "absoluteTolerance": "1e-4",
        "relativeTolerance": "1e-4",
    }
    platform = "ssd:DefaultExperiment/ssd:Annotations/ssc:Annotation[@type='com.opensimulationplatform']"
    assert attributes(f"{platform}/osp:Algorithm/osp:FixedStepAlgorithm") == {"baseStepSize": "0.0001"}


def test_package_of_the_manipulator_loads(fmu_folder: Path, tmp_path: Path) -> None:
    """Its connections are between elements of arrays. Both hosts pass forces on a step late, and diverge."""
    package = load("hdrm-coupled", fmus=fmu_folder).export(tmp_path / "machine.ssp")
    execution = CosimExecution.from_ssp_file(str(package))
    names = {component.name.replace(".", "_") for component in load("hdrm-coupled").system.components}
    assert {info.name.decode() for info in execution.slave_infos()} == names
    assert execution.step(10)
    with EcosSimulation(1e-4, ssp_path=str(package)) as simulation:
        assert simulation.init(parameter_set="initialValues")
        positions = stepped(simulation, ["telescope_plant::x_L"], 10)
    assert np.ptp(positions) > 0.0


# ---- a system as one FMU ------------------------------------------------------------------------

JOINT = ["lift.plant.x_L", "lift.plant.i_q", "lift.controller.u_q"]


def build_system(name: str, fmus: Path, folder: Path) -> tuple[ec.Scenario, list[str]]:
    """Return a system with events or clocks, or a scenario, and some outputs."""
    if name not in ("events", "clocks"):
        return load(name, stop_time=0.02, output_interval=1e-3, fmus=fmus), JOINT
    clocks = ("periodic", "countdown") if name == "clocks" else (None, None)
    parts = {
        c: build_event_fmu(folder / f"{c}.fmu", clock=clock) for c, clock in zip("ab", clocks, strict=True)
    }
    values = {"a.period": 0.21, "a.threshold": 0.17, "b.threshold": 0.135}
    system = ec.System.of(parts, ["a.x -> b.w" if name == "clocks" else "a.count -> b.n"], values)
    outputs = ["a.x", "b.x", "b.sum"] if name == "clocks" else ["a.x", "b.x"]
    return load(system, stop_time=0.6, step_size=1e-3, output_interval=1e-3), outputs


def host_run(host: str, fmu: Path, outputs: list[str], count: int) -> Array:
    """Run one FMU in steps of 1 ms."""
    step = 1e-3
    if host == "FMPy":
        times = {"stop_time": count * step, "step_size": step, "output_interval": step}
        rows = fmpy.simulate_fmu(str(fmu), output=outputs, **times)
        return np.array([rows[name] for name in outputs]).T
    if host == "libcosim":
        variables = {v.name: v.valueReference for v in fmpy.read_model_description(str(fmu)).modelVariables}
        execution = CosimExecution.from_step_size(round(step * 1e9))
        index = execution.add_local_slave(CosimLocalSlave(str(fmu), "system"))
        return observed(execution, [(index, variables[n]) for n in outputs], step, count)
    with EcosSimulationStructure() as structure:
        structure.add_model("system", fmu)
        with EcosSimulation(step, structure=structure) as simulation:
            assert simulation.init()
            return stepped(simulation, [f"system::{n}" for n in outputs], count)


@pytest.mark.parametrize("name", ["lift", "study-drive", "hdrm-coupled", "events", "clocks"])
def test_system_as_one_fmu_has_the_bits_of_our_run(name: str, fmu_folder: Path, tmp_path: Path) -> None:
    """The hosts have no rollback and no event mode: loops, events and ticks are handled inside of the FMU."""
    scenario, outputs = build_system(name, fmu_folder, tmp_path)
    with scenario.prepare() as simulation:
        run = simulation.run()
    expected = np.array([run[n] for n in outputs]).T
    assert np.ptp(expected, axis=0).all()
    for fmi, hosts in ((2, ("FMPy", "libcosim", "Ecos")), (3, ("FMPy", "Ecos"))):  # libcosim has no FMI 3.0
        fmu = scenario.export(tmp_path / f"system{fmi}.fmu", outputs=outputs, fmi=fmi)
        for host in hosts:
            np.testing.assert_array_equal(host_run(host, fmu, outputs, len(expected) - 1), expected, host)
