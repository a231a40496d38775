"""Checks of whole systems: they run, and agree with an earlier run."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...base.errors import CosimError
from ..check import check
from ..messages import sentence
from ..settings import Settings
from ..verdict import CheckOutcome, Clause, failed, passed

_DOCUMENT = "EMLA-Cosim, docs/verify.md"
_TIME_FACTOR, _MEMORY_FACTOR = 60.0, 4.0


@dataclass(frozen=True)
class WholeSystem:
    """An SSP, the settings for its checks, and the folder in which they work."""

    path: Path
    settings: Settings
    scratch: Path


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
    return _simulated(system, {})


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
    return _simulated(system, {"reference": settings.reference, "tolerance": settings.tolerance})


def _simulated(system: WholeSystem, options: dict[str, Any]) -> CheckOutcome:
    from ...study.loading import load  # imports most of the project

    try:
        with load(system.path).prepare() as simulation:
            result = simulation.attempt(**options)
    except CosimError as error:
        return failed(sentence(error))
    more = {
        "comparisons": tuple(result.comparisons),
        "figures": {"steps": result.steps, "wall_s": result.wall_s},
    }
    if result.problem is not None:
        return failed(sentence(result.problem), **more)
    agree = f"; {len(result.comparisons)} signals stay within their tubes" if result.comparisons else ""
    return passed(f"{result.steps} steps were completed, {result.simulated_s:g} s{agree}.", **more)
