"""From a Python file of a user to an FMU, in any folder."""

import os
import re
import subprocess
import sys
import zipfile
from pathlib import Path
from textwrap import dedent
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from fmpy import simulate_fmu
from fmpy.validation import validate_fmu

from fmublock import Block, BuildError, Input, Producer, build, load_block
from fmublock.__main__ import main
from fmublock.errors import LoadError
from fmublock.recipe import Documents, RelatedFile
from tests.support.paths import ROOT

DRIVE = """
    import helper
    from fmublock import Block, Input, Output, Parameter, State

    GAIN = 2.0

    class Drive(Block):
        \"\"\"A mass with friction, pushed by a force.

        The power is $P = F v$.
        \"\"\"

        F = Input(unit="N", description="Force")
        m = Parameter(10.0, unit="kg", minimum=0.1, name="body.m", description="Mass")
        v = State(0.0, unit="m/s", description="Speed")
        P = Output(unit="W", description="Power of the force")

        def derivatives(self, v):
            return {"v": (v.F - helper.friction(v)) / v.m}

        def outputs(self, v):
            return {"P": v.F * v.v}

    class Other(Block):
        y = Output()

        def outputs(self, v):
            return {"y": v.time}

    def function():
        pass
"""
HELPER = """
    def friction(v):
        return 2.0 * v.v
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of a user with mine.py and helper.py; the current one."""
    (tmp_path / "mine.py").write_text(dedent(DRIVE))
    (tmp_path / "helper.py").write_text(dedent(HELPER))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def speed(fmu: Path) -> float:
    """The drive's speed after 3 s at 4 N."""
    result = simulate_fmu(str(fmu), start_values={"F": 4.0}, stop_time=3.0, output_interval=0.5)
    return float(result["v"][-1])


@pytest.mark.parametrize("flavour", ["native", "python"])
def test_command_builds_from_any_folder(
    folder: Path, flavour: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["build", "mine.py:Drive", "--flavour", flavour, "--output", "out"]) == 0
    assert re.fullmatch(r"out/Drive.fmu  \d+ KiB\n", capsys.readouterr().out)
    fmu = folder / "out" / "Drive.fmu"
    assert validate_fmu(str(fmu)) == []
    assert speed(fmu) == pytest.approx(2.0 * (1.0 - np.exp(-0.6)), rel=1e-10)
    with zipfile.ZipFile(fmu) as archive:
        page = archive.read("documentation/index.html").decode()
        description = archive.read("modelDescription.xml").decode()
    assert "<h1>Drive</h1>" in page and "pushed by a force" in page and "<math" in page
    assert "license=" not in description and 'generationTool="EMLA-Cosim fmublock"' in description
    ticks: list[None] = []
    drive = load_block("mine.py:Drive")
    repeated = build(drive(), "again.fmu", flavour=flavour, advance=lambda: ticks.append(None))
    assert repeated.read_bytes() == fmu.read_bytes()
    assert len(ticks) == (flavour == "native")  # one for each platform


def test_platforms_and_producer_are_options(folder: Path) -> None:
    fmu = build(
        load_block("mine.py:Other"),
        "o.fmu",
        platforms=["aarch64-linux"],
        producer=Producer("mine", "3", "BSD"),
    )
    with zipfile.ZipFile(fmu) as archive:
        binaries = {name for name in archive.namelist() if name.startswith("binaries/")}
        description = archive.read("modelDescription.xml").decode()
    assert binaries == {"binaries/aarch64-linux/Other.so"}
    assert 'version="3" license="BSD" generationTool="mine"' in description


@pytest.mark.parametrize(
    ("arguments", "code", "sentence"),
    [
        ("nothing.py:Drive", 2, "there is no file 'nothing.py'."),
        ("mine.py", 2, "'mine.py' does not name a block; write FILE.py:BLOCK."),
        ("mine.py:Nothing", 2, "'mine.py' has no Nothing; its blocks are Drive, Other."),
        ("helper.py:Drive", 2, "'helper.py' has no Drive; it defines no block."),
        ("mine.py:GAIN", 2, "GAIN of 'mine.py' is not a block; derive it from fmublock.Block."),
        ("mine.py:Block", 2, "Block of 'mine.py' is not a block; derive it from fmublock.Block."),
        ("syntax.py:A", 2, "'syntax.py' is not valid Python: '(' was never closed in line 2."),
        ("imports_syntax.py:A", 2, "'syntax.py' is not valid Python: '(' was never closed in line 2."),
        ("import.py:A", 2, "'import.py' fails in line 1: ModuleNotFoundError: No module named 'nowhere'."),
        ("exits.py:A", 2, "'exits.py' fails in line 2: SystemExit: 3."),
        ("binary.py:A", 2, "'binary.py' "),
        ("units.py:A", 2, "'units.py' fails in line 3: TypeError: a variable with the unit 'm' is Real"),
        ("twice.py:A", 1, "A declares these names twice: k."),
        ("furlong.py:A", 1, "x of A has a wrong unit: 'furlong' is not a product of coherent SI units"),
        ("needs.py:A", 1, "<class 'needs.A'> cannot be built: A.__init__() missing 1 required"),
        ("greek.py:Größe", 1, "the class Größe needs a name of the letters A to Z, digits and _."),
        ("mine.py:Drive mine.py:Drive", 2, "Drive would be written twice to the same file."),
        ("mine.py:Drive --flavour python --platform win64", 2, "FMUs of the flavour python contain"),
        ("mine.py:Drive --flavour cobol", 2, "argument --flavour: invalid choice: 'cobol'"),
        ("mine.py:Drive --platform vax", 2, "argument --platform: invalid choice: 'vax'"),
        ("mine.py:Drive --output helper.py", 2, "the FMU 'helper.py/Drive.fmu' cannot be written: "),
        ("deep.py:A --flavour python", 1, "uses_numpy imports numpy; a block may import the standard"),
        ("", 2, "the following arguments are required: FILE.py:BLOCK"),
    ],
)
def test_invalid_arguments_give_one_message(
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: str, code: int, sentence: str
) -> None:
    block = "class A(fmublock.Block):\n    "
    method = "y = fmublock.Output()\n    def outputs(self, v): return {'y': 1.0}\n"
    k = "fmublock.Parameter(name='k')"
    texts = {
        "syntax.py": "x = 1\ny = (\n",
        "imports_syntax.py": "import syntax\n",
        "import.py": "import nowhere\n",
        "exits.py": "import sys\nsys.exit(3)\n",
        "units.py": f"import fmublock\n{block}x = fmublock.State(1, unit='m')\n",
        "furlong.py": f"import fmublock\n{block}x = fmublock.Input(unit='furlong')\n",
        "twice.py": f"import fmublock\n{block}a = {k}\n    b = {k}\n",
        "needs.py": f"import fmublock\n{block}def __init__(self, gain): pass\n",
        "greek.py": "import fmublock\nclass Größe(fmublock.Block): pass\n",
        "uses_numpy.py": "import numpy\n",
        "deep.py": f"import fmublock, uses_numpy\n{block}{method}",
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    (folder / "binary.py").write_bytes(b"\0\1\2")
    try:
        status = main(["build", *arguments.split()])
    except SystemExit as ended:
        status = int(ended.code or 0)
    errors = capsys.readouterr().err
    assert status == code, errors
    assert errors.startswith(f"Error: {sentence}")
    assert errors.count("\n") == 1 and errors.endswith("\n")


class Tuned(Block):
    """A block with an attribute that is not a variable."""

    u = Input()

    def __init__(self, gain: float = 1.0) -> None:
        self.gain = gain


def local() -> type[Block]:
    class Local(Block):
        u = Input()

    return Local


@pytest.mark.parametrize(
    ("block", "options", "message"),
    [
        (Block, {}, "is not a block; derive a class from"),
        ("mine.py:Drive", {}, "is not a block; derive a class from"),
        (Tuned, {"flavour": "cobol"}, "the flavour 'cobol' is not supported; choose from native, python"),
        (Tuned, {"platforms": ["vax"]}, "the platform 'vax' is not supported; choose from linux64, win64"),
        (Tuned, {"flavour": "python", "platforms": ["linux64"]}, "omit the platforms"),
        (local(), {"flavour": "python"}, "Local is not defined at the top of a Python file"),
        (Tuned(2.0), {"flavour": "python"}, "this Tuned has the attributes gain, which would be missing"),
    ],
)
def test_invalid_arguments_in_python_are_refused(
    tmp_path: Path, block: Any, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(BuildError, match=message):
        build(block, tmp_path / "x.fmu", **options)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize("flavour", ["native", "python"])
def test_script_may_contain_the_block_and_build_it(folder: Path, flavour: str) -> None:
    text = dedent(DRIVE).replace("import Block,", "import Block, Instance, build,")
    text += f"\n\nif __name__ == '__main__':\n    print(build(Drive, 'Drive.fmu', flavour='{flavour}'))\n"
    (folder / "script.py").write_text(text)
    run = subprocess.run([sys.executable, "script.py"], capture_output=True, text=True, check=False)
    assert (run.stdout, run.stderr) == ("Drive.fmu\n", "")
    assert speed(folder / "Drive.fmu") == pytest.approx(2.0 * (1.0 - np.exp(-0.6)), rel=1e-10)


def test_module_of_a_package_is_loaded_as_such() -> None:
    block = load_block(str(ROOT / "src" / "emla_fmu" / "plant.py") + ":EmlaPlant")
    assert block.__module__ == "emla_fmu.plant"
    assert block is not sys.modules["emla_fmu.plant"].EmlaPlant


def test_loading_leaves_the_interpreter_as_it_was(folder: Path) -> None:
    before, modules = list(sys.meta_path), dict(sys.modules)
    load_block("mine.py:Drive")
    with pytest.raises(LoadError):
        load_block("mine.py:Nothing")
    assert sys.meta_path == before
    assert {n for n in sys.modules.keys() - modules.keys() if n in ("mine", "helper")} == set()


def test_importing_fmublock_imports_no_large_package() -> None:
    heavy = ("casadi", "matplotlib", "pythonfmu", "numpy", "fmpy", "filelock")
    code = f"import fmublock, sys; fmublock.Instance; print([m for m in {heavy} if m in sys.modules])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout == "[]\n"


def test_related_files_are_listed_with_their_roles(folder: Path) -> None:
    text = "time,y\n0,1\n"
    related = [RelatedFile("a&b_ref.csv", text, "result", "text/csv", 'A "result" of 1 < 2')]
    second_block, related_folder = load_block("mine.py:Other"), "extra/org.fmi-standard.fmi-ls-ref"
    with zipfile.ZipFile(
        build(second_block, "with.fmu", flavour="python", documents=Documents(related=related))
    ) as archive:
        assert archive.read(f"{related_folder}/a&b_ref.csv").decode() == text
        root = ElementTree.fromstring(archive.read(f"{related_folder}/fmi-ls-manifest.xml"))
    space = "{http://fmi-standard.org/fmi-ls-manifest}"
    assert root.tag == "fmiReferences" and root.get(f"{space}fmi-ls-name") == related_folder.partition("/")[2]
    assert [element.attrib for element in root] == [
        {"type": "text/csv", "source": "a&b_ref.csv", "role": "result", "description": 'A "result" of 1 < 2'}
    ]
    with zipfile.ZipFile(build(second_block, "without.fmu", flavour="python")) as archive:
        assert not [name for name in archive.namelist() if name.startswith("extra")]


def test_changed_sources_run_as_they_are(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also if they change within a second and keep their size, as bytecode beside them would not tell."""
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    package = tmp_path / "parts"
    package.mkdir()
    (package / "__init__.py").touch()
    (tmp_path / "own.py").write_text(
        "from fmublock import Block, Parameter\nfrom gain import A\nfrom parts.more import B\n\n\n"
        "class Own(Block):\n    k = Parameter(A + B)\n"
    )
    starts = []
    for a, b in ((1.0, 2.0), (3.0, 4.0)):
        for path, text in ((tmp_path / "gain.py", f"A = {a}\n"), (package / "more.py", f"B = {b}\n")):
            path.write_text(text)
            os.utime(path, (1e9, 1e9))
        starts.append(load_block(f"{tmp_path / 'own.py'}:Own").k.start)
    assert starts == [3.0, 7.0]
    assert not list(tmp_path.rglob("__pycache__"))
