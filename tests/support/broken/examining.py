"""FMUs examined in this process, as far as they do it no harm: processes cost more than all else."""

import faulthandler
import os
import tempfile
from collections.abc import Collection
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import lief  # noqa: F401  # once here, and not in each process of a check
import pytest

from emla_cosim.fmu.file import unpack
from fmu_verify import check_runner
from fmu_verify.catalogue import CHECKS, DYNAMIC
from fmu_verify.check import Check, CheckOutcome, Verdict, failed
from fmu_verify.check_runner import CheckRunner, do_check
from fmu_verify.confinement import prepare_writable_folders
from fmu_verify.examination import examine_fmu
from fmu_verify.findings import Examined
from fmu_verify.settings import Settings
from fmu_verify.subject import Subject
from fmu_verify.subprocess_run import ERROR_OF_CHECK, CheckProcess

CALLING = frozenset(c.name for c in CHECKS if c in DYNAMIC or c.group == "binaries")
"""Checks that load the library or call it."""


def examine(
    path: Path, *only: str, settings: Settings | None = None, apart: Collection[str] = CALLING
) -> Examined:
    """Examine an FMU.

    Args:
        path: The FMU.
        only: Checks, groups or patterns, with what they need. Default: those of the settings.
        settings: All other settings.
        apart: Checks that run in a process of their own.
    """
    settings = settings or Settings()
    settings = replace(settings, only=only or settings.only)
    tests, scratch = os.getpid(), check_runner.use_scratch

    def call(runner: CheckRunner, check: Check, seconds: float, memory: int) -> CheckOutcome:
        subject = runner.subject
        folders = prepare_writable_folders(subject)
        if check.name in apart:
            with closing(CheckProcess(_run_quietly, (subject, check), memory, folders)) as process:
                return process.call((), seconds)
        return _run_here(subject, check)

    with pytest.MonkeyPatch.context() as patch, tempfile.TemporaryDirectory() as folder:
        patch.setattr(CheckRunner, "call", call)
        # this process keeps its folders
        patch.setattr(check_runner, "use_scratch", lambda of: None if os.getpid() == tests else scratch(of))
        patch.chdir(path.parent)
        return examine_fmu(Subject(path, Path(folder).resolve() / "fmu", settings))


def unpacked(path: Path, settings: Settings | None = None) -> Subject:
    """Unpack an FMU beside its file, and return it as checks get it."""
    folder = path.parent / "unpacked" / "fmu"
    folder.parent.mkdir()
    unpack(path, folder)
    return Subject(path, folder.resolve(), settings or Settings(seconds=60.0))


def list_problems(examined: Examined) -> dict[str, str]:
    """Return the messages of checks that failed or warned, by name."""
    return {f.check: f.sentence for f in examined.findings if f.verdict in (Verdict.FAILED, Verdict.WARNING)}


def _run_here(subject: Subject, check: Check) -> CheckOutcome:
    """Return the outcome of a check; that it went wrong is no matter where what it needs has failed."""
    try:
        return do_check(subject, check)
    except Exception as error:
        return failed(f"{ERROR_OF_CHECK} {error!r}.")


def _run_quietly(subject: Subject, check: Check) -> CheckOutcome:
    """Return the outcome of a check whose process may crash, without the traceback that pytest prints."""
    faulthandler.disable()
    return do_check(subject, check)
