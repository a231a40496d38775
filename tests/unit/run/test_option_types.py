"""Options are typed: a name or a value that the table does not have is an error of pyright."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest

from emla_cosim.base.option import SHOWING, SWEEP
from emla_cosim.run.option_types import RunOptions, SweepOptions
from emla_cosim.run.options import list_options
from tests.support.paths import ROOT

RIGHT = """
import numpy as np
import emla_cosim as ec

scenario = ec.load("lift", stop_time="0.1 s", fmus="here", actuator={"lift": "mine.toml"})
with scenario.prepare(isolate=True, replace={"lift.controller": "mine.fmu"}) as simulation:
    simulation.run(stop_time=1, set={"a.b": 2.0, "a.c": [1.0, 2.0], "a.d": np.zeros(3)}, overwrite=True)
    simulation.run(algorithm=ec.Strong(extrapolation="fmu"), tolerance={"*": 1e-3})
    simulation.start(output_interval="2 ms", order=["a", "b"])
ec.sweep("lift", {"a.b": [1.0]}, require=["x < 1"], stop_time=1, output="out", overwrite=True)
ec.compare("lift", ["rsba"], stop_time="2 s")
ec.tune("lift", {"a.b": "1:2"}, objective="x", controller="rsba")
ec.info("lift", gains="published")
scenario.export("lift.ssp", platform=["linux64"])
"""

WRONG = """
import emla_cosim as ec

def use(scenario: ec.Scenario, simulation: ec.Simulation) -> None:
    ec.load("lift", gain="published")  # error
    scenario.prepare(step_sise=1e-4)  # error
    simulation.run(stop_tiem=1)  # error
    simulation.run(stop_time=[1])  # error
    ec.sweep("lift", stop_tiem=1)  # error
    ec.compare("lift", controller="rsba")  # error
    ec.tune("lift", stop_tiem=1)  # error
    ec.info("lift", stop_tiem=1)  # error
    scenario.export("lift.ssp", stop_tiem=1)  # error
"""


def test_every_option_has_a_type() -> None:
    for types, command, untyped in ((RunOptions, None, set[str]()), (SweepOptions, SWEEP, {"overwrite"})):
        options = {name for name, o in list_options(command).items() if o.stage != SHOWING}
        assert types.__annotations__.keys() == options - untyped


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("pyright") is None, reason="The extra 'dev' is not installed.")
def test_pyright_reports_wrong_options(tmp_path: Path) -> None:
    right, wrong = tmp_path / "right.py", tmp_path / "wrong.py"
    right.write_text(RIGHT)
    wrong.write_text(WRONG)
    settings = {
        "include": [str(tmp_path)],
        "extraPaths": [str(ROOT / "src"), str(ROOT / "orchestration")],
        "pythonVersion": "3.11",
    }
    (tmp_path / "pyrightconfig.json").write_text(json.dumps(settings))
    process = subprocess.run(
        ["pyright", "--outputjson", "-p", str(tmp_path)], capture_output=True, text=True, check=False
    )
    content = json.loads(process.stdout)["generalDiagnostics"]
    errors = [(Path(diagnostic["file"]).name, diagnostic["range"]["start"]["line"]) for diagnostic in content]
    assert set(errors) == {
        ("wrong.py", n) for n, line in enumerate(WRONG.splitlines()) if line.endswith("# error")
    }, content
