"""Every example in a docstring of a public name works as it is shown."""

import doctest
import re
from importlib.metadata import version
from pathlib import Path
from types import ModuleType

import pytest

import emla_cosim as ec
import emla_fmu
import fmublock
import rsba_fmu
from tests.support.paths import ROOT
from tests.support.tiers import mostly_slow

PACKAGES: list[ModuleType] = [ec, fmublock, emla_fmu, rsba_fmu]


def examples() -> dict[str, doctest.DocTest]:
    """Examples by where they are: in a package, in a public name or in its methods."""
    finder, actual = doctest.DocTestFinder(exclude_empty=True), {}
    for package in PACKAGES:
        public = {name: getattr(package, name) for name in package.__all__ if not name.startswith("_")}
        if package is fmublock:
            public |= {name: getattr(package, name) for name in fmublock._LATER}
        parsed = doctest.DocTestParser().get_doctest(package.__doc__ or "", {}, package.__name__, None, None)
        tests = [parsed, *(t for name, member in public.items() for t in finder.find(member, name, globs={}))]
        actual |= {f"{package.__name__}.{t.name}": t for t in tests if t.examples}
    return actual


EXAMPLES = examples()
SLOW = {"fmublock.build", *(f"emla_cosim.{n}" for n in ("identify", "compare", "tune", "Input", "sweep"))}


@pytest.mark.parametrize("name", mostly_slow(EXAMPLES, EXAMPLES.keys() - SLOW))
def test_docstring_example(
    name: str,
    fmu_folder: Path,
    on_one_cluster: None,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "fmus").symlink_to(fmu_folder)
    monkeypatch.chdir(tmp_path)
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    assert runner.run(EXAMPLES[name]).failed == 0, capsys.readouterr().out


def test_public_names_are_documented() -> None:
    pages = "".join(page.read_text(encoding="utf-8") for page in (ROOT / "docs/api").glob("*.md"))
    listed = {name.rpartition(".")[2] for name in re.findall(r"^::: (\S+)", pages, re.MULTILINE)}
    public = {name for package in PACKAGES for name in package.__all__}
    assert public - listed == {"BLOCKS"}
    assert {"Progress", "Network", "Link", "FmuInstance"} <= public  # for extensions
    assert ec.__version__ == version("emla-cosim")
