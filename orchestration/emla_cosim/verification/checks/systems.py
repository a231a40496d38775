"""Whole systems: they run, and still do what a run that was kept did."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...base.errors import CosimError
from ..check import check
from ..messages import sentence
from ..settings import Settings
from ..verdict import CheckOutcome, Clause, failed, passed

_DOCUMENT = "EMLA-Cosim, docs/verify.md"
_PATIENCE, _ROOM = 60.0, 4.0


@dataclass(frozen=True)
class WholeSystem:
    """An SSP, and how it is to be examined."""

    path: Path
    settings: Settings


@check(
    "system.runs",
    "The system runs to its stop time",
    Clause("Systems", "A system runs from its start time to its stop time.", _DOCUMENT),
    "`emla run` of the same file shows more.",
    time_factor=_PATIENCE,
    memory_factor=_ROOM,
)
def runs(system: WholeSystem) -> CheckOutcome:
    """All FMUs can be connected and stepped."""
    return _simulated(system, {})


@check(
    "system.agrees",
    "All signals stay within the tubes around those of a run that was kept",
    Clause("Systems", "Every signal of both runs stays within the tube around the earlier one.", _DOCUMENT),
    "The signal that left first is nearest to the reason; see what drives it.",
    time_factor=_PATIENCE,
    memory_factor=_ROOM,
)
def agrees(system: WholeSystem) -> CheckOutcome:
    """The system does what it did."""
    settings = system.settings
    return _simulated(system, {"reference": settings.reference, "tolerance": settings.tolerance})


def _simulated(system: WholeSystem, options: dict[str, Any]) -> CheckOutcome:
    from ...study.loading import load  # which knows all there is

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
    return passed(f"{result.steps} steps were done, {result.simulated_s:g} s{agree}.", **more)
