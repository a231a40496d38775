"""FMPy accepts and runs every FMU alone."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fmpy import read_model_description, simulate_fmu
from fmpy.fmi2 import fmi2Error
from fmpy.validation import validate_fmu

from emla_cosim.fmu.models import FLAVOURS, MODELS, fmu_path
from tests.support.processes import run
from tests.support.tiers import mostly_slow

COMBINATIONS = [(model, flavour) for model in MODELS for flavour in FLAVOURS]


@pytest.mark.parametrize(("model", "flavour"), mostly_slow(COMBINATIONS, [("Reference", "native")]))
def test_every_model_is_valid_and_runs_with_its_defaults(
    model: str, flavour: str, request: pytest.FixtureRequest
) -> None:
    folder = request.getfixturevalue("fmu_folder" if flavour == "native" else "python_fmu_folder")
    path = fmu_path(model, flavour, folder)
    assert validate_fmu(str(path)) == []
    errors = []

    def logger(environment: Any, instance: bytes, status: int, category: bytes, message: bytes) -> None:
        if status >= fmi2Error:
            errors.append(message)

    result = simulate_fmu(str(path), logger=logger, debug_logging=True)
    description = read_model_description(str(path))
    assert result["time"][-1] == pytest.approx(float(description.defaultExperiment.stopTime))
    outputs = {v.name for v in description.modelVariables if v.causality == "output"}
    assert outputs == set(result.dtype.names) - {"time"}
    assert all(np.isfinite(result[name]).all() for name in outputs)
    assert errors == []


@pytest.mark.slow
def test_logging_of_fmpy_works_after_our_master(fmu_folder: Path) -> None:
    """FMPy's proxy keeps the last logger it was given: ours must outlive the run."""
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
    process = run(sys.executable, "-c", code)
    assert process.returncode == 0, process.stderr
    assert "fmi2DoStep failed" in process.stdout
