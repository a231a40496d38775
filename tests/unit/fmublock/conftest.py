"""FMUs of the toy block in both flavours."""

from pathlib import Path

import pytest

from tests.support.toy_fmu import build_toy


@pytest.fixture(scope="session")
def native_toy_fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The toy as a native FMU."""
    return build_toy("native", tmp_path_factory.mktemp("native") / "Toy.fmu")


@pytest.fixture(scope="session")
def python_toy_fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The toy as a PythonFMU FMU."""
    return build_toy("python", tmp_path_factory.mktemp("python") / "Toy.fmu")


@pytest.fixture(scope="session", params=["native", "python"])
def toy_fmu(request: pytest.FixtureRequest) -> Path:
    """The toy as an FMU, once per flavour."""
    return request.getfixturevalue(f"{request.param}_toy_fmu")
