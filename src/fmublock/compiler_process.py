"""Run a command that ends together with the process that needs it, even if that is killed.

It has a process group of its own: `python -m fmublock.compiler_process PARENT COMMAND...`.
"""

import os
import signal
import subprocess
import sys

_CHECK_INTERVAL = 0.2
"""Seconds between two checks that the parent is alive."""


def main() -> None:
    """Run the command, and exit with its exit code."""
    parent, *command = sys.argv[1:]
    with subprocess.Popen(command) as compiler:
        while os.name == "nt" or os.getppid() == int(parent):
            try:
                sys.exit(compiler.wait(_CHECK_INTERVAL))
            except subprocess.TimeoutExpired:
                continue
        os.killpg(0, signal.SIGKILL)


if __name__ == "__main__":
    main()
