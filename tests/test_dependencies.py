"""What is imported is declared in pyproject.toml, and what is declared is used."""

import ast
import re
import sys
import tomllib
from collections.abc import Iterable
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
OURS = {"fmublock", "emla_fmu", "rsba_fmu", "hdrm_fmu", "emla_cosim"}
EXECUTED = {"ziglang"}
"""Declared for a program that is started, not imported: `python -m ziglang`."""

FOR_DASK = {"cryptography"}
"""Declared for Dask, which has its encrypted connections only with it."""


def sources() -> list[Path]:
    return [file for folder in ("src", "orchestration") for file in (ROOT / folder).rglob("*.py")]


def imported(files: Iterable[Path]) -> dict[str, Path]:
    """Top-level packages that are imported anywhere, also inside functions, and a file that does it."""
    found: dict[str, Path] = {}
    for file in files:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                names = [node.module or ""]
            else:
                continue
            found |= {name.partition(".")[0]: file for name in names}
    return {n: f for n, f in found.items() if n not in sys.stdlib_module_names and n not in OURS}


def normalized(requirement: str) -> str:
    """The name of a distribution as PyPI compares it, without versions and markers."""
    (name,) = re.findall(r"^[\w.-]+", requirement)
    return re.sub(r"[-_.]+", "-", name).lower()


OPTIONAL = [r for extra in ("pandas", "pytest") for r in PROJECT["optional-dependencies"][extra]]
"""What is imported only where somebody asks for it by name, or which imports what it finds of ours."""

DECLARED = {normalized(requirement) for requirement in (*PROJECT["dependencies"], *OPTIONAL)}
PROVIDERS = {
    package: {normalized(d) for d in distributions}
    for package, distributions in packages_distributions().items()
}
"""Distributions by the packages that they install."""


def undeclared(files: Iterable[Path]) -> dict[str, Path]:
    """Imported packages of which no distribution is declared."""
    return {
        package: file
        for package, file in imported(files).items()
        if DECLARED.isdisjoint(PROVIDERS.get(package, {package}))
    }


def test_what_is_imported_is_declared() -> None:
    assert undeclared(sources()) == {}


def test_what_is_declared_is_used() -> None:
    files = sources()
    used = {d for package in imported(files) for d in PROVIDERS.get(package, {package})}
    assert DECLARED - used == EXECUTED | FOR_DASK
    words = {
        node.value
        for file in files
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }
    assert words >= EXECUTED


def test_an_import_that_nobody_declares_is_found(tmp_path: Path) -> None:
    """Also one inside a function, and not those of the standard library or of the same package."""
    file = tmp_path / "module.py"
    file.write_text(
        "import os\nfrom . import x\ndef f():\n    from nobody.has import this\n", encoding="utf-8"
    )
    assert undeclared([file]) == {"nobody": file}


@pytest.mark.parametrize(
    ("requirement", "name"),
    [("pyssp_standard>=0.9.1", "pyssp-standard"), ("tbb>=2021; sys_platform == 'linux'", "tbb")],
)
def test_names_of_requirements(requirement: str, name: str) -> None:
    assert normalized(requirement) == name
