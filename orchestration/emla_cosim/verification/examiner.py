"""The process that examines FMUs: reads what to examine, and answers with progress and findings.

It is a process of its own, so that checks can divide from one that has no threads and has loaded
little, whatever the caller did before.
"""

import gc
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from ..sandbox.server import serve
from .examination import examine_fmu
from .findings import Examined
from .settings import Settings
from .subject import Subject
from .system_examination import examine_system


class ExaminerJob(NamedTuple):
    """A file to examine, an FMU or a system of them; what reports call it, and its path as it was given."""

    path: Path
    settings: Settings
    name: str
    given: Path
    system: bool = False


def main() -> None:
    """Serve the parent at the other end of standard input and output; temporary files go into its folder."""
    import lief  # noqa: F401  # slow to load: once, before processes divide

    gc.freeze()  # so that processes that divide from this one do not copy what they only look at
    tempfile.tempdir = sys.argv[1]
    serve(_examine)


def _examine(job: ExaminerJob, tell: Callable[[str], None]) -> Examined:
    if job.system:
        return examine_system(job.path, job.settings, tell)
    with tempfile.TemporaryDirectory(prefix="emla-verify-") as folder:
        subject = Subject(job.path, Path(folder).resolve() / "fmu", job.settings)
        return examine_fmu(subject, tell)


if __name__ == "__main__":
    main()
