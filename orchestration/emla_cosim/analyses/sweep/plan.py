"""The plan of a sweep: scenario, factors, sampling, and metrics."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Self

import msgspec

from ...run.scenarios.built_in import PLANS
from ..frame.plan_files import AnalysisPlan, Source, read_plan
from ..variants.measures import Metric
from ..variants.sampling import SAMPLINGS


@dataclass(frozen=True)
class Plan(AnalysisPlan):
    """A sweep: a scenario, what varies, how it is sampled, and what is kept.

    Args:
        name: name of the sweep.
        scenario: what is run: a scenario, its name or its file, or a `System`.
        vary: what varies, and how, as for `sweep`.
        description: one line on its purpose.
        sampling: how variants are chosen, as for `sweep`.
        runs: number of variants to draw.
        seed: seed of all random draws.
        metrics: metrics to keep, as for `sweep`. Default: all.
        signals: names or patterns of signals to keep over time.
        options: values of options by name, for all variants.
        where: what error messages call the plan.

    Examples:
        >>> import emla_cosim as ec
        >>> plan = ec.Plan("warm", "lift", {"lift.plant.motor.R_s": "0.1:0.2"}, runs=8)
        >>> plan.updated({"runs": 16}).runs
        16
    """

    sampling: str | None = None
    runs: int | None = None
    seed: Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)] = 0
    metrics: Sequence[Metric] | Mapping[str, Metric] = ()
    signals: Sequence[str] = ()
    where: str = field(default="the sweep", kw_only=True)

    NOTHING_VARIES = "varies nothing; add a factor, for example --vary lift.plant.motor.R_s=0.05:0.3:20"

    def updated(self, changes: Mapping[str, Any]) -> Self:
        """Return the plan with other values; `vary` and `options` are merged, None changes nothing.

        A sampling that does not take `runs` drops those of the plan.

        Args:
            changes: values of fields by name.

        Raises:
            CommandError: a value has a wrong type.
        """
        method = SAMPLINGS.get(str(changes.get("sampling")))
        return super(Plan, replace(self, runs=None) if method and method.own_size else self).updated(changes)


def load_plan(source: Source | Plan) -> Plan:
    """Load a plan by name, from a .toml file with `vary`, or from a scenario, which varies nothing.

    Raises:
        CommandError: The file cannot be read or is not a plan.
    """
    if isinstance(source, Plan):
        return source
    values, folder = read_plan(source, Plan, "sweep", "plan", PLANS)
    if folder is not None:
        values["vary"] = {name: _resolve_files(folder, entry) for name, entry in values["vary"].items()}
    plan = Plan(**values)
    if "vary" in values:
        plan.check()
    return plan


def _resolve_files(folder: Path, entry: Any) -> Any:
    """Return the values of a factor with files relative to the folder of the plan."""
    match entry:
        case str() if entry.lower().endswith((".fmu", ".ssv", ".toml")) and "," not in entry:
            return str(folder / entry)
        case {"values": values}:
            return {**entry, "values": _resolve_files(folder, values)}
        case list():
            return [_resolve_files(folder, value) for value in entry]
    return entry
