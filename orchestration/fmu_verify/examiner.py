"""The process that examines files, and systems of FMUs as far as it must know them.

Checks fork from it. It has no threads and few modules loaded, whatever the caller has.
"""

import gc
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, closing
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

from emla_cosim.base.channel import Channel
from emla_cosim.base.errors import RunError, find_machine_fault
from emla_cosim.fmu.instance import CLASSES, read_signatures

from .check import Check
from .check_runner import CheckRunner
from .confinement import confine_signals, list_confinement_gaps
from .examination import examine_fmu, find_objections
from .findings import Examined, Finding
from .host.process_state import adopt_orphans, end_children
from .settings import Settings
from .subject import Subject, WholeSystem


@dataclass(frozen=True)
class SystemKind:
    """Files with systems of FMUs, and how to verify them. Its functions are those of a module.

    Attributes:
        suffixes: The suffixes of the files: `.ssp`.
        unpack: Returns the FMUs of a file, which exist as long as the context does.
        runs: The check of a `WholeSystem` without an earlier run.
        agrees: The check that compares it with an earlier run.
    """

    suffixes: tuple[str, ...]
    unpack: Callable[[Path], AbstractContextManager[Sequence[Path]]]
    runs: Check
    agrees: Check

    def select_check(self, settings: Settings) -> Check:
        """Return the check that the settings ask for."""
        return self.runs if settings.reference is None else self.agrees


def examine_system(
    path: Path, kind: SystemKind, settings: Settings, scratch: Path, progress: Callable[[Finding], None]
) -> Examined:
    """Run a system in a scratch folder. Compare it with an earlier run if the settings name one."""
    start = time.monotonic()
    with closing(CheckRunner(WholeSystem(path, settings, scratch), settings)) as runner:
        finding = runner.run(kind.select_check(settings))
    progress(finding)
    return Examined(
        path,
        {},
        (finding,),
        time.monotonic() - start,
        objections=find_objections((finding,), settings),
        not_examined=tuple(list_confinement_gaps()),
    )


# modules that checks load: once, before forks
_PRELOADED_MODULES = ("lief", "numpy.ma", "numpy.random", "encodings.cp437", "importlib.resources.readers")


class ExaminerJob(NamedTuple):
    """A file to examine, an FMU or a system; its name in reports, and its path as the user wrote it.

    `earlier_findings` has the findings of an examiner that ended before it was done.
    """

    path: Path
    settings: Settings
    name: str
    requested_path: Path
    system: SystemKind | None = None
    earlier_findings: tuple[Finding, ...] = ()


def examine_jobs(channel: Channel, folder: str) -> None:
    """Examine the files of the jobs that arrive.

    Args:
        channel: Gets each finding as soon as its check is done, and then the report or an error.
        folder: The folder for temporary files.
    """
    for module in _PRELOADED_MODULES:
        import_module(module)
    for fmu_class in CLASSES.values():
        read_signatures(fmu_class)  # remembers them
    confine_signals()
    adopt_orphans()
    gc.freeze()  # forks then share memory that they only read
    tempfile.tempdir = folder
    for job in channel.requests():
        answer = _examine(job, channel.send)
        end_children()  # those of FMUs that lead sessions of their own
        channel.send(answer)


def _examine(job: ExaminerJob, on_finding: Callable[[Finding], None]) -> Examined | RunError:
    """Return the findings of a job, or an error if this machine has no space or memory for it."""
    try:
        with tempfile.TemporaryDirectory(prefix="emla-verify-", ignore_cleanup_errors=True) as name:
            folder = Path(name).resolve()
            if job.system is not None:
                return examine_system(job.path, job.system, job.settings, folder, on_finding)
            subject = Subject(job.path, folder / "fmu", job.settings)
            return examine_fmu(subject, on_finding, job.earlier_findings)
    except Exception as error:
        if (fault := find_machine_fault(error)) is None:
            raise
        return RunError(f"'{job.name}' could not be verified on this machine: {fault.strerror}.")
