"""FMUs examined in this process, as far as they do it no harm."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import lief  # noqa: F401  # once here, and not in each process that examines
import pytest

from emla_cosim.verification import check_runner, examination
from emla_cosim.verification.check import Check
from emla_cosim.verification.findings import Examined
from emla_cosim.verification.settings import Settings
from emla_cosim.verification.subject import Subject
from emla_cosim.verification.subprocess_run import run_in_subprocess
from emla_cosim.verification.verdict import CheckOutcome, failed


def examined_here(path: Path, checks: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> Examined:
    """What these checks find, of which only what may end a process gets one: they cost more than all else."""
    with monkeypatch.context() as context:
        context.setattr(check_runner, "run_each_in_subprocess", _apart_where_needed)
        context.setattr(check_runner, "use_scratch", lambda _: None)  # of this process, too
        context.chdir(path.parent)
        return examined_apart(path, checks)


def examined_apart(path: Path, checks: tuple[str, ...]) -> Examined:
    """What these checks find, in processes of their own; unpacked beside the FMU."""
    return examination.examine_fmu(Subject(path, path.parent / "unpacked" / "fmu", Settings(only=checks)))


def _apart_where_needed(
    do: Callable[..., CheckOutcome],
    items: Sequence[tuple[Check, Subject]],
    seconds: float,
    memory: int,
    writable: Sequence[Path],
) -> Iterator[CheckOutcome]:
    for check, subject in items:
        harmful = check.group in ("archive", "binaries")
        yield (
            run_in_subprocess(do, (check, subject), seconds, memory, writable)
            if harmful
            else _here(do, check, subject)
        )


def _here(do: Callable[..., CheckOutcome], check: Check, subject: Subject) -> CheckOutcome:
    """What a check finds; that it went wrong is no matter where what it needs has failed."""
    try:
        return do(check, subject)
    except Exception as error:
        return failed(f"The check itself has an error: {error!r}.")
