"""What CONTRIBUTING.md says must be added for an extension is enough: in a copy, as a contributor does it."""

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
def author(subject: Subject) -> Outcome:
    """There is an author."""
    return judged((), "It has one.", [] if subject.tree.get("author") else ["It has no author."])
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
    edit(room / "registry.py", '"csv": _', '"txt": _imported("text_file", "TextFile"),\n    "csv": _')
    emla(*RUN, "--fmus", str(fmu_folder), "--output-format", "txt")
    assert (copy / "o/results.txt").read_text().startswith("time,")


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
