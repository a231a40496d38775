"""The C program loop.c: compiled by the C compiler that PyPI's ziglang brings, told by a plan what to run."""

import subprocess
import sys
from importlib.resources import files
from pathlib import Path

from ..job import Job
from .worker import Measurement, main

_FOLDER = Path(__file__).parents[1]
_HEADERS = _FOLDER.parent / "tests" / "support" / "c_host"
_FLAGS = ["-std=c11", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror"]


def measure(job: Job) -> Measurement:
    """Run the job in a process without Python."""
    return run_loop(job)


def run_loop(job: Job, *options: str, clock: str = "decimal") -> Measurement:
    """Run the program; `replay` as an option gives the time of the FMUs' own calls.

    `clock` selects how the time is computed for FMUs; see `registry.Tool`.
    """
    scratch = Path(job.scratch)
    plan = scratch / "loop.plan"
    plan.write_text(_plan(job, clock), encoding="utf-8")
    command = [compiled_loop(scratch), plan, str(job.steps), str(job.every), *options]
    output = _run(command)
    seconds, *signals = map(float.fromhex, output.split())
    return Measurement(seconds, job.steps, signals)


def compiled_loop(folder: Path) -> Path:
    """The program in this folder, compiled once."""
    program = folder / "loop"
    if not program.exists():
        includes = ["-I", str(_HEADERS), "-I", str(files("fmpy").joinpath("c-code"))]
        source = str(_FOLDER / "loop.c")
        command = [sys.executable, "-m", "ziglang", "cc", *_FLAGS, *includes, source, "-o", str(program)]
        _run(command)
    return program


def _run(command: list) -> str:
    process = subprocess.run(command, capture_output=True, text=True, check=False)
    if process.returncode != 0:
        raise RuntimeError(process.stderr.strip() or f"the exit code is {process.returncode}")
    return process.stdout


def _plan(job: Job, clock: str) -> str:
    lines = [f"time {job.step.hex()} {job.stop.hex()} {clock}"]
    for c in job.components:
        resources = (Path(c.folder) / "resources").as_uri()
        lines.append(f"component {c.name} {c.guid} {resources} {c.library}")
        lines += [f"{v.type.lower()} {v.reference} {float(v.value).hex()}" for v in c.start_values]
        lines += [f"input {v.reference} {v.signal}" for v in c.inputs]
        lines += [f"output {v.reference}" for v in c.outputs]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main(measure)
