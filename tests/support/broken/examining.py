"""FMUs examined in this process, as far as they do it no harm."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import lief  # noqa: F401  # once here, and not in each process that examines
import pytest

from emla_cosim.verification import asking, examination
from emla_cosim.verification.apart import apart
from emla_cosim.verification.check import Check
from emla_cosim.verification.findings import Examined
from emla_cosim.verification.settings import Settings
from emla_cosim.verification.subject import Subject
from emla_cosim.verification.verdict import Outcome, failed


def examined_here(path: Path, checks: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> Examined:
    """What these checks find, of which only what may end a process gets one: they cost more than all else."""
    with monkeypatch.context() as context:
        context.setattr(asking, "apart_each", _apart_where_needed)
        return examined_apart(path, checks)


def examined_apart(path: Path, checks: tuple[str, ...]) -> Examined:
    """What these checks find, in processes of their own; unpacked beside the FMU."""
    return examination.examined(Subject(path, path.parent / "unpacked" / "fmu", Settings(only=checks)))


def _apart_where_needed(
    do: Callable[..., Outcome], items: Sequence[tuple[Check, Subject]], seconds: float, memory: int
) -> Iterator[Outcome]:
    for check, subject in items:
        harmful = check.group in ("archive", "binaries")
        yield apart(do, (check, subject), seconds, memory) if harmful else _here(do, check, subject)


def _here(do: Callable[..., Outcome], check: Check, subject: Subject) -> Outcome:
    """What a check finds; that it went wrong is no matter where what it needs has failed."""
    try:
        return do(check, subject)
    except Exception as error:
        return failed(f"The check itself went wrong: {error!r}.")
