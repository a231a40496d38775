"""`ec.sweep` and `ec.tune` are functions, though packages have similar names."""

import subprocess
import sys

CODE = """
import emla_cosim.analyses.sweep
import emla_cosim as ec
import emla_cosim.analyses.execution.executor
from emla_cosim import sweep
assert ec.sweep is sweep
import emla_cosim.analyses.tune.plan
print(ec.sweep.__module__, ec.tune.__module__)
"""


def test_imports_of_packages_do_not_hide_functions() -> None:
    process = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=False)
    expected = ["emla_cosim.analyses.sweep.runner", "emla_cosim.analyses.tune.runner"]
    assert process.stdout.split() == expected, process.stderr
