"""What goes into a PythonFMU FMU: the block's sources, moved, and nothing foreign."""

import importlib
import subprocess
import sys
import zipfile
from pathlib import Path
from textwrap import dedent

import pytest
from fmpy import simulate_fmu

from fmublock.export import BuildError
from fmublock.python_flavour import build_python, python_draft
from fmublock.sources import gather_sources, move_into_package
from tests.support.toy_fmu import DOCUMENTS, PRODUCER, build_toy


def test_everything_a_block_imports_is_gathered() -> None:
    sources = gather_sources(["toy", "fmublock.block", "fmublock.instance"])
    assert set(sources) == {
        "toy.py", "fmublock/__init__.py", "fmublock/block.py", "fmublock/functions.py",
        "fmublock/instance.py", "fmublock/noise.py", "fmublock/units.py", "fmublock/variables.py",
    }  # fmt: skip


def test_moved_sources_import_each_other_and_not_what_is_installed() -> None:
    moved = move_into_package(gather_sources(["toy", "fmublock.block"]), "Toy_123")
    assert "from Toy_123.fmublock import (" in moved["Toy_123/toy.py"]
    assert "from Toy_123.fmublock.noise import lehmer, uniform" in moved["Toy_123/toy.py"]
    assert not any("\nfrom fmublock" in text or "\nfrom toy" in text for text in moved.values())


def test_an_import_beyond_the_standard_library_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = """
        import numpy
        from fmublock import Block, Output

        class Greedy(Block):
            y = Output()

            def outputs(self, v):
                return {"y": numpy.pi}
    """
    (tmp_path / "greedy.py").write_text(dedent(text))
    monkeypatch.syspath_prepend(tmp_path)
    from greedy import Greedy  # pyright: ignore[reportMissingImports]

    with pytest.raises(
        BuildError, match="greedy imports numpy; a block may import the standard library only"
    ):
        python_draft(Greedy(), PRODUCER, DOCUMENTS)


def test_the_fmu_runs_without_any_package_installed(tmp_path: Path) -> None:
    """Its resources alone, in a Python that sees no site-packages."""
    path = build_toy("python", tmp_path / "Toy.fmu")
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path)
        slave = archive.read("resources/slavemodule.txt").decode()
    code = (
        f"import sys; sys.path.insert(0, {str(tmp_path / 'resources')!r})\n"
        f"from {slave} import Toy\n"
        "toy = Toy(instance_name='t', resources='', visible=False)\n"
        "toy.setup_experiment(0.0); toy.enter_initialization_mode(); toy.exit_initialization_mode()\n"
        "assert toy.do_step(0.0, 0.1)\n"
        "print(toy.get_real([0]), 'fmublock' in sys.modules)\n"
    )
    run = subprocess.run(
        [sys.executable, "-I", "-S", "-c", code], capture_output=True, text=True, check=False
    )
    assert run.stdout.strip() == "[0.5] False", run.stderr


def test_two_fmus_of_the_same_names_run_their_own_equations_in_one_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two scripts twin.py with a block Twin each: users' tools run the first one's model twice."""
    results = []
    for factor in (2.0, 3.0):
        folder = tmp_path / str(factor)
        folder.mkdir()
        text = f"""
            from fmublock import Block, Output

            class Twin(Block):
                y = Output()

                def outputs(self, v):
                    return {{"y": {factor} * v.time}}
        """
        (folder / "twin.py").write_text(dedent(text))
        with monkeypatch.context() as patch:
            patch.syspath_prepend(folder)
            twin = importlib.import_module("twin")
            build_python(python_draft(twin.Twin(), PRODUCER, DOCUMENTS), folder / "Twin.fmu")
            del sys.modules["twin"]
    for factor in (2.0, 3.0):
        path = str(tmp_path / str(factor) / "Twin.fmu")
        results.append(simulate_fmu(path, stop_time=1.0, step_size=0.5, output_interval=0.5)["y"][-1])
    assert results == [2.0, 3.0]
