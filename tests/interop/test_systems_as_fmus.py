"""Systems as one FMU in hosts without rollback: libcosim and Ecos get the bits of `emla run`."""

from pathlib import Path

import fmpy
import numpy as np
import pytest
from ecospy import EcosSimulation, EcosSimulationStructure
from libcosimpy.CosimEnums import CosimVariableType
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave

from emla_cosim.study.loading import load

SIGNALS = ["lift.plant.x_L", "lift.plant.i_q", "lift.controller.u_q"]
STEP, COUNT = 1e-3, 50

Case = tuple[Path, np.ndarray]


@pytest.fixture(scope="module", params=["lift", "hdrm-coupled"])
def case(request: pytest.FixtureRequest, fmu_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Case:
    """The FMU, and what a run has at each of its host's steps."""
    scenario = load(request.param, stop_time=STEP * COUNT, output_interval=STEP, fmus=fmu_folder)
    fmu = scenario.export(tmp_path_factory.mktemp("system") / "system.fmu", outputs=SIGNALS)
    with scenario.prepare() as simulation:
        run = simulation.run()
    return fmu, np.array([run[name] for name in SIGNALS]).T


@pytest.fixture
def newer(case: Case, fmu_folder: Path, tmp_path: Path, request: pytest.FixtureRequest) -> Case:
    """The same with an FMU for FMI 3.0."""
    scenario = load(request.node.callspec.params["case"], stop_time=STEP * COUNT, fmus=fmu_folder)
    return scenario.export(tmp_path / "newer.fmu", outputs=SIGNALS, fmi=3), case[1]


def references(fmu: Path) -> list[int]:
    variables = {v.name: v for v in fmpy.read_model_description(str(fmu)).modelVariables}
    return [variables[name].valueReference for name in SIGNALS]


def test_libcosim(case: Case) -> None:
    fmu, expected = case
    log_output_level(CosimLogLevel.ERROR)
    execution, observer = CosimExecution.from_step_size(round(STEP * 1e9)), CosimObserver.create_time_series()
    assert execution.add_observer(observer)
    index = execution.add_local_slave(CosimLocalSlave(str(fmu), "system"))
    for reference in references(fmu):
        assert observer.start_time_series(index, reference, CosimVariableType.REAL)
    assert execution.step(COUNT + 1)  # it drops the last sample
    columns = [observer.time_series_real_samples(index, r, 0, COUNT + 2)[2] for r in references(fmu)]
    np.testing.assert_array_equal(np.array(columns).T, expected)


@pytest.mark.parametrize("kind", ["case", pytest.param("newer", marks=pytest.mark.slow)])
def test_ecos(kind: str, case: Case, request: pytest.FixtureRequest) -> None:
    fmu, expected = request.getfixturevalue(kind)
    rows = []
    with EcosSimulationStructure() as structure:
        structure.add_model("system", fmu)
        with EcosSimulation(STEP, structure=structure) as simulation:
            assert simulation.init()
            for k in range(COUNT + 1):
                if k > 0:
                    simulation.step()
                rows.append([simulation.get_real(f"system::{name}") for name in SIGNALS])
            simulation.terminate()
    np.testing.assert_array_equal(np.array(rows), expected)
