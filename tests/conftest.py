"""Fixtures that many tests share."""

from pathlib import Path

import pytest

from emla_cosim.models import MODELS, build


@pytest.fixture(scope="session")
def fmu_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the native FMUs of all models."""
    folder = tmp_path_factory.mktemp("fmus")
    for model in MODELS:
        build(model, "native", [], folder)
    return folder


@pytest.fixture(scope="session")
def python_fmu_folder(fmu_folder: Path) -> Path:
    """The same folder with the PythonFMU FMUs as well."""
    for model in MODELS:
        build(model, "python", [], fmu_folder)
    return fmu_folder
