"""Fixtures that many tests share."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

from emla_cosim.models import MODELS, build

# a slow machine is no failure; CI tries the same examples every time, people new ones
settings.register_profile("here", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "here")


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
