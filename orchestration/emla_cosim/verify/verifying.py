"""The way to a report: FMUs handed to examiners, as many at a time as there are cores."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from ..channel import Channel
from ..processes import how_it_ended, started
from ..progress import Progress
from .check import Check
from .examination import chosen
from .examiner import Job
from .report import Examined, Finding, Report
from .settings import Settings
from .verdict import failed


def verify(
    paths: Sequence[str | Path] | str | Path,
    settings: Settings | None = None,
    progress: Progress | None = None,
) -> Report:
    """Verify FMUs."""
    given = [paths] if isinstance(paths, (str, Path)) else list(paths)
    told, settings = progress or Progress(), settings or Settings()
    count = len(chosen(settings.only, settings.skip))
    told.begin("verifying", count * len(given))
    with ThreadPoolExecutor(min(os.cpu_count() or 1, len(given))) as pool:
        jobs = [Job(Path(path).absolute(), settings) for path in given]
        found = list(pool.map(lambda job: _examined(job, lambda _: told.advance(1)), jobs))
    return Report(tuple(found), version("emla-cosim"), datetime.now(UTC).isoformat(timespec="seconds"))


def _examined(job: Job, told: Callable[[str], None]) -> Examined:
    process = started(f"{__package__}.examiner")
    channel = Channel(process.stdout, process.stdin, lambda: process.poll() is None)
    try:
        channel.send(job)
        while isinstance(answer := channel.receive(), str):
            told(answer)
        return answer
    except (EOFError, OSError):
        return _lost(job, how_it_ended(process.wait()))
    finally:
        channel.close()
        process.kill()
        process.wait()


def _lost(job: Job, how: str) -> Examined:
    """What is said where not even the examiner came to its end."""
    first: Check = chosen((), ())[0]
    outcome = failed(f"Its examination ended ({how}).")
    finding = Finding(first.name, first.title, outcome, first.clause, outcome.hint or first.hint, 0.0)
    return Examined(job.path, {}, (finding,), 0.0)
