"""Commands with the study's machine in an environment that can run FMUs, but not build any."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

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


def run_without(packages: set[str], folder: Path, *words: str) -> "subprocess.CompletedProcess[str]":
    """Run the command line without these packages, also in its child processes."""
    (folder / "blocked").mkdir()
    (folder / "blocked/sitecustomize.py").write_text(BLOCKER.format(packages=packages))
    paths = [str(folder / "blocked"), *filter(None, sys.path)]
    return subprocess.run(
        [sys.executable, "-m", "emla_cosim", *words],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.parametrize("mode", mostly_slow(["coupled", "replay", "merged"], ["coupled"]))
def test_run_without_packages_that_build(mode: str, fmu_folder: Path, tmp_path: Path) -> None:
    options = ("--fmus", str(fmu_folder), "--stop-time", "0.02", "--no-plots", "--output", "run")
    done = run_without(BUILDING | PICTURES, tmp_path, "run", f"hdrm-{mode}", *options)
    assert done.returncode == 0, done.stderr
    assert {"results.csv", "metrics.json", "run.json"} <= {path.name for path in (tmp_path / "run").iterdir()}


@pytest.mark.slow
def test_pictures_without_packages_that_build(fmu_folder: Path, tmp_path: Path) -> None:
    """They need the poses of the machine, and the convex lines around its parts."""
    options = ("--fmus", str(fmu_folder), "--stop-time", "0.1", "--animate", "--output", "run")
    done = run_without(BUILDING, tmp_path, "run", "hdrm-replay", *options)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "run/manipulator.gif").is_file()


@pytest.mark.slow
def test_info_without_packages_that_build(fmu_folder: Path, tmp_path: Path) -> None:
    fmus = ("--fmus", str(fmu_folder))
    done = run_without(BUILDING | PICTURES, tmp_path, "info", "hdrm-coupled", "--json", *fmus)
    assert done.returncode == 0, done.stderr
    lift, *_ = json.loads(done.stdout)["machine"]["actuators"]
    assert lift["start_force"] == pytest.approx(56.7e3, abs=50.0)


@pytest.mark.slow
def test_export_without_packages_that_build(fmu_folder: Path, tmp_path: Path) -> None:
    done = run_without(
        BUILDING | PICTURES, tmp_path, "export", "hdrm-coupled", "x.ssp", "--fmus", str(fmu_folder)
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "x.ssp").is_file()
