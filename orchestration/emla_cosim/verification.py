"""Verification of FMUs, and of SSPs: those are simulated."""

import functools
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from fmu_verify import runner
from fmu_verify.check import CheckOutcome, Clause, Verdict, check, failed, passed
from fmu_verify.examiner import SystemKind
from fmu_verify.findings import Examined, Finding
from fmu_verify.messages import format_sentence
from fmu_verify.report import Report
from fmu_verify.settings import Recording
from fmu_verify.subject import WholeSystem

from .base.errors import CosimError
from .ssp.reader.flat_document import read_ssp

__all__ = ["Examined", "Finding", "Recording", "Report", "Verdict", "verify"]

_DOCUMENT = "EMLA-Cosim, docs/verify.md"
_TIME_FACTOR, _MEMORY_FACTOR = 60.0, 4.0

P = ParamSpec("P")
R = TypeVar("R")


@check(
    "system.runs",
    "The system runs to its stop time",
    Clause("Systems", "A system runs from its start time to its stop time.", _DOCUMENT),
    "Run the same file with `emla run` to see more.",
    time_factor=_TIME_FACTOR,
    memory_factor=_MEMORY_FACTOR,
)
def runs(system: WholeSystem) -> CheckOutcome:
    """Check that all FMUs can be connected and stepped."""
    return _simulate(system, {})


@check(
    "system.agrees",
    "All signals stay within the tubes around an earlier run",
    Clause("Systems", "Every signal of both runs stays within the tube around the earlier one.", _DOCUMENT),
    "Begin with the signal that left its tube first, and look at its inputs.",
    time_factor=_TIME_FACTOR,
    memory_factor=_MEMORY_FACTOR,
)
def agrees(system: WholeSystem) -> CheckOutcome:
    """Compare the system with an earlier run."""
    settings = system.settings
    return _simulate(system, {"reference": settings.reference, "tolerance": settings.tolerance})


def _simulate(system: WholeSystem, options: dict[str, Any]) -> CheckOutcome:
    from .study.loading import load  # imports most of the project

    try:
        with load(system.path).prepare() as simulation:
            result = simulation.attempt(**options)
    except CosimError as error:
        return failed(format_sentence(error))
    more = {
        "comparisons": tuple(result.comparisons),
        "figures": {"steps": result.steps, "wall_s": result.wall_s},
    }
    if result.problem is not None:
        return failed(format_sentence(result.problem), **more)
    agree = f"; {len(result.comparisons)} signals stay within their tubes" if result.comparisons else ""
    return passed(f"{result.steps} steps were completed, {result.simulated_s:g} s{agree}.", **more)


@contextmanager
def unpack_fmus(path: Path) -> Iterator[Sequence[Path]]:
    """Unpack an SSP and return its FMUs. Raise CommandError if it cannot be read."""
    with read_ssp(path) as document:
        yield list(dict.fromkeys(c.fmu for c in document.system.components if c.fmu is not None))


SSP = SystemKind((".ssp", ".ssd"), unpack_fmus, runs, agrees)


def _with_systems(verify: Callable[P, R]) -> Callable[P, R]:
    @functools.wraps(verify)
    def verify_all(*arguments: P.args, **options: P.kwargs) -> R:
        return verify(*arguments, **({"systems": SSP} | options))  # type: ignore[arg-type]

    return verify_all


verify = _with_systems(runner.verify)
"""Verify FMUs and SSPs; see `fmu_verify.runner.verify`."""
