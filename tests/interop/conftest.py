"""The joint in the variants that every tool runs; the FMUs unpacked, and our C programs compiled, once."""

import ctypes
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import pytest
from filelock import FileLock

from emla_cosim.fmu.file import FmuFile, open_fmu
from emla_cosim.fmu.log import FmuLog
from emla_cosim.fmu.models import MODELS, fmu_path
from tests.support.c_programs import Build, build
from tests.support.joint_run import STEP, Case, build_study_joint, moving_joint
from tests.support.tiers import mostly_slow

Compile = Callable[..., Build]

VARIANTS = {
    "study-native": (build_study_joint, "native", 500),
    "study-python": (build_study_joint, "python", 100),
    "moving-native": (moving_joint, "native", 300),
}
"""Joint, flavour and number of steps; the python FMUs run in the test's own process."""

if sys.platform == "linux":
    # Ecos needs this library and does not find it in the package tbb by itself
    ctypes.CDLL(str(Path(sys.prefix, "lib", "libtbb.so.12")), ctypes.RTLD_GLOBAL)
else:  # for which libcosim and Ecos have no packages
    collect_ignore = ["test_packages.py"]


@pytest.fixture(params=mostly_slow(VARIANTS, ["moving-native"]))
def case(request: pytest.FixtureRequest) -> Case:
    """Return each variant of the joint in turn."""
    joint, flavour, steps = VARIANTS[request.param]
    folder = request.getfixturevalue("fmu_folder" if flavour == "native" else "python_fmu_folder")
    return Case(joint(), folder, flavour, steps, STEP)


@pytest.fixture(autouse=True)
def living_logger() -> Iterator[None]:
    """FMPy's proxy keeps calling the logger of a test, so afterwards it gets one that stays."""
    yield
    FmuLog()


@pytest.fixture(scope="session")
def unpacked_fmus(fmu_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, FmuFile]:
    """The native FMUs of all models as built for release, by model."""
    folder = tmp_path_factory.mktemp("unpacked")
    return {m: open_fmu(fmu_path(m, "native", fmu_folder), folder / m) for m in MODELS}


@pytest.fixture(scope="session")
def compiled(unpacked_fmus: dict[str, FmuFile], tmp_path_factory: pytest.TempPathFactory) -> Compile:
    """Return a function that compiles our C programs and FMUs with a sanitizer, once per run."""
    base = tmp_path_factory.getbasetemp()
    shared = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base

    def call(sanitizer: str, program: str, models: Iterable[str] = ()) -> Build:
        folder = shared / sanitizer
        folder.mkdir(exist_ok=True)
        with FileLock(f"{folder}.lock"):
            return build(sanitizer, [program], [unpacked_fmus[model] for model in models], folder)

    return call
