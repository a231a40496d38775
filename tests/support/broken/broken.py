"""What is wrong with an FMU that was broken on purpose, and which check has to say so."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from emla_cosim.verification.settings import Settings
from emla_cosim.verification.verdict import Verdict


@dataclass(frozen=True)
class Broken:
    """An FMU that is as it should be but for one thing.

    `what` is that thing, as the documentation's table says it, and `check` the name of the check that
    has to fail for it, and alone: what needs it is skipped, and everything else passes. `build` makes
    the FMU in a folder and returns its file. `verdict` is WARNING for what the standard allows, and
    PASSED for what is only noted, since no sentence of the standard judges it.
    """

    name: str
    what: str
    check: str
    build: Callable[[Path], Path]
    settings: Settings = field(default_factory=Settings)
    verdict: Verdict = Verdict.FAILED
