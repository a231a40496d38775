"""The FMUs unpacked, and everything compiled, once."""

from pathlib import Path

import pytest

from emla_cosim.master.fmu_file import FmuFile, open_fmu
from emla_cosim.models import MODELS, fmu_path
from interop.c_programs import Build, build


@pytest.fixture(scope="session")
def unpacked_fmus(fmu_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, FmuFile]:
    """The native FMUs of all models as built for release, by model."""
    folder = tmp_path_factory.mktemp("unpacked")
    return {m: open_fmu(fmu_path(m, "native", fmu_folder), folder / m) for m in MODELS}


@pytest.fixture(scope="session")
def plain_host(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """host.c without instrumentation."""
    return build("none", ["host"], [], tmp_path_factory.mktemp("plain")).programs["host"]


@pytest.fixture(scope="session")
def address_build(unpacked_fmus: dict[str, FmuFile], tmp_path_factory: pytest.TempPathFactory) -> Build:
    """Everything with AddressSanitizer, LeakSanitizer and UndefinedBehaviorSanitizer."""
    folder = tmp_path_factory.mktemp("address")
    return build("address", ["host", "fuzz"], unpacked_fmus.values(), folder)


@pytest.fixture(scope="session")
def thread_build(unpacked_fmus: dict[str, FmuFile], tmp_path_factory: pytest.TempPathFactory) -> Build:
    """The host and the FMUs with ThreadSanitizer."""
    return build("thread", ["host"], unpacked_fmus.values(), tmp_path_factory.mktemp("thread"))
