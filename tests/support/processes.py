"""The `emla` command in a process of its own, as a person calls it."""

import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path


def start(
    folder: Path, *arguments: object, code: str = "", environment: Mapping[str, str] | None = None
) -> subprocess.Popen[str]:
    """Start a command in a folder, with its temporary files in the folder `temporary` there.

    `code` runs before the command, in its process: it can make the command slow, or a call fail.
    """
    (folder / "temporary").mkdir(exist_ok=True)
    program = f"{code}\nfrom emla_cosim.cli.program import main; main()"
    return subprocess.Popen(
        [sys.executable, "-c", program, *map(str, arguments)],
        cwd=folder,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**os.environ, "TMPDIR": str(folder / "temporary"), **(environment or {})},
    )
