"""The package that `emla export study` writes runs in libcosim and in Ecos, unchanged, as in `emla run`."""

import zipfile
from pathlib import Path

import numpy as np
import pytest
from ecospy import EcosLib, EcosSimulation
from libcosimpy.CosimEnums import CosimVariableType
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from libcosimpy.CosimObserver import CosimObserver
from lxml import etree
from typer.testing import CliRunner

from emla_cosim.cli.app import app
from emla_cosim.recorders.csv_file import read_csv
from emla_cosim.study.loading import load
from tests.support.joint_run import Array

TOLERANCE = 1e-12
"""Per largest value of a signal; rounding of a single number is 1e-16."""

STEP, STEPS = 1e-4, 2000
"""The file's own step size, and 0.2 s of it."""

SYSTEM = load("study").system
Signal = tuple[str, str]
"""Component and output."""

SIGNALS: list[Signal] = list(dict.fromkeys((x.source, x.output) for x in SYSTEM.connections))
"""Every connected signal."""

NAMESPACES = {
    "ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
    "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
    "oms": "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd",
    "osp": "http://opensimulationplatform.com/SSP/OSPAnnotations",
}


def element(component: str) -> str:
    """What a component is called in the package."""
    return component.replace(".", "_")


@pytest.fixture(scope="module")
def package(fmu_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The study as a package, by the command that users have."""
    path = tmp_path_factory.mktemp("package") / "study.ssp"
    result = CliRunner().invoke(app, ["export", "study", str(path), "--fmus", str(fmu_folder)])
    assert result.exit_code == 0, result.output
    return path


# ---- runs: a column per signal, a row per communication point, the initial one included --------------


def our_run(package: Path, folder: Path, step: float, count: int) -> Array:
    options = {
        "--algorithm": "jacobi",
        "--step-size": repr(step),
        "--stop-time": repr(step * count),
        "--output-interval": repr(step),
        "--output": str(folder),
    }
    result = CliRunner().invoke(
        app, ["run", str(package), "--no-plots", *(x for pair in options.items() for x in pair)]
    )
    assert result.exit_code == 0, result.output
    names = [f"{component}.{output}" for component, output in SIGNALS]
    return np.array(list(read_csv(folder / "results.csv", names).values())).T


def libcosim_run(package: Path, count: int) -> Array:
    execution, observer = CosimExecution.from_ssp_file(str(package)), CosimObserver.create_time_series()
    assert execution.add_observer(observer)
    places = [_place(execution, *signal) for signal in SIGNALS]
    for place in places:
        assert observer.start_time_series(*place, CosimVariableType.REAL)
    # one step more, because libcosimpy drops the last sample
    assert execution.step(count + 1)
    columns = []
    for place in places:
        times, _, values = observer.time_series_real_samples(*place, 0, count + 2)
        assert times == [round(k * STEP * 1e9) for k in range(count + 1)]  # the step size of the file
        columns.append(values)
    return np.array(columns).T


def _place(execution: CosimExecution, component: str, output: str) -> tuple[int, int]:
    index = execution.slave_index_from_instance_name(element(component))
    references = {v.name.decode(): v.reference for v in execution.slave_variables(index)}
    return index, references[output]


def ecos_run(package: Path, step: float, count: int) -> Array:
    with EcosSimulation(step, ssp_path=str(package)) as simulation:
        assert simulation.init(parameter_set="initialValues")
        rows = []
        for k in range(count + 1):
            if k > 0:
                simulation.step()
            rows.append([simulation.get_real(f"{element(c)}::{output}") for c, output in SIGNALS])
        simulation.terminate()
    return np.array(rows)


def too_far(found: Array, expected: Array) -> dict[str, float]:
    """Signals that differ by more than the tolerance, and by how much."""
    assert found.shape == expected.shape
    largest = np.abs(expected).max(axis=0)
    assert np.isfinite(largest).all()
    relative = np.abs(found - expected).max(axis=0) / np.where(largest > 0.0, largest, 1.0)
    names = [f"{component}.{output}" for component, output in SIGNALS]
    return {name: float(r) for name, r in zip(names, relative, strict=True) if not r <= TOLERANCE}


def test_libcosim_does_what_we_do(package: Path, tmp_path: Path) -> None:
    log_output_level(CosimLogLevel.ERROR)
    assert len(SIGNALS) == 57
    found = libcosim_run(package, STEPS)
    assert too_far(found, our_run(package, tmp_path, STEP, STEPS)) == {}


def test_ecos_does_what_we_do(package: Path, tmp_path: Path) -> None:
    """It sums the steps up; the FMUs count them, so that the rounding of its times does not matter."""
    EcosLib.set_log_level("err")
    assert too_far(ecos_run(package, STEP, STEPS), our_run(package, tmp_path, STEP, STEPS)) == {}


# ---- what they complain of -------------------------------------------------------------------------


def test_libcosim_warns_of_nothing(package: Path, capfd: pytest.CaptureFixture[str]) -> None:
    log_output_level(CosimLogLevel.WARNING)
    CosimExecution.from_ssp_file(str(package)).step(1)
    log_output_level(CosimLogLevel.ERROR)
    assert "".join(capfd.readouterr()) == ""


def test_ecos_warns_of_nothing(package: Path, capfd: pytest.CaptureFixture[str]) -> None:
    EcosLib.set_log_level("warn")
    ecos_run(package, STEP, 1)
    EcosLib.set_log_level("err")
    assert "".join(capfd.readouterr()) == ""


# ---- what the package tells them -------------------------------------------------------------------


def test_the_package_tells_each_tool_its_step_size(package: Path) -> None:
    """In the places where OMSimulator and libcosim look for it."""
    with zipfile.ZipFile(package) as archive:
        root = etree.fromstring(archive.read("SystemStructure.ssd"))

    def only(path: str) -> etree._Element:
        (found,) = root.xpath(path, namespaces=NAMESPACES)
        return found

    openmodelica = "ssd:System/ssd:Annotations/ssc:Annotation[@type='org.openmodelica']"
    master = only(f"{openmodelica}/oms:Annotations/oms:SimulationInformation/oms:FixedStepMaster")
    assert dict(master.attrib) == {
        "description": "oms-ma",
        "stepSize": "0.0001",
        "absoluteTolerance": "1e-4",
        "relativeTolerance": "1e-4",
    }
    platform = "ssd:DefaultExperiment/ssd:Annotations/ssc:Annotation[@type='com.opensimulationplatform']"
    algorithm = only(f"{platform}/osp:Algorithm/osp:FixedStepAlgorithm")
    assert dict(algorithm.attrib) == {"baseStepSize": "0.0001"}
