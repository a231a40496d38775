"""What the README shows works as shown."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from fmpy import simulate_fmu
from fmpy.validation import validate_fmu
from typer.testing import CliRunner

from emla_cosim.cli import app
from emla_cosim.loading import load
from emla_cosim.models import MODELS
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


def test_the_commands_of_the_readme_exist(
    fmu_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each `emla run` and `emla export` line that needs no file of the reader's, cut short."""
    monkeypatch.chdir(tmp_path)
    shown = [line for line in README.splitlines() if re.match("emla (run|export) ", line)]
    lines = [re.split(r"\s{3,}", line)[0] for line in shown]
    runnable = [x for x in lines if not re.search(r"Other\.fmu|python|mine\.py|my\.toml", x)]
    assert len(runnable) >= 6
    for line in runnable:
        arguments = shlex.split(re.sub(r"--stop-time \S+", "", line))[1:]
        short = ["--stop-time", "0.002", "--fmus", str(fmu_folder)]
        short += ["--no-plots"] if arguments[0] == "run" else []
        result = CliRunner().invoke(app, [*arguments, *short])
        assert result.exit_code == 0, f"{line}: {result.output}"


def test_every_model_and_scenario_named_exists() -> None:
    for name in re.findall(r"`emla run ([a-z-]+)`", README):
        load(name)
    for model in re.findall(r"\[(\w+)\]\(fmus/\w+/README.md\)", README):
        assert model in MODELS
    for target in re.findall(r"\]\(((?!http)[^)]+)\)", README):
        assert (Path(__file__).parents[1] / target.partition("#")[0]).exists(), target
