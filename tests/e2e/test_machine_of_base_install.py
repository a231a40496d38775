"""Commands with the study's machine in an environment that can run FMUs, but not build any."""

import os
import sys
from pathlib import Path

import pytest

from tests.support.processes import run
from tests.support.tiers import mostly_slow

BLOCKER = """
import sys

class Blocker:
    def find_spec(self, name, path=None, target=None):
        package = name.partition(".")[0]
        if package in {packages}:
            raise ModuleNotFoundError(f"No module named '{{package}}'", name=package)

sys.meta_path.insert(0, Blocker())
"""
BUILDING = {"casadi", "cloudpickle", "cma", "distributed", "pythonfmu", "scipy", "ziglang"}
PICTURES = {"bokeh", "contourpy", "matplotlib", "PIL"}
QUICK = "--stop-time 0.02 --no-plots --output"
COMMANDS = [
    (f"run hdrm-coupled {QUICK} .", "results.csv"),
    (f"run hdrm-replay {QUICK} .", "results.csv"),
    (f"run hdrm-merged {QUICK} .", "results.csv"),
    ("info hdrm-coupled --json info.json", "info.json"),
    ("export hdrm-coupled x.ssp", "x.ssp"),
    # pictures need the poses of the machine, and the convex lines around its parts
    ("run hdrm-replay --stop-time 0.1 --animate --output .", "manipulator.gif"),
]
"""Commands, each with a file that it writes."""


@pytest.mark.parametrize(("command", "file"), mostly_slow(COMMANDS, COMMANDS[:1]))
def test_commands_without_packages_that_build(
    command: str, file: str, fmu_folder: Path, tmp_path: Path
) -> None:
    """The packages are blocked in child processes, too."""
    packages = BUILDING if "--animate" in command else BUILDING | PICTURES
    blocker, folder = tmp_path / "blocked", tmp_path / "here"
    for new_folder in (blocker, folder):
        new_folder.mkdir()
    (blocker / "sitecustomize.py").write_text(BLOCKER.format(packages=packages))
    paths = os.pathsep.join([str(blocker), *filter(None, sys.path)])
    words = [sys.executable, "-m", "emla_cosim", *command.split(), "--fmus", fmu_folder]
    process = run(*words, cwd=folder, environment={"PYTHONPATH": paths})
    assert process.returncode == 0, process.stderr
    assert (folder / file).is_file()
