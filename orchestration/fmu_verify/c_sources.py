"""The C sources of an FMU: what its build description says, and compilers."""

import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from emla_cosim.base.untrusted_xml import parse_xml

from .subject import Subject

BUILD_DESCRIPTION = "sources/buildDescription.xml"
NO_COMPILER = "There is no compiler here: neither `cc` nor the extra 'build' is installed."


def read_build_description(subject: Subject) -> Any:
    """Return the root element of the build description; None if there is none.

    Raises:
        SyntaxError: It is not XML.
    """
    path = subject.folder / BUILD_DESCRIPTION
    return parse_xml(path.read_bytes()) if path.is_file() else None


def list_source_files(subject: Subject) -> list[str]:
    """Return the names of source files to compile; none if the build description cannot be read."""
    if subject.version == 2:
        return [e.get("name") for e in subject.tree.iterfind(".//SourceFiles/File")]
    try:
        root = read_build_description(subject)
    except SyntaxError:
        return []
    return [] if root is None else [e.get("name") for e in root.iterfind(".//SourceFile")]


def find_machine_compiler() -> tuple[str, ...]:
    """Return the command of this machine's C compiler; empty without one."""
    path = shutil.which("cc")
    return (path,) if path else ()


def find_zig() -> tuple[str, ...]:
    """Return the command of the compiler that the extra 'build' brings; empty without it."""
    return (sys.executable, "-m", "ziglang", "cc") if find_spec("ziglang") else ()


def run_compiler(
    command: Sequence[str], scratch: Path, seconds: float | None = None
) -> "subprocess.CompletedProcess[str]":
    """Run a compiler and return its process, also if it fails. `seconds` limits the time.

    Raise OSError if it cannot be run, and TimeoutExpired after the limit.

    Its temporary files are in the folder `scratch`, which the caller removes, even if the compiler crashes.
    """
    return subprocess.run(
        command,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
        timeout=seconds,
        env={**os.environ, "TMPDIR": str(scratch)},
    )


def find_inside(folder: Path, name: str) -> Path | None:
    """Return a file of a folder, or None if it does not exist or is outside."""
    path = (folder / name).resolve() if "\0" not in name else folder
    return path if path.is_relative_to(folder.resolve()) and path.is_file() else None
