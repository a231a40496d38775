"""Copy the stepper, the FMUs of our models and the libraries of tables into a folder, as in a cache.

    python packaging/prebuild.py FOLDER [all|PLATFORM,...]

What is missing is built into the user's cache first, so that the next wheel takes a second.
"""

import os
import shutil
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory

from emla_cosim.base.errors import CosimError, check_choice
from emla_cosim.fmu.models import MODELS, PLATFORMS, build
from emla_cosim.stepper.library import StepperBuildError, prebuild_stepper
from emla_cosim.study.machines.blocks import read_machine_blocks
from fmublock import Block
from fmublock.archive import read_built
from fmublock.cache import VARIABLE, cache_folder
from fmublock.errors import BuildError
from fmublock.platforms import host_platform
from fmublock.table.building import prebuild_libraries

_LONGEST = ("EmlaCompliantAxis", "EmlaAxis", "EmlaCompliantPlant", "Trajectory")
"""Models to begin with, so that all cores are busy until the end."""

_MACHINES = ("excavator",)
"""Built-in machines besides the paper's that run without CasADi."""


def main(folder: str, wanted: str = "") -> None:
    """Fill a folder for platforms of FMI 2.0: this machine's without a name, or `all`."""
    platforms = list(PLATFORMS) if wanted == "all" else wanted.split(",") if wanted else [host_platform()]
    for platform in platforms:
        check_choice("platform", platform, PLATFORMS)
    os.environ[VARIABLE] = str(cache_folder())  # the same for all processes, even if it is a temporary one
    tasks = [*_LONGEST, *_MACHINES, "stepper", "tables", *(name for name in MODELS if name not in _LONGEST)]
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn")) as pool:
        list(pool.map(_build, tasks, repeat(platforms), repeat(Path(folder))))


def _build(task: str, platforms: Sequence[str], folder: Path) -> None:
    """Build the FMU of a model, those of a machine, the stepper or the tables, and copy the files."""
    if task == "stepper":
        for platform in platforms:
            _copy(prebuild_stepper(platform), folder)
    elif task == "tables":
        for path in prebuild_libraries(platforms):
            _copy(path, folder)
    else:
        for block in read_machine_blocks(task).all if task in _MACHINES else (task,):
            _build_fmu(block, platforms, folder)


def _build_fmu(block: str | type[Block], platforms: Sequence[str], folder: Path) -> None:
    path = build(block, "native", platforms)
    target = _copy(path, folder)
    if read_built(path).platforms != set(platforms):  # the user's has more
        with TemporaryDirectory() as apart:
            shutil.copyfile(build(block, "native", platforms, Path(apart)), target)


def _copy(path: Path, folder: Path) -> Path:
    target = folder / path.relative_to(cache_folder())
    target.parent.mkdir(parents=True, exist_ok=True)
    return Path(shutil.copyfile(path, target))


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except (CosimError, BuildError, StepperBuildError, OSError) as error:
        sys.exit(f"Error: {error}")
