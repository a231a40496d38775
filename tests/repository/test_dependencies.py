"""What is imported is declared in pyproject.toml, and what is declared is used."""

import ast
import json
import os
import re
import sys
import tomllib
from collections.abc import Iterable
from functools import cache
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
import yaml

from docs.weight import PARTS
from emla_cosim.base.extras import EXTRAS
from emla_cosim.cli.app import COMMANDS
from tests.support.paths import ROOT
from tests.support.processes import run

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
OURS = {"fmublock", "emla_fmu", "rsba_fmu", "machine_fmu", "emla_cosim", "fmu_verify"}
BY_NAME = {"yourdfpy", "ziglang"}
"""Declared, but not in an import statement: `python -m ziglang` is started, and yourdfpy imported by name."""


def sources() -> list[Path]:
    return [file for folder in ("src", "orchestration") for file in (ROOT / folder).rglob("*.py")]


def imported(files: Iterable[Path]) -> dict[str, Path]:
    """Top-level packages that are imported anywhere, also inside functions, and a file that does it."""
    files_by_package: dict[str, Path] = {}
    for file in files:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                names = [node.module or ""]
            else:
                continue
            files_by_package |= {name.partition(".")[0]: file for name in names}
    return {n: f for n, f in files_by_package.items() if n not in sys.stdlib_module_names and n not in OURS}


def normalized(requirement: str) -> str:
    """The name of a distribution as PyPI compares it, without versions and markers."""
    (name,) = re.findall(r"^[\w.-]+", requirement)
    return re.sub(r"[-_.]+", "-", name).lower()


OPTIONAL = [r for extra in (*EXTRAS, "pytest") for r in PROJECT["optional-dependencies"][extra]]
"""What only some commands import, or what imports what it finds of ours."""

DECLARED = {normalized(requirement) for requirement in (*PROJECT["dependencies"], *OPTIONAL)}


@cache
def providers() -> dict[str, set[str]]:
    """Distributions by the packages that they install."""
    return {
        package: {normalized(d) for d in distributions}
        for package, distributions in packages_distributions().items()
    }


def undeclared(files: Iterable[Path]) -> dict[str, Path]:
    """Imported packages of which no distribution is declared."""
    return {
        package: file
        for package, file in imported(files).items()
        if DECLARED.isdisjoint(providers().get(package, {package}))
    }


@pytest.mark.slow
def test_imported_packages_are_declared() -> None:
    assert undeclared(sources()) == {}


@pytest.mark.slow
def test_declared_packages_are_used() -> None:
    files = sources()
    used = {d for package in imported(files) for d in providers().get(package, {package})}
    assert DECLARED - used == BY_NAME
    words = {
        node.value
        for file in files
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
    }
    assert words >= BY_NAME


def test_base_is_small_and_extras_match_messages() -> None:
    assert len(PROJECT["dependencies"]) <= 20
    declared = PROJECT["optional-dependencies"]
    for extra, packages in EXTRAS.items():
        assert sorted(map(normalized, declared[extra])) == sorted(packages)
    assert declared["all"] == [f"emla-cosim[{','.join(EXTRAS)}]"]


def test_every_requirement_has_a_part_that_needs_it() -> None:
    listed = [name for part in PARTS.values() for name in part]
    assert sorted(listed) == sorted({normalized(r) for r in PROJECT["dependencies"]})


def test_the_citation_is_of_this_version() -> None:
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert (cited["cff-version"], cited["version"]) == ("1.2.0", PROJECT["version"])
    assert {"message", "title", "authors"} <= set(cited)  # what the format demands
    assert cited["license"] == PROJECT["license"].split(" AND ")
    for reference in cited["references"]:
        assert {"type", "title", "authors"} <= set(reference)


HEAVY = {
    *("bokeh", "casadi", "cma", "dask", "jinja2", "lief"),
    *("matplotlib", "networkx", "pandas", "scipy"),
}
"""Packages that take long to import, or much memory."""

IMPORTED_AT_ONCE = {
    "compare": {"networkx"},
    "identify": {"scipy"},
    "trajectory": {"casadi", "scipy"},
}
"""Those that a command takes with it before it does anything; the others none."""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="Windows has no `fork`.")
def test_commands_import_only_what_they_need() -> None:
    process = run(sys.executable, "-c", _IMPORTED, *COMMANDS, check=True)
    imported = {command: set(modules) & HEAVY for command, modules in json.loads(process.stdout).items()}
    assert imported == {command: IMPORTED_AT_ONCE.get(command, set()) for command in COMMANDS}


_IMPORTED = """
import importlib, json, os, sys
from tests.support.paths import ROOT

found = {}
for command in sys.argv[1:]:
    out, into = os.pipe()
    if os.fork() == 0:
        importlib.import_module(f"emla_cosim.cli.commands.{command}")
        os.write(into, json.dumps([m for m in sys.modules if "." not in m]).encode())
        os._exit(0)
    os.close(into)
    with os.fdopen(out) as stream:
        found[command] = json.load(stream)
    os.wait()
print(json.dumps(found))
"""
"""Which modules each command needs, in a process of its own that has nothing yet."""
