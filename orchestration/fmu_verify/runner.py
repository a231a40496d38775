"""Verify files with an examiner process for each core, and one more."""

import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import ExitStack, suppress
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from emla_cosim.base.channel import POLL_INTERVAL
from emla_cosim.base.errors import CommandError, RunError, check_choice
from emla_cosim.base.files import temporary_folder
from emla_cosim.base.process import Child, ChildEndedError, ChildPool, count_cores
from emla_cosim.base.progress import Progress
from emla_cosim.base.tolerances import Tolerance
from emla_cosim.base.values import convert_value

from .check import RETURNS, Check, Verdict, failed
from .check_runner import make_finding
from .examination import (
    Strictness,
    check_names,
    find_objections,
    list_unselected,
    select_checks,
    select_needed_checks,
)
from .examiner import ExaminerJob, SystemKind, examine_jobs
from .findings import Examined, Finding, list_options
from .references.recording import check_recording
from .report import Report
from .settings import Recording, Settings


def verify(
    paths: str | Path | Sequence[str | Path] | Mapping[str, str | Path],
    *,
    reference: str | Path | None = None,
    only: Sequence[str] = (),
    skip: Sequence[str] = (),
    tolerance: float | Mapping[str, Tolerance | float] | None = None,
    seconds: float = Settings.seconds,
    memory: float = Settings.memory / 2**20,
    record: Recording | None = None,
    fail_on: Sequence[str] = (),
    must_run: Sequence[str] = (),
    progress: Progress | None = None,
    interrupted: Callable[[], bool] | None = None,
    systems: SystemKind | None = None,
) -> Report:
    """Check FMUs and systems of FMUs: do they follow the standard, and do they behave as before?

    Args:
        paths: FMU and SSP files; a mapping has them by the names that the report uses.
        reference: folder of reference files, for a system a folder of results. Default: the references of
            each FMU.
        only: names, groups or patterns of the checks to run. Default: all.
        skip: names, groups or patterns of checks to leave out.
        tolerance: deviation that is allowed, relative to the range of each signal: a number, or by name and
            pattern.
        seconds: time limit of each check, in s.
        memory: memory limit of each check, in MiB.
        record: record reference files instead of checking.
        fail_on: what makes an FMU fail in addition to failed checks: `"warning"`, `"skip"`.
        must_run: names, groups or patterns of checks that must not be skipped.
        progress: receives the number of finished checks.
        interrupted: called often; once it returns true, the report has what is finished until then, and is
            marked as not complete. Default: run all checks.
        systems: how to verify files with systems of FMUs; `emla_cosim.verify` knows SSPs. Default: FMUs only.

    Returns:
        The findings for each file.

    Raises:
        CommandError: a file does not exist, or an argument is wrong.
        RunError: the machine has no space or memory for it. All other problems are findings.
    """
    paths_by_name = _name_paths(paths, systems)
    settings = _make_settings(reference, only, skip, tolerance, seconds, memory, record, fail_on, must_run)
    progress = progress or Progress()
    with ExitStack() as resources:
        jobs = [
            job
            for name, path in paths_by_name.items()
            for job in _make_jobs(name, path, settings, systems, resources)
        ]
        if record is not None:
            check_recording(record, [job.path for job in jobs])
        count = sum(len(_list_checks(job)) for job in jobs)
        progress.begin("verifying", count, "checks")
        folder = resources.enter_context(temporary_folder("verify"))
        examined, is_complete = examine_all(jobs, folder, lambda: progress.advance(1), interrupted)
    started = datetime.now(UTC).isoformat(timespec="seconds")
    return Report(examined, version("emla-cosim"), started, complete=is_complete)


def _name_paths(
    paths: str | Path | Sequence[str | Path] | Mapping[str, str | Path], systems: SystemKind | None
) -> dict[str, Path]:
    """Return the files of paths and folders by their names in reports. Raise CommandError without a file."""
    if isinstance(paths, (str, Path)):
        paths = [paths]
    requested = paths if isinstance(paths, Mapping) else {str(path): path for path in paths}
    requested = {name: path for item in requested.items() for name, path in _expand_folder(*item, systems)}
    if not requested:
        raise CommandError("there is nothing to verify; name at least one FMU.")
    files = {name: convert_value(path, Path, "the FMU") for name, path in requested.items()}
    for path in files.values():
        with suppress(OSError, ValueError):  # invalid file names
            if path.is_file() or _is_system(path, systems):
                continue
        raise CommandError(f"the FMU file '{path}' does not exist.", path=str(path))
    return files


def _is_system(path: Path, systems: SystemKind | None) -> bool:
    return systems is not None and path.suffix.lower() in systems.suffixes


def _expand_folder(name: str, path: str | Path, systems: SystemKind | None) -> list[tuple[str, str | Path]]:
    """Return a path by its name; for a folder, all FMUs and packages in it and its subfolders.

    Raises:
        CommandError: The folder has none.
    """
    if not isinstance(path, (str, Path)):
        return [(name, path)]
    folder = Path(path)
    try:
        is_folder = folder.is_dir()
    except (OSError, ValueError):  # invalid file names
        is_folder = False
    if not is_folder or _is_system(folder, systems):
        return [(name, path)]
    suffixes = (".fmu", *(systems.suffixes[:1] if systems is not None else ()))
    files = sorted(f for f in folder.rglob("*") if f.suffix.lower() in suffixes and f.is_file())
    if not files:
        raise CommandError(f"the folder '{path}' has no FMU and no SSP.", path=str(path))
    return [(f"{name.rstrip('/')}/{f.relative_to(folder).as_posix()}", f) for f in files]


def _make_settings(
    reference: str | Path | None,
    only: Sequence[str],
    skip: Sequence[str],
    tolerance: float | Mapping[str, Tolerance | float] | None,
    seconds: float,
    memory: float,
    record: Recording | None,
    fail_on: Sequence[str],
    must_run: Sequence[str],
) -> Settings:
    """Return the settings for arguments of `verify`. Raise CommandError for invalid ones."""
    lists = {"only": only, "skip": skip, "must_run": must_run, "fail_on": fail_on}
    only, skip, must_run, fail_on = (
        convert_value([words] if isinstance(words, str) else list(words), Sequence[str], f"'{name}'")
        for name, words in lists.items()
    )
    check_names([*only, *skip, *must_run])
    for word in fail_on:
        check_choice("value of fail-on", word, list(Strictness))
    for name, value in (("seconds", seconds), ("memory", memory)):
        if not 0.0 < convert_value(value, float, f"'{name}'") < 1e9:
            raise CommandError(f"'{name}' is {value:g}; it must be greater than 0 and less than 1e9.")
    folder = None if reference is None else convert_value(reference, Path, "the reference")
    if folder is not None and not folder.exists():
        raise CommandError(f"the folder of references '{folder}' does not exist.")
    wide = {"*": tolerance} if isinstance(tolerance, (int, float)) else tolerance or {}
    settings = Settings(
        only=only,
        skip=skip,
        reference=folder.absolute() if folder is not None else None,
        tolerance=convert_value(wide, Mapping[str, Tolerance], "the tolerance"),
        seconds=float(seconds),
        memory=round(memory * 2**20),
        recording=record,
        fail_on=fail_on,
        must_run=must_run,
    )
    if left_out := list_unselected(must_run, select_checks(settings)):
        raise CommandError(f"'{left_out[0]}' must run, but `only` and `skip` leave it out.")
    if not select_checks(settings):
        raise CommandError("`only` and `skip` select no check.")
    return settings


def _make_jobs(
    name: str, path: Path, settings: Settings, systems: SystemKind | None, resources: ExitStack
) -> list[ExaminerJob]:
    """Return the jobs for a path: one for an FMU; for a system, one for each of its FMUs and itself.

    Raises:
        CommandError: References of a system are to be recorded, or it cannot be unpacked.
    """
    if systems is None or not _is_system(path, systems):
        return [ExaminerJob(path.absolute(), settings, name, path)]
    if settings.recording is not None:
        raise CommandError(f"only references of FMUs can be recorded; '{path}' is a system.")
    # a reference of a system is a folder of results, which is not one of its FMUs
    without_reference = replace(settings, reference=None)
    files = resources.enter_context(systems.unpack(path))
    inside = [ExaminerJob(file, without_reference, f"{name}/{file.name}", path / file.name) for file in files]
    return [*inside, ExaminerJob(path.absolute(), settings, name, path, systems)]


def examine_all(
    jobs: Sequence[ExaminerJob],
    folder: Path,
    advance: Callable[[], None] = lambda: None,
    interrupted: Callable[[], bool] | None = None,
) -> tuple[tuple[Examined, ...], bool]:
    """Examine files in several processes at once.

    Args:
        jobs: The files.
        folder: The folder for temporary files.
        advance: Called after each check.
        interrupted: Called often; once it returns true, no further check runs.

    Returns:
        The findings in the order of the jobs, and whether all checks ran.
    """
    pool = ChildPool(lambda: Child(examine_jobs, str(folder)))
    count = count_cores() + 1  # checks also wait, for example for the next second
    with ThreadPoolExecutor(min(count, len(jobs))) as threads:
        futures = [threads.submit(_examine, job, pool, advance) for job in jobs]
        pending = set(futures)
        try:
            while pending:
                finished, pending = wait(pending, POLL_INTERVAL)
                for future in finished:
                    future.result()
                if pending and not pool.is_closed and interrupted is not None and interrupted():
                    pool.close()
            is_complete = not pool.is_closed
        finally:
            pool.close()
            if pending:  # an error or a second Ctrl-C; checks notice it before their folder is removed
                time.sleep(2.0 * POLL_INTERVAL)
    return tuple(future.result() for future in futures), is_complete


def _examine(job: ExaminerJob, pool: ChildPool, advance: Callable[[], None]) -> Examined:
    """Return the findings of a job. If an FMU ends the examiner, a new one continues after the lost check."""
    findings: list[Finding] = []
    while not pool.is_closed:
        try:
            with pool.member() as examiner:
                examiner.send(job._replace(earlier_findings=tuple(findings)))
                while isinstance(answer := examiner.receive(), Finding):
                    findings.append(answer)
                    advance()
                if isinstance(answer, RunError):
                    raise answer
                options = list_options(job.settings)
                return replace(answer, path=job.requested_path, name=job.name, options=options)
        except ChildEndedError as error:
            if pool.is_closed:
                break
            names = {f.check for f in findings}
            lost_check = next((c for c in _list_checks(job) if c.name not in names), None)
            if lost_check is None:
                break
            message = f"It ended the process of emla verify that runs the checks ({error})."
            hint = "Look for signals that the FMU sends to other processes."
            findings.append(make_finding(lost_check, failed(message, clause=RETURNS, hint=hint)))
            advance()
    return _report_incomplete(job, findings)


def _report_incomplete(job: ExaminerJob, findings: Sequence[Finding]) -> Examined:
    """Return the findings about an FMU whose examiner ended; it does not pass if checks are missing."""
    count = len(_list_checks(job))
    selected = {c.name for c in (_list_checks(job) if job.system else select_checks(job.settings))}
    reported = tuple(f for f in findings if f.check in selected or f.verdict == Verdict.FAILED)
    objections = find_objections(reported, job.settings)
    if missing := count - len(findings):
        objections += (f"The examination was interrupted: {missing} of {count} checks did not run.",)
    seconds, options = sum(f.seconds for f in findings), list_options(job.settings)
    return Examined(job.requested_path, {}, reported, seconds, job.name, objections, options=options)


def _list_checks(job: ExaminerJob) -> list[Check]:
    """Return the checks that run for a job."""
    return [job.system.select_check(job.settings)] if job.system else select_needed_checks(job.settings)
