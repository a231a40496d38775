"""Entries of data sheets as unknown parameters: the start values that follow from them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

from ...run.preparation import apply_parameter_files
from ...run.registered import following_values
from ...run.scenarios.scenario import Scenario
from ...system.model import Value
from ...system.names import Names
from ..execution.worker_payload import Preparation
from ..frame.plan_files import load_planned
from ..variants.targets import SHEET, merge_options
from .plan import IdentificationPlan

_READ = ("input",)
"""Options whose files are not read again for other entries: no start value follows from them."""


@dataclass(frozen=True)
class SheetEntries:
    """The start values that follow from entries of data sheets, by experiment.

    Attributes:
        plan: the plan.
        preparations: the prepared experiments.
    """

    plan: IdentificationPlan
    preparations: Sequence[Preparation]

    def start_values(self, experiment: int, entries: Mapping[str, Value]) -> dict[str, Value]:
        """Return the start values of an experiment that entries change, by full name.

        Values that the experiment sets itself stay, and those that follow from them.

        Args:
            experiment: Position of the experiment.
            entries: Values by JOINT.TABLE.ENTRY, as data sheets print them.

        Raises:
            CommandError: A data sheet with these entries has errors.
        """
        before = self._before[experiment]
        plan = replace(self.plan, options=_without_data(self.plan.options))
        own = _without_data(plan.experiments[experiment].options)
        changed = load_planned(plan, merge_options([own, {SHEET: entries}]))
        after = _all_start_values(changed, self.preparations[experiment])
        return {name: value for name, value in after.items() if before.get(name) != value}

    @cached_property
    def _before(self) -> list[dict[str, Value]]:
        """Return the start values of each experiment without other entries."""
        return [_all_start_values(one.scenario, one) for one in self.preparations if one.scenario is not None]


def _without_data(options: Mapping[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in options.items() if name not in _READ}


def _all_start_values(scenario: Scenario, preparation: Preparation) -> dict[str, Value]:
    """Return the start values of a scenario with its options, by full name; `preparation` has its names."""
    options = scenario.options
    system = apply_parameter_files(scenario.system, options.parameters, preparation.interfaces)
    own: dict[str, Any] = {
        f"{c.name}.{name}": x for c in system.components for name, x in c.parameters.items()
    }
    values = Names(preparation.system, preparation.interfaces).start_values(options.set)
    return own | values | following_values(system, options)
