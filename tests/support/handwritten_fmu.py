"""Builds FMUs that are written by hand: a C file and a modelDescription.xml beside it."""

import subprocess
import sys
import tempfile
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from string import Template

import fmpy

from fmublock.archive import content_guid, write_archive
from fmublock.platforms import TARGETS, host_platform

_FLAGS = ["-std=c11", "-O2", "-ffp-contract=off", "-fvisibility=hidden", "-fPIC", "-s"]
# the FMI says which parameters a function has, whether it needs them or not
_WARNINGS = ["-Wall", "-Wextra", "-Wno-unused-parameter"]


def build_handwritten_fmu(
    path: Path,
    source: Path,
    placeholders: Mapping[str, str] | None = None,
    macros: Mapping[str, int | str] | None = None,
    platform: str = fmpy.platform,
) -> Path:
    """Build the FMU for this machine, with the file's name as its model identifier.

    The model description has $name, $guid and what is in `placeholders`; the C file gets
    MODEL_GUID and what is in `macros`.
    """
    template = Template((source.parent / "modelDescription.xml").read_text(encoding="utf-8"))
    sources = {f.name: f.read_bytes() for f in sorted(source.parent.glob("*.[ch]"))}
    values = {"name": path.stem, **(placeholders or {})}
    draft = template.safe_substitute(values).encode()
    guid = content_guid({**sources, "modelDescription.xml": draft})
    library = compile_library(source, {"MODEL_GUID": f'"{guid}"', **(macros or {})})
    content = {
        "modelDescription.xml": template.substitute(values, guid=guid).encode(),
        f"binaries/{platform}/{path.stem}{fmpy.sharedLibraryExtension}": library,
    }
    write_archive(path, content)
    return path


def compile_library(source: Path, macros: Mapping[str, int | str]) -> bytes:
    """The shared library of one C file for this machine, with these macros defined."""
    headers = str(files("fmpy").joinpath("c-code"))
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder, f"{source.stem}{fmpy.sharedLibraryExtension}")
        target, _ = TARGETS[host_platform()]
        command = [sys.executable, "-m", "ziglang", "cc", "-target", target, "-shared", *_FLAGS, *_WARNINGS]
        command += [f"-D{name}={value}" for name, value in macros.items()]
        command += ["-I", headers, str(source), "-o", str(library)]
        command += [] if "windows" in target else ["-lm"]
        compiled = subprocess.run(command, capture_output=True, text=True, check=False)
        assert compiled.returncode == 0, compiled.stderr
        return library.read_bytes()
