"""Check that an FMU leaves the process, the files and the streams of its host as they were."""

import os
import signal
import tempfile
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

from ..check import CheckOutcome, check, failed, passed, quote, skipped, warned
from ..host.experiment import make_experiment, run_instance
from ..host.hosted_instance import CallError, HostedInstance
from ..host.log import format_message
from ..host.process_state import (
    adopt_orphans,
    can_list_resources,
    count_resources,
    end_children,
    load_c_library,
    read_settings,
    wait_until_settled,
)
from ..messages import join_few_names, judge_problems
from ..subject import Subject
from ..subprocess_run import EndedError, in_fresh_process, is_single_instance, note

_STEPS = 10
_CYCLES = 3


def _run_steps(subject: Subject) -> HostedInstance:
    """Run an instance for some steps, terminate and free it."""
    instance = HostedInstance(subject)
    run_instance(instance, make_experiment(subject, _STEPS))
    instance.close()
    return instance


@check("process.resources", clause=quote("shared.freed"), needs=("run.completes",), time_factor=2.0)
def resources(subject: Subject) -> CheckOutcome:
    """Check that instances leave no open files, threads, child processes and temporary files behind."""
    if not can_list_resources():
        return skipped("This system does not list the resources of a process.")
    first, grown = in_fresh_process(_count_growth, subject)
    remaining = {name: count for name, count in first.items() if count > 0}
    leaks = [name for name, count in grown.items() if count >= _CYCLES]
    if remaining.get("processes"):
        message = "A process that an instance started runs on, or was not waited for, after it was freed."
        return failed(message)
    if leaks:
        return failed(f"Each instance leaves {join_few_names(leaks)} behind.", figures=dict(grown))
    if remaining:
        # not with each instance: pools of threads, and files of the library
        message = f"After an instance was freed, {join_few_names(list(remaining))} of the library remain."
        return warned(message)
    return passed("Instances leave no open files, threads, processes and temporary files behind.")


def _count_growth(subject: Subject) -> tuple[dict[str, int], dict[str, int]]:
    """Return how many resources the first instance leaves, and how many the later ones."""
    adopt_orphans()
    if not is_single_instance(subject):  # what the library opens once is not a leak
        HostedInstance(subject).free()
    before = count_resources()
    try:
        _run_steps(subject)
        wait_until_settled(lambda: count_resources() == before)
        first = count_resources()
        for _ in range(0 if is_single_instance(subject) else _CYCLES):
            _run_steps(subject)
        wait_until_settled(lambda: count_resources() == first)
        return _subtract_counts(first, before), _subtract_counts(count_resources(), first)
    finally:
        end_children()


def _subtract_counts(after: dict[str, int], before: dict[str, int]) -> dict[str, int]:
    return {name: after[name] - before[name] for name in after}


_NOTHING = "nothing"
"""What a setting is that does not exist."""


@check("process.settings", needs=("run.completes",))
def settings(subject: Subject) -> CheckOutcome:
    """Compare the working folder, locale, rounding and signal handlers before and after a short run."""
    before, steps, after = in_fresh_process(_read_settings_of_run, subject)
    changed = {
        name: snapshot.get(name, _NOTHING)
        for snapshot in (steps, after)
        for name in {**before, **snapshot}
        if snapshot.get(name, _NOTHING) != before.get(name, _NOTHING)
    }
    problems = [
        f"It changes {name} from {before.get(name, _NOTHING)} to {value}." for name, value in changed.items()
    ]
    return judge_problems((), f"{len(before)} settings of the process are unchanged.", problems)


def _read_settings_of_run(subject: Subject) -> tuple[dict[str, str], dict[str, str], dict[str, str]]:
    """Return the settings before the FMU is loaded, after some steps, and after the instance is freed."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # so that a change shows
    if hasattr(signal, "SIGPIPE"):
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)
    before = read_settings()
    instance = HostedInstance(subject)
    run_instance(instance, make_experiment(subject, _STEPS))
    steps = read_settings()
    instance.close()
    return before, steps, read_settings()


@check("process.files", needs=("run.completes",), time_factor=2.0)
def files(subject: Subject) -> CheckOutcome:
    """Check the FMU's own folder, the working folder, and the home folder after a run."""
    with tempfile.TemporaryDirectory() as folder:
        folders = {name: Path(folder, name) for name in ("working", "home")}
        for path in folders.values():
            path.mkdir()
            (path / _CANARY_FILE).write_text("This file belongs to the user.\n")
        before = _read_change_times(subject)
        try:
            in_fresh_process(_run_in_folders, subject, folders["working"], folders["home"])
        except (CallError, EndedError):  # it may need files of the home folder, such as a license
            in_fresh_process(_run_in_folders, subject, folders["working"], None)
        problems = [
            f"It writes {join_few_names(names)} into the {name} folder."
            for name, path in folders.items()
            if (names := sorted(str(p.relative_to(path)) for p in path.rglob("*") if p.name != _CANARY_FILE))
        ]
        problems += [
            f"It removes files from the {name} folder."
            for name, path in folders.items()
            if not (path / _CANARY_FILE).is_file()
        ]
    if changed_files := _list_changed_files(subject):
        problems.append(f"It changes files in its own folder: {join_few_names(changed_files)}.")
    elif touched := [name for name, time in _read_change_times(subject).items() if before.get(name) != time]:
        problems.append(f"It writes in its own folder, and restores it: {join_few_names(touched)}.")
    return judge_problems((), "It writes no files into its own, the working or the home folder.", problems)


_CANARY_FILE = "notes.txt"
"""A file in the working and the home folder that an FMU must not touch."""


def _run_in_folders(subject: Subject, working: Path, home: Path | None) -> None:
    """Run the whole experiment: files may be written late."""
    os.chdir(working)
    if home is not None:
        os.environ["HOME"] = str(home)
    instance = HostedInstance(subject)
    run_instance(instance, make_experiment(subject))
    instance.close()


def _read_change_times(subject: Subject) -> dict[str, int]:
    """Return when files of the unpacked FMU, and the lists of its folders, changed, by name."""
    paths = sorted(subject.folder.rglob("*"))
    return {p.relative_to(subject.folder).as_posix(): p.lstat().st_mtime_ns for p in paths}


def _list_changed_files(subject: Subject) -> list[str]:
    """Return files of the unpacked FMU that its archive does not have, or has with another content."""
    with zipfile.ZipFile(subject.path) as archive:
        sums = {info.filename: (info.file_size, info.CRC) for info in archive.infolist() if not info.is_dir()}
    changed = []
    for path in sorted(p for p in subject.folder.rglob("*") if p.is_file()):
        name = path.relative_to(subject.folder).as_posix()
        size, total = sums.get(name, (-1, 0))
        sums.pop(name, None)
        if path.stat().st_size != size or _compute_checksum(path) != total:
            changed.append(name)
    return [*changed, *(f"{name} (removed)" for name in sums)]


def _compute_checksum(path: Path) -> int:
    total = 0
    with path.open("rb") as stream:
        while block := stream.read(2**20):
            total = zlib.crc32(block, total)
    return total


_QUIET = 4096
"""Bytes to a stream in a short run that are not a flood."""


@check("process.output", needs=("run.completes",))
def output(subject: Subject) -> CheckOutcome:
    """Check how much a short run writes to standard output and standard error."""
    written = in_fresh_process(_record_streams, subject)
    problems = [
        f"In {_STEPS} steps it writes {size / 1024:.0f} KiB to {name}: {format_message(line)}"
        for name, (size, line) in written.items()
        if size > _QUIET
    ]
    return judge_problems((), "It hardly writes to standard output and standard error.", problems)


def _record_streams(subject: Subject) -> dict[str, tuple[int, str]]:
    """Return the number of bytes and the first line that go to each stream."""
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as errors:
        streams = {"standard output": (1, out), "standard error": (2, errors)}
        for number, stream in streams.values():
            # C libraries write to descriptors, not to the streams of Python
            os.dup2(stream.fileno(), number)
        _run_steps(subject)
        load_c_library().fflush(None)
        written = {}
        for name, (_, stream) in streams.items():
            size = stream.seek(0, os.SEEK_END)
            stream.seek(0)
            written[name] = (size, stream.read(200).decode(errors="replace").partition("\n")[0])
    return written


@check("process.unload", needs=("run.completes",))
def unload(subject: Subject) -> CheckOutcome:
    """Check that the process continues after the library is unloaded, and can end normally after a run."""
    try:
        in_fresh_process(_run_and_unload, subject)
    except EndedError as error:
        return warned(str(error))
    without, after = (_describe_end(do, subject) for do in (_end_process, _run_and_end))
    if after != without == _ENDS_WELL:
        return warned(f"A process that calls `exit(0)` after a run ends with {after}.")
    return passed("The library was unloaded after a run.")


_ENDS_WELL = "exit code 0"


def _describe_end(do: Callable[[Subject], None], subject: Subject) -> str:
    """Return how a new process ends that calls `do`, such as `exit code 0`; empty if the call returns."""
    try:
        in_fresh_process(do, subject)
    except EndedError as error:
        return error.how
    return ""


def _end_process(subject: Subject) -> None:
    """End this process as a program in C does."""
    note("ending the process")
    load_c_library().exit(0)


def _run_and_end(subject: Subject) -> None:
    _run_steps(subject)
    _end_process(subject)


def _run_and_unload(subject: Subject) -> None:
    instance = _run_steps(subject)
    note("unloading its library")
    instance.fmu.freeLibrary()
