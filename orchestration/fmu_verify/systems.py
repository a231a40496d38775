"""Systems of FMUs, as far as a verification must know them: who simulates them brings the rest."""

import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, closing
from dataclasses import dataclass
from pathlib import Path

from .check import Check
from .check_runner import CheckRunner
from .confinement import list_gaps
from .findings import Examined, Finding
from .gate import find_objections
from .settings import Settings
from .subject import WholeSystem


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
        not_examined=tuple(list_gaps()),
    )
