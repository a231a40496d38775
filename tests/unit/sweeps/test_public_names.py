"""`ec.sweep` is the function, though its package has the same name."""

import subprocess
import sys

import pytest

import emla_cosim as ec
from emla_cosim.sweeps.distributions import Distribution
from emla_cosim.sweeps.runner import sweep


@pytest.mark.parametrize(
    "imports",
    [
        "import emla_cosim as ec",
        "import emla_cosim as ec; import emla_cosim.sweeps.executor",
        "import emla_cosim.sweeps; import emla_cosim as ec",
        "import emla_cosim as ec; ec.sweep; import emla_cosim.sweeps.worker",
    ],
)
def test_it_is_the_function_whatever_was_imported(imports: str) -> None:
    code = f"{imports}; from emla_cosim import sweep; assert ec.sweep is sweep; print(sweep.__module__)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "emla_cosim.sweeps.runner", done.stderr


def test_so_is_the_one_that_tunes() -> None:
    code = "import emla_cosim as ec, emla_cosim.tuning.plan; print(ec.tune.__module__)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stdout.strip() == "emla_cosim.tuning.runner", done.stderr


def test_the_names_of_sweeps_are_public() -> None:
    assert {"sweep", "Plan", "SweepResult", "read_sweep", "Distribution"} <= set(ec.__all__)
    assert (ec.sweep, ec.Distribution) == (sweep, Distribution)
