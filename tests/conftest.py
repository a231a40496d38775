"""Fixtures that many tests share."""

import gc
import os
import sys
from collections.abc import Iterator
from contextlib import ExitStack, chdir
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from click.testing import CliRunner, Result
from hypothesis import settings

from emla_cosim.cli.app import app
from emla_cosim.fmu.models import MODELS, build, fmu_path
from fmublock.cache import VARIABLE
from fmublock.recipe import Recipe
from tests.support.commands import Emla, widen_terminal
from tests.support.deterministic import draw_no_constants_of_modules, heed_ctrl_c, register_profiles
from tests.support.few_figures import draw_empty
from tests.support.hand_written_fmus import build_faulty_fmu, build_handwritten_fmu
from tests.support.memory_disk import use_memory_disk
from tests.support.paths import FOREIGN_PLANT, ROOT
from tests.support.sessions import Session, opened
from tests.support.tiers import NIGHTLY, SLOW, select
from tests.support.toy_fmu import copy_toy

if TYPE_CHECKING:  # it takes a while to load
    from distributed import Client

use_memory_disk()

# of what tests and the processes that they start build and compile: not the user's, and kept for the next run
os.environ.setdefault(VARIABLE, str(ROOT / ".pytest_cache" / "emla-cosim"))

register_profiles()
heed_ctrl_c()

# jsonschema would build a grammar of IRIs in each process, for a second, and no schema here has any
sys.modules.setdefault("rfc3987_syntax", None)  # type: ignore[arg-type]

# readline sets these in the processes of pytest-xdist, and rich would keep the width for good
for size in ("COLUMNS", "LINES"):
    os.environ.pop(size, None)


def pytest_configure(config: pytest.Config) -> None:
    """Let properties draw as many examples as the selected tests are to have.

    A test may have both marks, as an example of a slow check; it is nightly.
    """
    if config.option.markexpr == SLOW:
        config.option.markexpr = f"{SLOW} and not {NIGHTLY}"
    select(config.option.markexpr)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Collect tests without looking for garbage.

    Modules and tests stay, and their syntax trees are millions of objects: it would take a third longer.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()


def pytest_collection_finish() -> None:
    """Draw the same examples, unless the profile says otherwise; hypothesis has loaded it by now."""
    if settings.default.derandomize:
        draw_no_constants_of_modules()


@pytest.hookimpl(optionalhook=True)  # of pytest-xdist
def pytest_xdist_auto_num_workers() -> int:
    """One more than there are cores: a third of the time tests wait for processes to start and end."""
    has_affinity = hasattr(os, "sched_getaffinity")
    return 1 + (len(os.sched_getaffinity(0)) if has_affinity else os.cpu_count() or 1)


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


def hash_models_once() -> None:
    """Hash the sources of each model once: no test changes them, and every run of a joint needs five."""
    compute_key, keys = Recipe.key, dict[object, str | None]()

    def find_key(recipe: Recipe) -> str | None:
        block = recipe.block
        if block.is_restricted or vars(block) or type(block) not in MODELS.values():
            return compute_key(recipe)
        made_from = type(block), type(block).__doc__, repr(replace(recipe, block=type(block)))
        if made_from not in keys:
            keys[made_from] = compute_key(recipe)
        return keys[made_from]

    pytest.MonkeyPatch().setattr(Recipe, "key", find_key)


@pytest.fixture(scope="session")
def fmu_folder() -> Path:
    """Return the folder with the native FMUs of all models; only what is out of date is built."""
    hash_models_once()
    folder = Path(os.environ[VARIABLE]) / "fmus of tests"
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
def cluster() -> "Iterator[Client]":
    """A client of a Dask cluster with one worker of two threads, for sweeps that do not end it."""
    from tests.support.clusters import shared_cluster

    with ExitStack() as stack:
        with chdir(ROOT):  # it outlives the folders of tests
            client = stack.enter_context(shared_cluster(2))
        yield client


@pytest.fixture(scope="module")
def scheduler() -> Iterator[None]:
    """For sweeps whose variants run in this process."""
    from tests.support.in_process_workers import run_in_process

    with run_in_process():
        yield


@pytest.fixture
def on_one_cluster(scheduler: None) -> None:
    """Let sweeps run their variants in this process."""


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
    paths["Toy"] = copy_toy(folder / "Toy.fmu")
    with ExitStack() as stack:
        yield {m: stack.enter_context(opened(path, folder / m)) for m, path in paths.items()}


@pytest.fixture
def toy(sessions: dict[str, Session]) -> Session:
    """The native toy with nothing in its log."""
    sessions["Toy"].log.all.clear()
    return sessions["Toy"]


@pytest.fixture
def emla(
    request: pytest.FixtureRequest, fmu_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Emla:
    """Return a function that runs `emla` in an empty folder, with the FMUs that the session has built.

    Pictures are empty unless the test is marked as `drawn`.
    """
    monkeypatch.chdir(tmp_path)
    widen_terminal(monkeypatch)
    if request.node.get_closest_marker("drawn") is None:
        draw_empty(monkeypatch)

    def call(*arguments: str) -> Result:
        takes_fmus = (
            arguments[0] in ("run", "rerun", "export", "sweep", "tune", "compare", "info")
            and "--fmus" not in arguments
        )
        more = ["--fmus", str(fmu_folder)] if takes_fmus else []
        return CliRunner().invoke(app, [*arguments, *more])

    return call
