"""The README is short, and its examples work as shown."""

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
from tests.support.paths import ROOT

README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = (ROOT / "docs/blocks.md").read_text(encoding="utf-8")
MODEL_LIST = (ROOT / "docs/models.md").read_text(encoding="utf-8")


def test_the_readme_is_short() -> None:
    lines = README.splitlines()
    assert len(lines) <= 120
    assert sum(line.startswith("```sh") for line in lines[:30]) == 2
    assert sum(line.startswith("![") for line in lines[:30]) == 1


def test_the_block_of_the_guide_becomes_an_fmu(tmp_path: Path) -> None:
    (code,) = (fence.content for fence in fences(BLOCKS) if "class Drive" in fence.content)
    namespace: dict[str, type] = {}
    exec(compile(code, "blocks.md", "exec"), namespace)
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
    assert len(shown) > len(left_out)
    assert [f.content for f in left_out if "bin/emla run study" not in f.content] == []


def test_every_model_and_scenario_named_exists() -> None:
    for name in re.findall(r"`emla run ([a-z-]+)`", README):
        load(name)
    assert set(re.findall(r"\[(\w+)\]\(../fmus/\w+/README.md\)", MODEL_LIST)) <= set(MODELS)
    for target in re.findall(r"\]\(((?!http)[^)]+)\)", README):
        assert (ROOT / target.partition("#")[0]).exists(), target
