"""The package stands alone: it loads nothing that simulates, draws or compiles."""

import subprocess
import sys

import fmu_verify

HEAVY = ("casadi", "dask", "bokeh", "scipy", "matplotlib", "polars", "emla_cosim.run", "emla_cosim.study")


def test_public_names_can_be_imported() -> None:
    assert {"verify", "Report", "Finding", "Verdict"} <= set(fmu_verify.__all__)
    assert all(getattr(fmu_verify, name) for name in fmu_verify.__all__)


def test_import_loads_no_simulator() -> None:
    program = f"""import sys, fmu_verify
fmu_verify.verify
import fmu_verify.examiner
print(*(name for name in {HEAVY} if name in sys.modules))"""
    process = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert process.stdout.split() == []
