"""Run a compiler on the sources of an FMU."""

import os
import subprocess
from collections.abc import Sequence
from pathlib import Path


def run_compiler(
    command: Sequence[str], scratch: Path, seconds: float | None = None
) -> "subprocess.CompletedProcess[str]":
    """Run a compiler. Raise OSError if it cannot be run, and TimeoutExpired after a time in s.

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
