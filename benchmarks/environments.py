"""Python environments: this one, and separate ones for packages that cannot be installed in it."""

import subprocess
import sys
from pathlib import Path

from .errors import BenchmarkError

FOLDER = Path(__file__).parent / ".environments"
_PIP = ("-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--retries", "1", "--timeout", "20")


def python_for(requirement: str) -> Path:
    """Return the interpreter for a requirement: this one if it is empty, else that of an environment.

    Raises:
        BenchmarkError: The environment cannot be set up.
    """
    if not requirement:
        return Path(sys.executable)
    folder = FOLDER / requirement
    python = folder / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")
    marker = folder / "installed"
    if not marker.exists():
        _run(sys.executable, "-m", "venv", "--clear", str(folder))
        _run(str(python), *_PIP, requirement)
        marker.touch()
    return python


def _run(*command: str) -> None:
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    if run.returncode != 0:
        lines = [line for line in run.stderr.splitlines() if line.startswith("ERROR")] or ["no reason given"]
        raise BenchmarkError(f"its environment cannot be set up: {lines[-1]}")
