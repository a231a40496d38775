"""What the README shows works as shown."""

import re
from pathlib import Path

import numpy as np
import pytest
from fmpy import simulate_fmu
from fmpy.validation import validate_fmu

from emla_cosim.fmu.models import MODELS
from emla_cosim.study.loading import load
from fmublock import build
from tests.support.pages import fences

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def test_the_block_of_the_readme_becomes_an_fmu(tmp_path: Path) -> None:
    (code,) = (fence.content for fence in fences(README) if "class Drive" in fence.content)
    namespace: dict[str, type] = {}
    exec(compile(code, "README.md", "exec"), namespace)
    build(namespace["Drive"], tmp_path / "Drive.fmu")
    assert validate_fmu(str(tmp_path / "Drive.fmu")) == []
    result = simulate_fmu(
        str(tmp_path / "Drive.fmu"), start_values={"F": 4.0}, stop_time=3.0, output_interval=0.5
    )
    assert result["v"] == pytest.approx(2.0 * (1 - np.exp(-0.2 * result["time"])), rel=1e-10)


def test_every_command_of_the_readme_is_executed() -> None:
    """By the test of pages, but for those that set up an environment, which `.ci/run` executes."""
    shown = [f for f in fences(README) if re.search(r"\bemla (?!cosim)", f.content)]
    left_out = [f for f in shown if (f.language, f.what) != ("sh", "")]
    assert len(shown) - len(left_out) >= 5
    assert [f.content for f in left_out if "bin/emla run study" not in f.content] == []


def test_every_model_and_scenario_named_exists() -> None:
    for name in re.findall(r"`emla run ([a-z-]+)`", README):
        load(name)
    for model in re.findall(r"\[(\w+)\]\(fmus/\w+/README.md\)", README):
        assert model in MODELS
    for target in re.findall(r"\]\(((?!http)[^)]+)\)", README):
        assert (Path(__file__).parents[1] / target.partition("#")[0]).exists(), target
