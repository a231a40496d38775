"""Programs and the `emla` command in processes of their own."""

import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any


def run(
    *command: object, environment: Mapping[str, str] | None = None, **how: Any
) -> subprocess.CompletedProcess[str]:
    """Run a program to its end.

    Args:
        command: The program and its arguments.
        environment: More variables.
        how: More options of subprocess.run; both streams are caught.
    """
    options = {"text": True, "capture_output": True, "check": False, "env": os.environ | (environment or {})}
    return subprocess.run([*map(str, command)], **(options | how))


def start(
    folder: Path,
    *arguments: object,
    code: str = "",
    before: Sequence[str] = (),
    environment: Mapping[str, str] | None = None,
    **how: Any,
) -> subprocess.Popen[str]:
    """Start a command in a folder, with its temporary files in the folder `temporary` there.

    Args:
        folder: The current folder of the command.
        arguments: Those of `emla`.
        code: Runs before the command, in its process: it can make the command slow, or a call fail.
        before: A program that starts the command, with its arguments.
        environment: More variables.
        how: More options of Popen; both streams are pipes.
    """
    (folder / "temporary").mkdir(exist_ok=True)
    program = f"{code}\nfrom emla_cosim.cli.program import main; main()"
    return subprocess.Popen(
        [*before, sys.executable, "-c", program, *map(str, arguments)],
        cwd=folder,
        env={**os.environ, "TMPDIR": str(folder / "temporary"), **(environment or {})},
        **{"text": True, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **how},
    )


def call(folder: Path, *arguments: object, **how: Any) -> tuple[int, str, str]:
    """Do the same, and wait for its end; return the exit code and both streams."""
    process = start(folder, *arguments, **how)
    try:
        output, errors = process.communicate(timeout=300.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        raise
    return process.returncode, output, errors
