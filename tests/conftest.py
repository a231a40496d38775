"""Fixtures that many tests share."""

import gc
import os
import time
from collections.abc import Collection, Iterator
from contextlib import ExitStack, chdir, nullcontext
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from hypothesis import settings

from emla_cosim.fmu.models import MODELS, build, fmu_path
from fmublock.cache import VARIABLE
from tests.support.deterministic import draw_no_constants_of_modules, heed_ctrl_c, register_profiles
from tests.support.faulty_fmu import build_faulty_fmu
from tests.support.handwritten_fmu import build_handwritten_fmu
from tests.support.long import MARK, heed
from tests.support.memory_disk import use_memory_disk
from tests.support.paths import FOREIGN_PLANT, ROOT
from tests.support.sessions import Session, opened
from tests.support.toy_fmu import build_toy

if TYPE_CHECKING:  # these take a while to load
    from distributed import Client

    from emla_cosim.sweeps.local_cluster import ClusterAddress

use_memory_disk()

# of what tests and the processes that they start build and compile: not the user's, and kept for the next run
os.environ.setdefault(VARIABLE, str(ROOT / ".pytest_cache" / "emla-cosim"))

register_profiles()
heed_ctrl_c()

# readline sets these in the processes of pytest-xdist, and rich would keep the width for good
for size in ("COLUMNS", "LINES"):
    os.environ.pop(size, None)


ON_ONE_CLUSTER = (
    "test_pages.py",
    "test_sweeping.py",
    "test_plans.py",
    "sweep/test_verdicts.py",
    "test_sobol_indices.py",
    "test_compare.py",
    "test_fair_comparison.py",
    "test_tune.py",
    "test_notes.py",
    "test_ownership.py",
    "test_machine_faults.py",
)
"""Files that one process of a test run does one after the other, with one cluster: to start it takes long."""

LONGEST = (
    *ON_ONE_CLUSTER,
    "test_cluster_faults.py",
    "test_broken_fmus.py",
    "test_any_command.py",
    "test_ended_processes.py",
    "test_verify_command.py",
    "test_surroundings.py",
    "test_names.py",
    "test_mutations.py",
    "test_pytest_plugin.py",
    "test_state_round_trips.py",
    "test_site.py",
    "test_workflow.py",
    "test_flavours.py",
    "test_cli.py",
    "test_checkpoints.py",
)
"""Files that begin first, the longest before all others, so that none is left over in the end."""


def is_one_of(path: str, files: Collection[str]) -> bool:
    """Return whether a path ends in one of these names."""
    return any(path.endswith(f"/{file}") for file in files)


def pytest_configure(config: pytest.Config) -> None:
    """Let properties draw as many examples as the selected tests are to have."""
    heed(config.option.markexpr)


def pytest_collection_finish() -> None:
    """Draw the same examples, unless the profile says otherwise; hypothesis has loaded it by now."""
    if settings.default.derandomize:
        draw_no_constants_of_modules()


@pytest.hookimpl(optionalhook=True)  # of pytest-xdist
def pytest_xdist_auto_num_workers() -> int:
    """One more than there are cores: a third of the time tests wait for processes to start and end."""
    known = hasattr(os, "sched_getaffinity")
    return 1 + (len(os.sched_getaffinity(0)) if known else os.cpu_count() or 1)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Give each file to one process, and all that share a cluster to the same."""
    from xdist.scheduler import LoadFileScheduling

    class Scheduling(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file = super()._split_scope(nodeid)
            return "cluster" if is_one_of(file, ON_ONE_CLUSTER) else file

    return Scheduling(config, log) if config.option.dist == "loadfile" else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the longest files first; pytest-xdist keeps the order."""

    def rank(item: pytest.Item) -> int:
        return next((i for i, x in enumerate(LONGEST) if is_one_of(item.path.as_posix(), [x])), len(LONGEST))

    items.sort(key=rank)


@pytest.hookimpl(tryfirst=True)  # before fixtures
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip long tests for which a slow machine has no time left."""
    if item.get_closest_marker(MARK) and time.time() > float(os.environ.get("EMLA_LONG_TESTS_END", "inf")):
        pytest.skip("The time for long tests is over (EMLA_LONG_TESTS_END).")


@pytest.fixture(scope="module", autouse=True)
def few_objects_to_look_at() -> None:
    """What is there before a file of tests begins stays: nobody looks for garbage in it again and again."""
    gc.collect()
    gc.freeze()


@pytest.fixture(autouse=True)
def stay_in_the_root() -> Iterator[None]:
    """A test that leaves this process in a folder that is removed then makes others fail."""
    os.chdir(ROOT)
    yield
    assert Path.cwd() == ROOT


def shared_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for what all processes of a test run have in common."""
    base = tmp_path_factory.getbasetemp()
    return base.parent if "PYTEST_XDIST_WORKER" in os.environ else base


@pytest.fixture(scope="session")
def fmu_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the native FMUs of all models, which all processes of a test run share."""
    folder = shared_folder(tmp_path_factory) / "fmus"
    number = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0")[2:])
    processes = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    models, first = list(MODELS), number * len(MODELS) // processes  # so that none waits for another
    for model in (*models[first:], *models[:first]):
        build(model, "native", [], folder)
    return folder


@pytest.fixture(scope="session")
def python_fmu_folder(fmu_folder: Path) -> Path:
    """The same folder with the PythonFMU FMUs as well."""
    for model in MODELS:
        build(model, "python", [], fmu_folder)
    return fmu_folder


@pytest.fixture(scope="session")
def machine() -> "Iterator[ClusterAddress]":
    """A local cluster of two workers; one that idles costs a twentieth of a core."""
    from emla_cosim.sweeps.local_cluster import local_cluster

    with ExitStack() as stack:
        with chdir(ROOT):  # it outlives the folders of tests
            place = stack.enter_context(local_cluster(2))
        yield place


@pytest.fixture(scope="module")
def cluster(machine: "ClusterAddress") -> "Iterator[Client]":
    """A client of that cluster, for sweeps that end none of its workers."""
    from distributed import Client

    with Client(machine.address, security=machine.security, set_as_default=False) as client:
        yield client


@pytest.fixture
def on_one_cluster(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Sweeps that would start a cluster go to that one: it takes 3 s, and sweep/ tests it often enough."""
    farm = import_module("emla_cosim.sweeps.executor")
    monkeypatch.setattr(farm, "local_cluster", lambda _: nullcontext(request.getfixturevalue("machine")))


@pytest.fixture(scope="session")
def faulty_fmu(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The faulty FMU, with states and interpolation of inputs."""
    return build_faulty_fmu(tmp_path_factory.mktemp("faulty"))


@pytest.fixture(scope="session")
def foreign_plant(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An FMU of the plant that somebody else wrote; foreign_plant/ForeignPlant.ssm maps our names to its."""
    path = tmp_path_factory.mktemp("foreign") / "ForeignPlant.fmu"
    return build_handwritten_fmu(path, FOREIGN_PLANT / "foreign_plant.c")


@pytest.fixture(scope="session")
def sessions(fmu_folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Session]]:
    """The native FMUs of all models and of the toy, each open for instances, by name."""
    folder = tmp_path_factory.mktemp("sessions")
    paths = {model: fmu_path(model, "native", fmu_folder) for model in MODELS}
    paths["Toy"] = build_toy("native", folder / "Toy.fmu")
    with ExitStack() as stack:
        yield {m: stack.enter_context(opened(path, folder / m)) for m, path in paths.items()}


@pytest.fixture
def toy(sessions: dict[str, Session]) -> Session:
    """The native toy with nothing in its log."""
    sessions["Toy"].log.all.clear()
    return sessions["Toy"]
