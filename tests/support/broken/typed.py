"""FMUs with variables of all types that do one thing wrong: a good one, in C, with a fault."""

import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from string import Template

import fmpy

from emla_cosim.verification.verdict import Verdict
from fmublock.archive import write_archive
from tests.support.broken.broken import Broken
from tests.support.handwritten_fmu import compile_library

_FOLDER = Path(__file__).parent
_GUID = "{7e9ed000-0000-4000-8000-000000000000}"
_STRUCTURE = {
    "y": "1 2 5 13",
    "sum": "8",
    "flag": "13",
    "initial_y": "1 2 5 13",
    "initial_sum": "8 9",
    "initial_flag": "13 14",
}
"""Dependencies of outputs, in Outputs and in InitialUnknowns, as they are."""


@cache
def _faults() -> dict[str, int]:
    """The numbers of the faults, by name, from the header that has them."""
    text = re.sub(r"/\*.*?\*/", "", (_FOLDER / "typed_faults.h").read_text(encoding="utf-8"))
    found = re.search(r"enum \{([^}]*)\}", text)
    assert found
    return {name.strip(): k for k, name in enumerate(found[1].split(","))}


def build_typed_fmu(folder: Path, fault: str = "NONE", name: str = "Typed", **structure: str) -> Path:
    """Build the FMU in a folder, with one fault, or with other dependencies than it has."""
    template = Template((_FOLDER / "typed.xml").read_text(encoding="utf-8"))
    path = folder / f"{name}.fmu"
    described = template.substitute({"name": name, "guid": _GUID, **_STRUCTURE, **structure})
    content = {
        "modelDescription.xml": described.encode(),
        f"binaries/{fmpy.platform}/{name}{fmpy.sharedLibraryExtension}": _library(fault == "OTHER_VERSION"),
        "documentation/index.html": b"<!doctype html><title>Typed</title><p>It does what it says.",
        "documentation/licenses/license.txt": b"Do what you want.",
        "resources/fault.txt": f"{_faults()[fault]}\n".encode(),
    }
    write_archive(path, content)
    return path


@cache
def _library(other_version: bool) -> bytes:
    """Compiled once, for all faults but that of the version."""
    version = '"1.0"' if other_version else "fmi2Version"
    return compile_library(_FOLDER / "typed.c", {"MODEL_GUID": f'"{_GUID}"', "COMPILED_VERSION": version})


def _built(fault: str, name: str, structure: dict[str, str]) -> Callable[[Path], Path]:
    return lambda folder: build_typed_fmu(folder, fault, name, **structure)


def _fails(fault: str, check: str, what: str) -> Broken:
    name = _named(fault)
    return Broken(name, what, check, _built(fault, name, {}))


def _warns(fault: str, check: str, what: str) -> Broken:
    name = _named(fault)
    return Broken(name, what, check, _built(fault, name, {}), verdict=Verdict.WARNING)


def _lacks(name: str, what: str, **structure: str) -> Broken:
    return Broken(name, what, "dependencies.observed", _built("NONE", name, structure))


def _named(fault: str) -> str:
    return "".join(word.capitalize() for word in fault.split("_"))


TYPED: list[Broken] = []
