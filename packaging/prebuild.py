"""Copy the stepper, the FMUs of our models and the libraries of tables into a folder, as in a cache.

    python packaging/prebuild.py FOLDER [all|PLATFORM,...]

What is missing is built into the user's cache first. So the second call, which pip makes, takes a second.
"""

import os
import shutil
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from emla_cosim.fmu.models import MODELS, PLATFORMS, build
from emla_cosim.stepper.library import prebuild_stepper
from emla_cosim.study.machines.blocks import read_machine_blocks
from fmublock.cache import cache_folder
from fmublock.platforms import host_platform
from fmublock.table.building import prebuild_libraries

_LONGEST = ("EmlaCompliantAxis", "EmlaAxis", "EmlaCompliantPlant", "Trajectory")
"""Models to begin with, so that all cores are busy until the end."""


_MACHINES = ("excavator",)
"""Built-in machines besides the paper's that run without CasADi."""


def main(folder: str, wanted: str = "") -> None:
    """Fill a folder for platforms of FMI 2.0: this machine's without a name, or `all`."""
    platforms = list(PLATFORMS) if wanted == "all" else wanted.split(",") if wanted else [host_platform()]
    tasks = [*_LONGEST, *_MACHINES, "stepper", "tables", *(name for name in MODELS if name not in _LONGEST)]
    with ProcessPoolExecutor(os.cpu_count(), get_context("spawn")) as pool:
        for paths in pool.map(_build, tasks, [platforms] * len(tasks)):
            for path in paths:
                target = Path(folder) / path.relative_to(cache_folder())
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(path, target)


def _build(task: str, platforms: Sequence[str]) -> list[Path]:
    """Build the FMU of a model, those of a machine, the stepper or the tables, and return the files."""
    if task == "stepper":
        return [prebuild_stepper(platform) for platform in platforms]
    if task == "tables":
        return prebuild_libraries(platforms)
    blocks = read_machine_blocks(task).all if task in _MACHINES else (task,)
    return [build(block, "native", platforms) for block in blocks]


if __name__ == "__main__":
    main(*sys.argv[1:])
