"""The plan of a tuning: a scenario, gains with their ranges, objective, conditions and cases."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Annotated, Any

import msgspec

from ...base.errors import CommandError
from ...base.toml_structs import list_given, quantity, struct_of
from ...run.options import select_repeatable
from ...run.scenarios.scenario_file import TUNINGS
from ..frame.plan_files import IN_FILES, NOT_IN_FILES, AnalysisPlan, Source, read_plan
from ..variants.measures import Metric

DEFAULTS = "usual"
"""The name of the only case in a plan without cases: the scenario unchanged."""


@dataclass(frozen=True)
class Case:
    """Conditions in which gains must do well, with other start values or options than the scenario.

    Args:
        name: name of the case.
        weight: weight of its objective in the sum; with 0, only its requirements count.
        set: start values and options by name, as a sweep varies them, with one value each, such as "110%".
        require: conditions in this case. Default: those of the plan.
        margins: loops, as `linearize` opens them, that need a phase margin of at least 30 degrees, gain
            margins of at least 6 dB both ways, and an Ms of at most 2.2.
        at: time in s at which loops are measured. Default: as late as possible.
    """

    name: str
    weight: Annotated[float, msgspec.Meta(ge=0.0)] = 1.0
    set: Mapping[str, Any] = field(default_factory=dict)
    require: Sequence[str] | None = None
    margins: Sequence[str] = ()
    at: Annotated[float, quantity("s")] | None = None


_CASE: Any = struct_of(Case, {"name": str | None})


@dataclass(frozen=True)
class TuningPlan(AnalysisPlan):
    """A tuning: a scenario, gains and their ranges, an objective and conditions.

    Args:
        name: name of the tuning.
        scenario: what is run: a scenario, its name or its file, or a `System`.
        vary: gains and their ranges, as for `tune`; names without a dot are used in `derive` only.
        objective: expression over metrics, to be minimized.
        derive: further start values, as expressions over what varies.
        require: conditions on metrics.
        metrics: further metrics that objective and conditions can use.
        cases: conditions in which the gains are tried.
        seeds: names or patterns of start values that are seeds.
        training: number of seeds for the search.
        validation: number of other seeds for the validation.
        evaluations: number of sets of gains to try.
        seed: seed of the search.
        tolerance: relative increase of the objective that is allowed on the validation seeds.
        margin: relative distance that a metric must keep from its condition during the search.
        description: one line on its purpose.
        options: values of options by name, for all runs.
        where: what error messages call the plan.

    Examples:
        >>> import emla_cosim as ec
        >>> plan = ec.TuningPlan(
        ...     "stiff", "lift", {"lift.controller.k_p": "100:300"}, "lift.position_error_m"
        ... )
        >>> plan.evaluations
        200
    """

    objective: str = ""
    derive: Mapping[str, Any] = field(default_factory=dict)
    require: Sequence[str] = ()
    metrics: Sequence[Metric] = ()
    cases: Sequence[Case] = (Case(DEFAULTS),)
    seeds: Sequence[str] = ("*.seed",)
    training: Annotated[int, msgspec.Meta(ge=1)] = 2
    validation: Annotated[int, msgspec.Meta(ge=0)] = 4
    evaluations: Annotated[int, msgspec.Meta(ge=1)] = 200
    seed: Annotated[int, msgspec.Meta(ge=0)] = 0
    tolerance: Annotated[float, msgspec.Meta(ge=0.0)] | None = None
    margin: Annotated[float, msgspec.Meta(ge=0.0)] = 0.0
    where: str = field(default="the tuning", kw_only=True)

    ADDED = ("derive", "require")
    UNCHECKED = ("cases",)
    NOTHING_VARIES = (
        "varies nothing; add a gain with its range, such as --vary 'tilt.controller.beta[1]=200:4000'"
    )

    @classmethod
    def types_in_files(cls) -> Mapping[str, Any]:
        """Return the types of fields in files that differ from those in Python."""
        return {**IN_FILES, "cases": list[_CASE]}

    @property
    def record(self) -> dict[str, Any]:
        """The plan as plain data."""
        plain = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in NOT_IN_FILES}
        return {
            **plain,
            "scenario": self.scenario if isinstance(self.scenario, str) else str(self.name),
            "vary": {name: str(value) for name, value in self.vary.items()},
            "cases": [asdict(case) for case in self.cases],
            "metrics": [str(metric) for metric in self.metrics],
            "options": {name: str(value) for name, value in select_repeatable(self.options).items()},
        }

    def check(self) -> None:
        """Raise CommandError for mistakes that can be found without the scenario."""
        super().check()
        if not self.objective:
            raise CommandError(
                f"{self.where} has no objective; add a figure to minimise, such as "
                "--objective tilt.position_error_m."
            )
        if not self.cases:
            raise CommandError(f"'cases' of {self.where} is empty; remove it to use the scenario unchanged.")
        names = [case.name for case in self.cases]
        if twice := [name for name in names if names.count(name) > 1]:
            raise CommandError(f"{self.where} has two cases '{twice[0]}'; rename one.")
        for case in self.cases:
            if not 0 <= case.weight < float("inf"):
                raise CommandError(
                    f"the weight of the case '{case.name}' is {case.weight}; it must be a finite "
                    "number from 0."
                )
        if not any(case.weight for case in self.cases):
            raise CommandError(f"no case of {self.where} has a weight; set one to a weight above 0.")


def load_tuning_plan(source: Source | TuningPlan) -> TuningPlan:
    """Return a plan, read by name or from a file (.toml with `vary`), or made of a scenario without gains.

    Raises:
        CommandError: A file cannot be read, or is not a plan.
    """
    if isinstance(source, TuningPlan):
        return source
    values, _ = read_plan(source, TuningPlan, "tuning", "tuning", TUNINGS)
    if "cases" in values:
        values["cases"] = [
            Case(**{"name": str(position), **list_given(case)})
            for position, case in enumerate(values["cases"], 1)
        ]
    return TuningPlan(**values)
