"""The packages as users install them: the wheel alone, with each extra, and the sources offline."""

import os
import runpy
import sys
from pathlib import Path

import pytest

from emla_cosim.fmu.models import build
from fmublock.archive import read_built
from tests.support.paths import ROOT
from tests.support.processes import run

pytestmark = pytest.mark.slow
pytest.importorskip("hatchling", reason="The extra 'test' is not installed.")


class Installed:
    """An environment with the wheel, in which commands run in a folder of their own."""

    def __init__(self, wheel: Path, folder: Path) -> None:
        self.wheel, self.folder = wheel, folder
        self._bin = folder / "venv" / ("Scripts" if os.name == "nt" else "bin")
        run(sys.executable, "-m", "venv", folder / "venv", check=True)
        self.compiled = folder / "compiled"
        self._write_compilers(folder / "compilers")
        self.install("")

    def _write_compilers(self, folder: Path) -> None:
        """Put compilers before those of the machine that only note that they were called."""
        folder.mkdir()
        self._path = os.pathsep.join([str(folder), os.environ["PATH"]])
        for name in ("cc", "gcc", "clang", "c99", "zig"):
            (folder / name).write_text(f'#!/bin/sh\necho "$0" >> "{self.compiled}"\nexit 1\n')
            (folder / name).chmod(0o755)

    def install(self, extra: str) -> None:
        """Install the wheel with an extra."""
        requirement = f"{self.wheel}[{extra}]" if extra else str(self.wheel)
        self._run([str(self._bin / "python"), "-m", "pip", "install", "-q", requirement], 0)

    def emla(self, *arguments: str, code: int = 0) -> str:
        """Run a command of emla, which must end with this code; return what it shows."""
        return self._run([str(self._bin / "emla"), *arguments], code)

    def python(self, program: str) -> None:
        """Run a Python program."""
        self._run([str(self._bin / "python"), "-c", program], 0)

    def _run(self, command: list[str], code: int) -> str:
        outside = {n: v for n, v in os.environ.items() if not n.startswith(("PYTHON", "EMLA_", "VIRTUAL"))}
        variables = outside | {"EMLA_COSIM_CACHE": str(self.folder / "cache"), "PATH": self._path}
        process = run(*command, cwd=self.folder, env=variables, encoding="utf-8")
        assert process.returncode == code, process.stdout + process.stderr
        return process.stdout + process.stderr


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("packages")
    variables = {n: v for n, v in os.environ.items() if n != "EMLA_COSIM_PLATFORMS"}
    run(sys.executable, "-m", "hatchling", "build", "-d", folder, cwd=ROOT, env=variables, check=True)
    return folder


@pytest.fixture(scope="module")
def installed(packages: Path, tmp_path_factory: pytest.TempPathFactory) -> Installed:
    (wheel,) = packages.glob("*.whl")
    return Installed(wheel, tmp_path_factory.mktemp("installed"))


LACKING = {
    "plots": ("run", "lift", "--report"),
    "build": ("build", "SignalFault", "--fmi", "3", "--output", "fmi3"),
    "analyses": ("sweep", "lift", "--vary", "lift.plant.motor.R_s=0.1:0.2:2"),
}
"""Commands by the extra that they need."""


def test_the_base_runs_exports_and_verifies_without_compilers(installed: Installed) -> None:
    assert "pictures are left out" in installed.emla("run", "study", "--stop-time", "0.2")
    assert (installed.folder / "results/study/metrics.json").is_file()
    assert not list((installed.folder / "results/study").glob("*.png"))
    installed.emla("info", "study")
    installed.emla("list")
    for machine in ("hdrm-coupled", "hdrm-replay", "hdrm-merged", "excavator"):
        installed.emla("run", machine, "--stop-time", "0.05", "--output", f"results/{machine}")
    installed.emla("export", "lift", "lift.ssp")
    installed.emla("run", "lift.ssp", "--stop-time", "0.1")
    (installed.folder / "load.csv").write_text("time [s],F [kN]\n0,10\n1,20\n")
    installed.emla("run", "lift", "--stop-time", "0.1", "--input", "load.csv:lift.plant.F_L=F")
    assert not installed.compiled.exists()
    installed.emla("verify", "lift.ssp")  # which may compile the sources of FMUs
    program = "import sys, emla_cosim as ec; ec.load('study').prepare(); assert 'casadi' not in sys.modules"
    installed.python(program)


@pytest.mark.parametrize("extra", LACKING)
def test_commands_say_which_extra_they_lack(extra: str, installed: Installed) -> None:
    message = installed.emla(*LACKING[extra], code=2)
    assert f"run: pip install 'emla-cosim[{extra}]'." in message
    assert "Traceback" not in message


def test_commands_work_with_their_extras(installed: Installed) -> None:
    folder = installed.folder
    installed.install("plots")
    installed.emla("run", "lift", "--stop-time", "0.1", "--report")
    assert list((folder / "results/lift").glob("*.png"))
    assert (folder / "results/lift/report.html").is_file()
    installed.install("analyses")
    installed.emla(*LACKING["analyses"], "--stop-time", "0.1", "--output", "results/sweep")
    installed.install("cluster")
    installed.python(CLUSTER)
    installed.install("build")
    installed.emla(*LACKING["build"])
    installed.emla("export", "lift", "lift.fmu")
    installed.emla("run", "lift.fmu", "--stop-time", "0.1", "--step-size", "1e-4")


CLUSTER = """
import emla_cosim as ec
from distributed import Client

if __name__ == "__main__":
    with Client(n_workers=1, processes=False, dashboard_address=None) as client:
        varied = {"lift.plant.motor.R_s": [0.1, 0.2]}
        swept = ec.sweep("lift", varied, stop_time=0.1, scheduler=client)
    assert set(swept.variants["status"]) == {"done"}
"""


def test_the_sources_build_offline(packages: Path, tmp_path: Path) -> None:
    (sources,) = packages.glob("*.tar.gz")
    command = [sys.executable, "-m", "pip", "wheel", "-q", "--no-index", "--no-build-isolation", "--no-deps"]
    run(*command, sources, "-w", tmp_path, check=True)
    (wheel,) = tmp_path.glob("*.whl")
    assert wheel.name == next(packages.glob("*.whl")).name


PREBUILD = ROOT / "packaging" / "prebuild.py"


def test_wheels_have_the_platforms_that_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("EMLA_COSIM_CACHE", str(tmp_path / "cache"))
    build("Reference", "native", ["linux64", "win64"])
    runpy.run_path(str(PREBUILD))["_build_fmu"]("Reference", ["linux64"], tmp_path)
    (fmu,) = tmp_path.glob("fmus/*/Reference.fmu")
    assert read_built(fmu).platforms == {"linux64"}


@pytest.mark.parametrize(
    ("platform", "cache", "message"),
    [("amiga", "cache", "there is no platform 'amiga'"), ("linux64", "file", "cannot be written to")],
)
def test_failed_builds_of_fmus_give_one_message(
    platform: str, cache: str, message: str, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    variables = {"EMLA_COSIM_CACHE": str(tmp_path / cache)}
    process = run(sys.executable, PREBUILD, tmp_path / "built", platform, environment=variables)
    assert process.returncode == 1
    assert (
        process.stderr.startswith("Error: ") and message in process.stderr and process.stderr.count("\n") == 1
    )
