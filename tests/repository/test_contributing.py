"""What CONTRIBUTING.md says must be added for an extension is enough: in a copy, as a contributor does it."""

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.support.paths import ROOT

Run = Callable[..., str]

ALGORITHM = '''"""Gauss-Seidel under another name."""

from dataclasses import dataclass

from .gauss_seidel import GaussSeidel


@dataclass(eq=False)
class Backwards(GaussSeidel):
    """Gauss-Seidel from the last slave to the first."""
'''

TABLE = '''"""results.txt."""

from .csv_file import CsvFile


class TextFile(CsvFile):
    """A table like results.csv."""
'''

STEP_SIZE_CONTROL = '''"""Steps that grow."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...base.arrays import Vector
from ...base.option import option
from ..algorithms.algorithm import Algorithm
from .step_size_control import StepRequest, StepSizeControl
from .stepping_base import RowSink, Stepping


class GrowingSteps(Stepping):
    """Each step is longer than the one before by the same factor."""

    def __init__(self, algorithm: Algorithm, request: StepRequest, growth: float) -> None:
        super().__init__(algorithm, request.times)
        self._time, self._step, self._growth = request.times.start, request.times.step, growth

    @property
    def time(self) -> float:
        """Where the simulation is, in s."""
        return self._time

    @property
    def steps(self) -> int:
        """Steps done since the start time."""
        return self.algorithm.steps

    @property
    def finished(self) -> bool:
        """Whether the stop time is reached."""
        return self._time >= self.times.stop

    def advance(self, rows: RowSink, most: int, until: float = math.inf) -> None:
        """Do at most so many steps, none beyond `until` in s, and record them."""
        for _ in range(most):
            if self.reached(until):
                return
            end = min(self._time + self._step, until, self.times.stop)
            self.algorithm.step(self._time, end - self._time)
            self._time, self._step = end, self._step * self._growth
            if self.watch is not None:
                self.watch(end, self.algorithm.network.signals)
            self.record(rows)

    def memory(self) -> dict[str, Vector]:
        """Also the time and the next step."""
        return super().memory() | {"growing": np.array([self._time, self._step])}

    def remember(self, memory: Mapping[str, Any]) -> None:
        """Take over what such a stepping remembered."""
        super().remember(memory)
        self._time, self._step = memory["growing"].tolist()


@dataclass(eq=False)
class GrowingStepSize(StepSizeControl):
    """Steps that grow."""

    growth: float | None = option(help="Ratio of a step to the one before.", above=1.0, identity="growth")

    def stepping(self, algorithm: Algorithm, request: StepRequest) -> Stepping:
        """Return steps that grow."""
        return GrowingSteps(algorithm, request, self.growth or 1.5)
'''

BLOCK = '''"""A spring."""

from typing import Any

from fmublock import Block, Input, Output, Parameter


class Spring(Block):
    """A spring."""

    x = Input(unit="m", description="Extension")
    k = Parameter(1e3, unit="N/m", description="Stiffness")
    F = Output(unit="N", description="Force")

    def outputs(self, v: Any) -> dict[str, Any]:
        """The force."""
        return {"F": v.k * v.x}
'''

CHECK = '''

@check(
    "description.author",
    "The author is named",
    Clause("2.2.1", "The optional attribute author has the string with the name."),
    "Give an author.",
    needs=("description.schema",),
)
def author(subject: Subject) -> CheckOutcome:
    """There is an author."""
    return judge_problems((), "It has one.", [] if subject.tree.get("author") else ["It has no author."])
'''


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    for folder in ("src", "orchestration", "fmus"):
        ignored = shutil.ignore_patterns("__pycache__", "*.fmu")
        shutil.copytree(ROOT / folder, tmp_path / folder, ignore=ignored)
    shutil.copy(ROOT / "LICENSE", tmp_path)
    return tmp_path


@pytest.fixture
def emla(copy: Path, fmu_folder: Path) -> Run:
    def run(*arguments: str) -> str:
        done = subprocess.run(
            [sys.executable, "-m", "emla_cosim", *arguments], cwd=copy, capture_output=True, text=True,
            check=False, env={**os.environ, "PYTHONPATH": f"{copy / 'src'}:{copy / 'orchestration'}"},
        )  # fmt: skip
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    return run


def edit(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))


RUN = ("run", "lift", "--stop-time", "0.01", "--no-plots", "--output", "o")


def test_an_algorithm_is_a_class_and_its_name(copy: Path, emla: Run, fmu_folder: Path) -> None:
    room = copy / "orchestration/emla_cosim/master/algorithms"
    (room / "backwards.py").write_text(ALGORITHM)
    registry = room / "registry.py"
    edit(registry, "from .gauss_seidel", "from .backwards import Backwards\nfrom .gauss_seidel")
    edit(registry, '"strong": Strong}', '"strong": Strong, "backwards": Backwards}')
    assert "backwards" in emla("list")
    emla(*RUN, "--fmus", str(fmu_folder), "--algorithm", "backwards")
    assert '"backwards"' in (copy / "o/run.json").read_text()


def test_a_table_format_is_a_class_and_its_name(copy: Path, emla: Run, fmu_folder: Path) -> None:
    room = copy / "orchestration/emla_cosim/recorders"
    (room / "text_file.py").write_text(TABLE)
    edit(room / "registry.py", '"csv": _', '"txt": _import_table("text_file", "TextFile"),\n    "csv": _')
    emla(*RUN, "--fmus", str(fmu_folder), "--output-format", "txt")
    assert (copy / "o/results.txt").read_text().startswith("time,")
    emla("plot", "o", "--signals", "lift.plant.x_L", "--output", "of_folder.png")
    emla("plot", "o/results.txt", "--signals", "lift.plant.x_L", "--output", "of_file.png")
    assert (copy / "of_folder.png").read_bytes()[:4] == (copy / "of_file.png").read_bytes()[:4] == b"\x89PNG"
    (copy / "o").rename(copy / "before")
    emla(*RUN, "--fmus", str(fmu_folder), "--output-format", "txt", "--reference", "before")
    emla(*RUN, "--fmus", str(fmu_folder), "--output", "driven", "--input", "o/results.txt:lift.reference.*")


def test_a_step_size_control_is_a_class_and_its_name(copy: Path, emla: Run, fmu_folder: Path) -> None:
    room = copy / "orchestration/emla_cosim/master/stepping"
    (room / "growing.py").write_text(STEP_SIZE_CONTROL)
    edit(room / "registry.py", "from .step", "from .growing import GrowingStepSize\nfrom .step")
    edit(room / "registry.py", '    "error": E', '    "growing": GrowingStepSize,\n    "error": E')
    run = (*RUN, "--fmus", str(fmu_folder))

    def times() -> list[float]:
        rows = (copy / "o/results.csv").read_text().splitlines()[1:]
        return [float(row.partition(",")[0]) for row in rows]

    emla(*run, "--step-size", "1e-4", "--growth", "2")
    expected = [1e-4 * (2**k - 1) for k in range(7)]
    assert times() == pytest.approx([*expected, 0.01])
    settings = json.loads((copy / "o/run.json").read_text())["settings"]
    assert (settings["step_size_control"], settings["growth"]) == ("growing", 2.0)
    whole = (copy / "o/results.csv").read_bytes()
    emla("rerun", "o/run.json", "--no-plots", "--output", "o", "--overwrite")
    assert (copy / "o/results.csv").read_bytes() == whole
    emla(*run, "--step-size-control", "growing", "--step-size", "1e-4")
    assert times()[1:3] == pytest.approx([1e-4, 2.5e-4])
    emla(*run)
    assert times()[1:3] == pytest.approx([1e-3, 2e-3])


def test_a_block_is_a_class_and_its_place_in_a_list(copy: Path, emla: Run) -> None:
    package = copy / "src/emla_fmu"
    (package / "spring.py").write_text(BLOCK)
    edit(package / "__init__.py", "from .signal_fault", "from .spring import Spring\nfrom .signal_fault")
    edit(package / "__init__.py", "BLOCKS = (", "BLOCKS = (Spring, ")
    (copy / "fmus/Spring").mkdir()
    (copy / "fmus/Spring/README.md").write_text("# Spring\n\nF = k x\n")
    emla("build", "Spring", "--output", "built", "--platform", "linux64")
    assert re.search(r"\bF\s.*output", emla("info", "built/Spring/Spring.fmu"))


def test_a_check_is_a_function_and_its_place_in_the_catalogue(copy: Path, emla: Run) -> None:
    room = copy / "orchestration/emla_cosim/verification"
    with (room / "checks/experiment.py").open("a") as stream:
        stream.write(CHECK)
    edit(room / "catalogue.py", "experiment.experiment,", "experiment.experiment,\n    experiment.author,")
    assert "description.author" in emla("verify", "--list")


def test_the_page_names_files_that_exist() -> None:
    page = (ROOT / "CONTRIBUTING.md").read_text()
    named = re.findall(r"`((?:src|orchestration|tests|fmus|docs)/[^`]*)`", page)
    assert len(named) > 15
    for name in named:
        assert (ROOT / name.replace("NAME", "EmlaPlant")).exists(), name
    rooms = re.findall(r"`((?:recorders|master|study|verification|cli)/[^`]*)`", page)
    for name in rooms:
        assert (ROOT / "orchestration/emla_cosim" / name).exists(), name
