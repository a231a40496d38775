"""A package that carries data runs in libcosim and in Ecos as in `emla run`, bit for bit."""

from pathlib import Path

import numpy as np
import pytest
from ecospy import EcosLib, EcosSimulation
from libcosimpy.CosimEnums import CosimVariableType
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from libcosimpy.CosimObserver import CosimObserver

import emla_cosim as ec
from tests.support.joint_run import Array

STEP, STEPS = 1e-3, 500
SIGNALS = [
    ("input", "lift.disturbance.F_L"),
    ("lift.reference", "x_d"),
    ("lift.reference", "v_d"),
    ("lift.plant", "x_L"),
]


@pytest.fixture(scope="module")
def scenario(fmu_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> ec.Scenario:
    """The lift with a load and a reference from one file."""
    file = tmp_path_factory.mktemp("data") / "measured.csv"
    times = np.arange(0.0, 0.4, 0.007)
    rows = (f"{t!r},{240 + 5 * np.sin(9 * t)!r},{3 + np.cos(40 * t)!r}" for t in times.tolist())
    file.write_text("t,x [mm],F [kN]\n" + "\n".join(rows).replace("np.float64(", "").replace(")", ""))
    signals = {
        "lift.disturbance.F_L": "F",
        "lift.reference.x_d": "x",
        "lift.reference.v_d": "der(x)",
        "lift.reference.a_d": "der(der(x))",
    }
    source = {"file": file, "signals": signals, "interpolation": "cubic", "end": "repeat"}
    return ec.load("lift", input=[source], fmus=fmu_folder, step_size=STEP, stop_time=STEP * STEPS)


@pytest.fixture(scope="module")
def ours(scenario: ec.Scenario) -> Array:
    with scenario.prepare(algorithm="jacobi", output_interval=STEP) as simulation:
        result = simulation.run()
    return np.array([result[f"{component}.{name}"] for component, name in SIGNALS]).T


@pytest.fixture(scope="module")
def package(scenario: ec.Scenario, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return scenario.export(tmp_path_factory.mktemp("package") / "lift.ssp")


def test_libcosim_reads_the_same_data(package: Path, ours: Array) -> None:
    log_output_level(CosimLogLevel.ERROR)
    execution, observer = CosimExecution.from_ssp_file(str(package)), CosimObserver.create_time_series()
    assert execution.add_observer(observer)
    places = []
    for component, name in SIGNALS:
        index = execution.slave_index_from_instance_name(component.replace(".", "_"))
        references = {v.name.decode(): v.reference for v in execution.slave_variables(index)}
        places.append((index, references[name]))
        assert observer.start_time_series(*places[-1], CosimVariableType.REAL)
    assert execution.step(STEPS + 1)  # one step more, because libcosimpy drops the last sample
    for place, expected in zip(places, ours.T, strict=True):
        _, _, values = observer.time_series_real_samples(*place, 0, STEPS + 2)
        np.testing.assert_array_equal(values, expected)


def test_ecos_reads_the_same_data(package: Path, ours: Array) -> None:
    EcosLib.set_log_level("err")
    with EcosSimulation(STEP, ssp_path=str(package)) as simulation:
        assert simulation.init(parameter_set="initialValues")
        for k in range(STEPS + 1):
            if k > 0:
                simulation.step()
            found = [simulation.get_real(f"{c.replace('.', '_')}::{n}") for c, n in SIGNALS]
            assert found == ours[k].tolist()
        simulation.terminate()
