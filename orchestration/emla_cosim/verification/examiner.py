"""The examiner process: reads jobs, sends progress and findings.

Checks fork from it. It has no threads and few modules loaded, whatever the caller has.
"""

import gc
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from ..base.errors import RunError, find_machine_fault
from ..sandbox.server import serve
from .examination import examine_fmu
from .findings import Examined, Finding
from .settings import Settings
from .subject import Subject
from .system_examination import examine_system


class ExaminerJob(NamedTuple):
    """A file to examine, an FMU or a system; its name in reports, and its path as the user wrote it.

    `done` has the findings of an examiner that ended before it was done.
    """

    path: Path
    settings: Settings
    name: str
    given: Path
    system: bool = False
    done: tuple[Finding, ...] = ()


def main() -> None:
    """Serve the parent over standard input and output. The argument is the folder for temporary files."""
    import lief  # noqa: F401  # slow to load: once, before forks

    gc.freeze()  # forks then share memory that they only read
    tempfile.tempdir = sys.argv[1]
    serve(_examine)


def _examine(job: ExaminerJob, tell: Callable[[Finding], None]) -> Examined | RunError:
    try:
        return _examine_file(job, tell)
    except Exception as error:
        if (fault := find_machine_fault(error)) is None:
            raise
        return RunError(f"'{job.name}' could not be verified on this machine: {fault.strerror}.")


def _examine_file(job: ExaminerJob, tell: Callable[[Finding], None]) -> Examined:
    with tempfile.TemporaryDirectory(prefix="emla-verify-", ignore_cleanup_errors=True) as folder:
        if job.system:
            return examine_system(job.path, job.settings, Path(folder).resolve(), tell)
        subject = Subject(job.path, Path(folder).resolve() / "fmu", job.settings)
        return examine_fmu(subject, tell, job.done)


if __name__ == "__main__":
    main()
