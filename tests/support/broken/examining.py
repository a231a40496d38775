"""FMUs examined in this process, as far as they do it no harm."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import lief  # noqa: F401  # once here, and not in each process that examines
import pytest

from emla_cosim.verify import examination
from emla_cosim.verify.apart import apart
from emla_cosim.verify.check import Check
from emla_cosim.verify.report import Examined
from emla_cosim.verify.settings import Settings
from emla_cosim.verify.subject import Subject
from emla_cosim.verify.verdict import Outcome


def examined_here(path: Path, checks: tuple[str, ...], monkeypatch: pytest.MonkeyPatch) -> Examined:
    """What these checks find, of which only what may end a process gets one: they cost more than all else."""
    with monkeypatch.context() as context:
        context.setattr(examination, "apart", _apart_where_needed)
        return examined_apart(path, checks)


def examined_apart(path: Path, checks: tuple[str, ...]) -> Examined:
    """What these checks find, each in a process of its own; unpacked beside the FMU."""
    return examination.examined(Subject(path, path.parent / "unpacked" / "fmu", Settings(only=checks)))


def _apart_where_needed(
    do: Callable[..., Outcome], arguments: tuple[Check, Subject], *limits: Any
) -> Outcome:
    check, _ = arguments
    return apart(do, arguments, *limits) if check.group in ("archive", "binaries") else do(*arguments)
