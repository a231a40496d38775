"""What goes into a PythonFMU FMU: the block's sources, moved, and nothing foreign."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from fmpy import simulate_fmu

from fmublock import BuildError, build, load_block
from fmublock.sources import gather_sources, move_into_package
from tests.support.toy import Toy
from tests.support.toy_fmu import build_toy


@pytest.mark.parametrize("ignores_case", [False, True])
def test_all_imports_of_a_block_are_gathered(ignores_case: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Once, also if the file system finds `block.py` by the name `Block.py`."""
    if ignores_case:
        monkeypatch.setattr(Path, "is_file", _exists_in_any_case)
    assert set(gather_sources(Toy, "instance").texts) == {
        "tests/__init__.py", "tests/support/__init__.py", "tests/support/toy.py",
        "fmublock/__init__.py", "fmublock/block.py", "fmublock/functions.py", "fmublock/instance.py",
        "fmublock/noise.py", "fmublock/results.py", "fmublock/symbols.py",
        "fmublock/variables.py",
    }  # fmt: skip


def _exists_in_any_case(path: Path) -> bool:
    entries = path.parent.iterdir() if path.parent.is_dir() else ()
    return path.name.casefold() in (entry.name.casefold() for entry in entries)


CONDITIONAL = """

def never_called():
    if TYPE_CHECKING:
        import seen_by_checkers
    elif not TYPE_CHECKING:
        import in_elif
    if typing.TYPE_CHECKING and True:
        import seen_by_others
    else:
        import in_else
    try:
        with open("x"), open("y"):
            import in_with
    except (OSError, ImportError):
        import in_handler
    finally:
        import in_finally
    match 1:
        case 1:
            import in_case
    for _ in ():
        from in_loop import name
"""


def test_imports_in_all_statements_are_collected(tmp_path: Path) -> None:
    block = "from fmublock import Block, Output\n\n\nclass Mine(Block):\n    y = Output()\n"
    (tmp_path / "mine.py").write_text(block + CONDITIONAL)
    foreign = gather_sources(load_block(f"{tmp_path / 'mine.py'}:Mine")).foreign["mine"]
    assert foreign == {"in_elif", "in_else", "in_with", "in_handler", "in_finally", "in_case", "in_loop"}


@pytest.mark.parametrize(
    ("statement", "rewritten"),
    [
        ("import helper", "from P import helper"),
        ("import helper as h", "from P import helper as h"),
        ("import math, helper, os.path as p", "import math; from P import helper; import os.path as p"),
        ("import parts.gear as g", "from P.parts import gear as g"),
        ("import parts.gear", "import P.parts.gear; from P import parts"),
        ("from helper import (\n    a,\n    b as c,\n)", "from P.helper import (\n    a,\n    b as c,\n)"),
        ("from parts.gear import *", "from P.parts.gear import *"),
        ("if True: import helper; import parts", "if True: from P import helper; from P import parts"),
        ("s = 'ä'; import helper  # of mine", "s = 'ä'; from P import helper  # of mine"),
        ("from . import helper", "from . import helper"),
        ("from helpers import a", "from helpers import a"),
        ('"""Text\nfrom helper import a\n"""', '"""Text\nfrom helper import a\n"""'),
    ],
)
def test_every_way_to_import_is_moved(statement: str, rewritten: str) -> None:
    sources = {
        "mine.py": f"{statement}\nx = 1\n",
        "helper.py": "",
        "parts/__init__.py": "",
        "parts/gear.py": "",
    }
    assert move_into_package(sources, "P")["P/mine.py"] == f"{rewritten}\nx = 1\n"


def test_fmu_runs_without_any_package_installed(tmp_path: Path) -> None:
    """Its resources alone, in a Python that sees no site-packages."""
    path = build_toy("python", tmp_path / "Toy.fmu")
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path)
        slave = archive.read("resources/slavemodule.txt").decode()
    code = (
        f"import sys\nfrom {slave} import Toy\n"
        "toy = Toy(instance_name='t', resources='', visible=False)\n"
        "toy.setup_experiment(0.0); toy.enter_initialization_mode(); toy.exit_initialization_mode()\n"
        "assert toy.do_step(0.0, 0.1)\n"
        "print(toy.get_real([0]), 'fmublock' in sys.modules)\n"
    )
    run = subprocess.run(
        [sys.executable, "-E", "-s", "-S", "-c", code],
        cwd=tmp_path / "resources",
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.stdout.strip() == "[0.5] False", run.stderr


TWIN = """
import helper
from fmublock import Block, Output

class Twin(Block):
    y = Output()

    def outputs(self, v):
        return {"y": helper.FACTOR * v.time}
"""


def test_two_fmus_of_the_same_names_run_their_own_equations_in_one_process(tmp_path: Path) -> None:
    """Two files twin.py with a block Twin each, and a helper; tools ran the first one twice."""
    results = []
    for factor in (2.0, 3.0):
        folder = tmp_path / str(factor)
        folder.mkdir()
        (folder / "helper.py").write_text(f"FACTOR = {factor}\n")
        (folder / "twin.py").write_text(TWIN)
        block = load_block(f"{folder / 'twin.py'}:Twin")
        build(block, folder / "Twin.fmu", flavour="python")
    for factor in (2.0, 3.0):
        path = str(tmp_path / str(factor) / "Twin.fmu")
        results.append(simulate_fmu(path, stop_time=1.0, step_size=0.5, output_interval=0.5)["y"][-1])
    assert results == [2.0, 3.0]


def test_file_that_changed_after_the_block_was_defined_is_refused(tmp_path: Path) -> None:
    """What runs and what would be written differ."""
    file = tmp_path / "late.py"
    text = "from fmublock import Block, Output\n\n\nclass Late(Block):\n    y = Output()\n\n"
    file.write_text(text + "    def outputs(self, v):\n        return {'y': 1.0}\n")
    block = load_block(f"{file}:Late")
    file.write_text(text + "    def outputs(self, v):\n        return {'y': 2.0}\n")
    os.utime(file, (block.origin.time + 1.0,) * 2)
    with pytest.raises(BuildError, match=r"late.py' has changed since late was imported"):
        build(block, tmp_path / "Late.fmu", flavour="python")
