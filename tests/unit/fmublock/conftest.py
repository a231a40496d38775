"""The toy block as FMUs of both flavours, and units of any block."""

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import pytest

from tests.support.fmi3_host import Host
from tests.support.sessions import Session, opened
from tests.support.toy import Toy
from tests.support.toy_fmu import build_toy, copy_toy
from tests.support.units import KINDS, Make, Units


@pytest.fixture(scope="session")
def native_toy_fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The toy as a native FMU."""
    return copy_toy(tmp_path_factory.mktemp("native") / "Toy.fmu")


@pytest.fixture(scope="session")
def python_toy_fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The toy as a PythonFMU FMU."""
    return build_toy("python", tmp_path_factory.mktemp("python") / "Toy.fmu")


@pytest.fixture(scope="session")
def fmi3_toy_fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The toy as a native FMU for FMI 3.0."""
    return copy_toy(tmp_path_factory.mktemp("fmi3") / "Toy.fmu", fmi=3)


@pytest.fixture(scope="session", params=["native", "python", "fmi3"])
def toy_fmu(request: pytest.FixtureRequest) -> Path:
    """The toy as an FMU, once per flavour and FMI version."""
    return request.getfixturevalue(f"{request.param}_toy_fmu")


@pytest.fixture
def session(native_toy_fmu: Path, tmp_path: Path) -> Iterator[Session]:
    """The native toy, open for instances."""
    with opened(native_toy_fmu, tmp_path / "native toy") as session:
        yield session


@pytest.fixture(params=["native", "python"])
def either(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Session]:
    """The toy of either flavour, open for instances."""
    with opened(request.getfixturevalue(f"{request.param}_toy_fmu"), tmp_path / "toy") as session:
        yield session


@pytest.fixture
def host(fmi3_toy_fmu: Path, tmp_path: Path) -> Iterator[Host]:
    """The toy for FMI 3.0, open for instances."""
    host = Host(fmi3_toy_fmu, tmp_path / "toy for FMI 3.0")
    yield host
    host.close()


@pytest.fixture(scope="session")
def units(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Units]:
    """Instances of blocks of any kind."""
    units = Units(tmp_path_factory.mktemp("units"))
    yield units
    units.close()


@pytest.fixture(params=KINDS)
def make(request: pytest.FixtureRequest, units: Units) -> Make:
    """Make instances of the toy: in process, native, python and for FMI 3.0."""
    return partial(units.make, Toy, request.param)
