"""What other masters make of `emla export hdrm-coupled`: they load it, and have no strong coupling."""

from pathlib import Path

import numpy as np
import pytest
from ecospy import EcosLib, EcosSimulation
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
from typer.testing import CliRunner

from emla_cosim.cli.app import app
from emla_cosim.study.loading import load

SYSTEM = load("hdrm-coupled").system
NAMES = {component.name.replace(".", "_") for component in SYSTEM.components}


@pytest.fixture(scope="module")
def package(fmu_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("package") / "machine.ssp"
    result = CliRunner().invoke(app, ["export", "hdrm-coupled", str(path), "--fmus", str(fmu_folder)])
    assert result.exit_code == 0, result.output
    return path


def test_the_package_is_the_scenario(package: Path) -> None:
    """By our own reader: the same components, values and connections."""
    read = load(str(package)).system
    assert [c.name for c in read.components] == [c.name for c in SYSTEM.components]
    assert {str(x) for x in read.connections} == {str(x) for x in SYSTEM.connections}
    knots = read.component("machine.trajectory").parameters
    assert knots["knot[30]"] == SYSTEM.component("machine.trajectory").parameters["knot[30]"] == 37.7


def test_libcosim_loads_it_and_diverges(package: Path) -> None:
    log_output_level(CosimLogLevel.FATAL)
    execution = CosimExecution.from_ssp_file(str(package))
    assert {info.name.decode() for info in execution.slave_infos()} == NAMES
    done = 0
    while done < 200 and execution.step(1):
        done += 1
    log_output_level(CosimLogLevel.ERROR)
    assert 10 < done < 100  # it passes the forces on a step late


def test_ecos_loads_it_and_goes_on_without_what_diverged(package: Path) -> None:
    EcosLib.set_log_level("off")
    positions = []
    with EcosSimulation(1e-4, ssp_path=str(package)) as simulation:
        assert simulation.init(parameter_set="initialValues")
        for _ in range(200):
            simulation.step()
            positions.append(simulation.get_real("telescope_plant::x_L"))
    EcosLib.set_log_level("err")
    swings = np.abs(np.diff(positions))
    assert swings[:10].max() < 0.05 * swings.max()
    assert len(set(positions[-100:])) == 1  # its FMU has refused to go on
