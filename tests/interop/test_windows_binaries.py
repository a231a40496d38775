"""Our FMUs for Windows, executed by Wine: the closed loop of the lift joint gives the results of Linux."""

import shutil
import subprocess
import zipfile
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest

from emla_cosim.fmu.models import build
from tests.interop.conftest import Compile
from tests.interop.test_c_host import LIFT, Fmus, write_plan
from tests.support.c_programs import needs_cc, read_results, run_program, windows_host
from tests.support.processes import run

pytestmark = [
    needs_cc,
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("wine") is None, reason="Wine is not installed."),
]


@pytest.fixture(scope="module")
def wine() -> Iterator[dict[str, str]]:
    """The environment of Wine without windows, in a folder of its own, which it fills with 700 MB."""
    with TemporaryDirectory(prefix="emla-wine-", dir="/var/tmp", ignore_cleanup_errors=True) as folder:
        environment = {
            "WINEPREFIX": folder,
            "WINEDEBUG": "-all",
            "WINEDLLOVERRIDES": "mscoree,mshtml=",
            "DISPLAY": "",
        }
        once: dict[str, Any] = {"stdin": subprocess.DEVNULL, "check": True, "timeout": 300}
        run("wine", "wineboot", "--init", environment=environment, **once)
        yield environment
        run("wineserver", "--kill", environment=environment)


def test_windows_binaries_give_the_results_of_linux(
    wine: dict[str, str], compiled: Compile, unpacked_fmus: Fmus, tmp_path: Path
) -> None:
    """All connected outputs over 0.05 s, with the same host compiled for both."""
    libraries = {}
    for model in {c.model for c in LIFT.components}:
        fmu = build(model, "native", ["win64"], tmp_path)
        with zipfile.ZipFile(fmu) as archive:
            libraries[model] = Path(archive.extract(f"binaries/win64/{model}.dll", tmp_path / model))
    host = compiled("none", "host").programs["host"]
    run_program(host, write_plan(tmp_path / "plan", unpacked_fmus, 500), tmp_path / "linux")
    plan = write_plan(tmp_path / "plan", unpacked_fmus, 500, libraries)
    run_program("wine", windows_host(tmp_path), plan, tmp_path / "windows", **wine)
    expected, results = (read_results(tmp_path / name) for name in ("linux", "windows"))
    assert results.shape == expected.shape
    # their sines differ in the last bit
    assert (np.abs(results - expected).max(axis=0) <= 1e-14 * np.abs(expected).max(axis=0)).all()
    assert (results == expected).all(axis=0).mean() > 0.5
