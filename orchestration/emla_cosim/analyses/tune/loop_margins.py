"""Stability margins as conditions of a case: measure the loops that it names, as `emla linearize` does."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ...base.errors import CommandError, CosimError
from ...run.requirements import Requirement
from ...run.run_setup import run_times
from ...run.scenarios.scenario import Scenario
from ..linearize.margins import LARGEST_MS, LEAST_GAIN_DB, LEAST_PHASE_DEG
from ..linearize.places import parse_opening
from ..linearize.runner import measure_loops
from .plan import Case

_PHASE, _GAIN_UP, _GAIN_DOWN, _MS = "phase_margin_deg", "gain_margin_up_dB", "gain_margin_down_dB", "Ms"

_CONDITIONS = (
    (_PHASE, ">=", LEAST_PHASE_DEG),
    (_GAIN_UP, ">=", LEAST_GAIN_DB),
    (_GAIN_DOWN, "<=", -LEAST_GAIN_DB),
    (_MS, "<=", LARGEST_MS),
)

_SAMPLES = 1500
"""Length of the responses in steps."""

_UNLIMITED_DB = 200.0
"""Gain margin of a loop that no gain makes unstable."""


@dataclass(frozen=True)
class LoopMargins:
    """The loops of a case, and the operating point at which they are measured.

    Attributes:
        at: time in s.
        duration: length of the responses in s.
        values: start values of the case.
    """

    scenario: Scenario
    loops: Sequence[str]
    at: float
    duration: float
    values: Mapping[str, Any]

    def measure(self, gains: Mapping[str, Any]) -> dict[str, float]:
        """Return figures of all loops with these start values; a loop without margins has none."""
        found = measure_loops(self.scenario, self.loops, self.at, self.duration, {**gains, **self.values})
        figures = dict[str, float]()
        for loop, one in found.items():
            if isinstance(one, CosimError) or one.margins is None or not one.margins.has_crossover:
                continue
            margins = one.margins
            figures |= {
                _name(loop, _PHASE): margins.phase_deg,
                _name(loop, _GAIN_UP): min(margins.gain_up_dB, _UNLIMITED_DB),
                _name(loop, _GAIN_DOWN): max(margins.gain_down_dB, -_UNLIMITED_DB),
                _name(loop, _MS): margins.Ms,
            }
        return {name: value for name, value in figures.items() if math.isfinite(value)}


def margin_requirements(case: Case) -> list[Requirement]:
    """Return the conditions on the loops of a case, in a form that objectives can check."""
    return [Requirement(_name(loop, name), sign, x) for loop in case.margins for name, sign, x in _CONDITIONS]


def prepare_loops(
    case: Case, values: Mapping[str, Any], scenario: Scenario, where: str
) -> LoopMargins | None:
    """Return the loops of a case; None if it has none.

    Args:
        case: The case.
        values: Its options, as for a variant.
        scenario: The scenario of the tuning.
        where: What messages call the plan.

    Raises:
        CommandError: A loop does not exist, or the operating point is outside of the run.
    """
    if not case.margins:
        return None
    if further := [name for name in values if name != "set"]:
        raise CommandError(
            f"the case '{case.name}' of {where} has 'margins' and sets the option {further[0]}; "
            "set start values only."
        )
    for loop in case.margins:
        parse_opening(scenario.system, loop)
    times = run_times(scenario.options, scenario.name)
    count = min(_SAMPLES, times.steps // 2)
    last = times.point(times.steps - count)
    at = last if case.at is None else case.at
    if not times.start <= at <= last:
        raise CommandError(
            f"'at' of the case '{case.name}' of {where} is {at:g} s; choose a time from {times.start:g} to "
            f"{last:g} s, so that the responses of {count * times.step:g} s end within the run."
        )
    return LoopMargins(scenario, case.margins, at, count * times.step, values.get("set", {}))


def _name(loop: str, figure: str) -> str:
    return f"{loop}: {figure}"
