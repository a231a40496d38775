"""What all tools share: a process of its own reads a job, runs it and writes down how long it took."""

import json
import os
import sys
from collections.abc import Callable, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

from ..job import Job, load_job


class Measurement(NamedTuple):
    """Wall time in s of `steps` steps, without initialization; all signals at the end of the job."""

    seconds: float
    steps: int
    signals: Sequence[float]


def main(measure: Callable[[Job], Measurement], package: str = "") -> None:
    """Run `python -m benchmarks.tools.<tool> JOB RESULT [one-core]`: both are JSON files.

    With `one-core` all threads share one core. The result holds what was measured and the version of the
    package, or as `problem` why nothing was.
    """
    job, result = Path(sys.argv[1]), Path(sys.argv[2])
    try:
        if "one-core" in sys.argv:
            os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
        version_entry = {"version": f"{package} {version(package)}"} if package else {}
        content = measure(load_job(job))._asdict() | version_entry
    except Exception as error:  # the tools raise whatever they like
        content = {"problem": f"{type(error).__name__}: {error}"}
    result.write_text(json.dumps(content), encoding="utf-8")
