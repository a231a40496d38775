"""FMPy runs every FMU alone, and the joint in the loop that anyone would write with it."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import extract, read_model_description, simulate_fmu
from fmpy.fmi2 import FMU2Slave, fmi2Error
from fmpy.validation import validate_fmu

from emla_cosim.fmu.log import FmuLog
from emla_cosim.fmu.models import FLAVOURS, MODELS, fmu_path
from tests.support.joint_run import Array, Case, differences, our_run


def naive_run(case: Case, folder: Path, log: FmuLog) -> Array:
    """Jacobi by hand, one variable at a time."""
    slaves: dict[str, FMU2Slave] = {}
    references = {}
    for c in case.system.components:
        path = str(case.fmus[c.name])
        description = read_model_description(path)
        slaves[c.name] = slave = FMU2Slave(
            guid=description.guid,
            unzipDirectory=extract(path, folder / c.name),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName=c.name,
        )
        slave.instantiate(callbacks=log.callbacks, loggingOn=True)
        references[c.name] = {v.name: [v.valueReference] for v in description.modelVariables}
        setters = {"Real": slave.setReal, "Integer": slave.setInteger, "Boolean": slave.setBoolean}
        types = {v.name: v.type for v in description.modelVariables}
        for name, value in c.parameters.items():
            setters[types[name]](references[c.name][name], [value])
        slave.setupExperiment(startTime=0.0)
        slave.enterInitializationMode()

    def exchange() -> None:
        for x in case.system.connections:
            value = slaves[x.source].getReal(references[x.source][x.output])
            slaves[x.target].setReal(references[x.target][x.input], value)

    def row() -> list[float]:
        return [slaves[c].getReal(references[c][output])[0] for c, output in case.signals]

    for _ in slaves:
        exchange()
    for slave in slaves.values():
        slave.exitInitializationMode()
    rows = [row()]
    for k in range(case.steps):
        exchange()
        for slave in slaves.values():
            slave.doStep(k * case.step, case.step)
        rows.append(row())
    for slave in slaves.values():
        slave.terminate()
        slave.freeInstance()
    return np.array(rows)


def test_naive_loop_is_bit_for_bit_our_master(case: Case, tmp_path: Path) -> None:
    log = FmuLog()
    found = naive_run(case, tmp_path, log)
    assert differences(case, found, our_run(case, "jacobi")) == {}
    assert {name: log.last(name) for name in case.fmus if log.last(name)} == {}


@pytest.mark.parametrize("flavour", FLAVOURS)
@pytest.mark.parametrize("model", MODELS)
def test_every_model_runs_with_its_own_defaults(model: str, flavour: str, python_fmu_folder: Path) -> None:
    errors = []

    def logger(environment: Any, instance: bytes, status: int, category: bytes, message: bytes) -> None:
        if status >= fmi2Error:
            errors.append(message)

    path = fmu_path(model, flavour, python_fmu_folder)
    found = simulate_fmu(str(path), logger=logger, debug_logging=True)
    description = read_model_description(str(path))
    assert found["time"][-1] == pytest.approx(float(description.defaultExperiment.stopTime))
    outputs = {v.name for v in description.modelVariables if v.causality == "output"}
    assert outputs == set(found.dtype.names) - {"time"}
    assert all(np.isfinite(found[name]).all() for name in outputs)
    assert errors == []


@pytest.mark.parametrize("flavour", FLAVOURS)
@pytest.mark.parametrize("model", MODELS)
def test_validation_reports_nothing(model: str, flavour: str, python_fmu_folder: Path) -> None:
    assert validate_fmu(str(fmu_path(model, flavour, python_fmu_folder))) == []


def test_fmpys_own_logging_survives_our_master(fmu_folder: Path) -> None:
    """FMPy's proxy keeps the last logger it was given: ours must outlive the run, in a process of its own."""
    path = fmu_path("EmlaPlant", "native", fmu_folder)
    code = (
        "from fmpy import extract, read_model_description\n"
        "from fmpy.fmi2 import FMU2Slave\n"
        "import gc\n"
        "from emla_cosim.fmu.log import FmuLog\n"
        "FmuLog(); gc.collect()\n"
        f"folder = extract({str(path)!r}); guid = read_model_description(folder).guid\n"
        f"slave = FMU2Slave(guid=guid, unzipDirectory=folder, modelIdentifier='EmlaPlant')\n"
        "slave.instantiate(loggingOn=True)\n"
        "try:\n"
        "    slave.doStep(0.0, 0.1)\n"
        "except Exception as error:\n"
        "    print(error)\n"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert "fmi2DoStep failed" in run.stdout
