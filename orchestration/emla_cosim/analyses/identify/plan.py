"""The plan of an identification: a scenario, unknown parameters with their ranges, and experiments."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import msgspec

from ...base.errors import CommandError, check_choice, join_names
from ...base.option import SWEEP
from ...base.table_entries import Location
from ...base.toml_structs import describe, list_given, struct_of, type_in_file
from ...base.values import convert_value
from ...inputs.input import Input
from ...run.scenarios.scenario_file import with_options
from ..frame.plan_files import IN_FILES, AnalysisPlan, Source, read_plan
from .residuals import LINEAR, LOSSES


@dataclass(frozen=True)
class Experiment:
    """A run of the machine.

    Args:
        name: its name.
        measured: what was measured; `signals` of each `Input` maps signals of the system to columns. An
            experiment without measurements is only planned, see `IdentificationPlan.design`.
        options: options of the scenario in this experiment, such as `input` and `set`.
        held_out: whether it serves to validate only.
    """

    name: str
    measured: Sequence[Input] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
    held_out: bool = False


def _read_measured(value: Any, at: Location, folder: Path | None) -> Sequence[Input]:
    sources = [value] if isinstance(value, (str, Mapping)) else value
    return convert_value(sources, Sequence[Input], at.label, folder)


_DATA = type_in_file(Input)
_EXPERIMENT = struct_of(
    Experiment,
    {
        "name": str | None,
        "measured": Annotated[
            _DATA | list[_DATA],  # type: ignore[valid-type]
            describe("what was measured, as for --measured, one or several", read=_read_measured),
        ],
    },
    ["options"],
)


@dataclass(frozen=True)
class IdentificationPlan(AnalysisPlan):
    """An identification: a scenario, unknown parameters, and experiments.

    Args:
        name: its name.
        scenario: what is run: a scenario, its name or its file, or a `System`.
        vary: unknown parameters and their ranges LOW:HIGH: start values as for `sweep`; offset(SIGNAL),
            gain(SIGNAL) and delay(SIGNAL) are those of the sensor of a measured signal.
        experiments: the experiments.
        sigma: standard deviations of the measured signals by name. Default: those of the residuals.
        loss: loss function, one of `LOSSES`.
        starts: number of starting points: the values of the scenario, and random ones.
        evaluations: most iterations from each starting point.
        profile: parameters whose intervals are found with all others estimated again.
        seed: seed of the random starting points.
        design: whether to rank the experiments by what they would tell, in place of an estimation.
        description: one line on its purpose.
        options: values of options by name, for all runs.
        where: what error messages call the plan.
    """

    experiments: Sequence[Experiment] = ()
    sigma: Mapping[str, Any] = field(default_factory=dict)
    loss: str = LINEAR
    starts: Annotated[int, msgspec.Meta(ge=1)] = 1
    evaluations: Annotated[int, msgspec.Meta(ge=1)] = 50
    profile: Sequence[str] = ()
    seed: Annotated[int, msgspec.Meta(ge=0)] = 0
    design: bool = False
    where: str = field(default="the identification", kw_only=True)

    ADDED = UNCHECKED = ("sigma", "experiments")
    NOTHING_VARIES = (
        "has no unknown parameter; add one with its range, such as --vary lift.plant.friction.F_C=0:500"
    )

    @classmethod
    def types_in_files(cls) -> Mapping[str, Any]:
        """Return the types of fields in files; experiments have options of their own."""
        experiment = with_options(_EXPERIMENT, "Experiment", SWEEP)
        return {**IN_FILES, "experiments": list[experiment]}  # type: ignore[valid-type]

    @property
    def record(self) -> dict[str, Any]:
        """The plan as plain data."""
        return {
            "scenario": self.scenario if isinstance(self.scenario, str) else str(self.name),
            "vary": {name: str(value) for name, value in self.vary.items()},
            "loss": self.loss,
            "starts": self.starts,
            "evaluations": self.evaluations,
            "seed": self.seed,
            "experiments": [
                {
                    "name": experiment.name,
                    "held_out": experiment.held_out,
                    "measured": [source.record() for source in experiment.measured],
                }
                for experiment in self.experiments
            ],
        }

    def check(self) -> None:
        """Raise CommandError for mistakes that can be found without the scenario."""
        super().check()
        check_choice("loss", self.loss, LOSSES)
        if unknown := [name for name in self.profile if name not in self.vary]:
            raise CommandError(
                f"'{unknown[0]}' in 'profile' of {self.where} is not one of the unknown parameters; use "
                f"{join_names(self.vary)}."
            )
        if self.profile and self.loss != LINEAR:
            raise CommandError(
                f"{self.where} has a profile and the loss '{self.loss}'; a profile needs '{LINEAR}'."
            )
        names = [experiment.name for experiment in self.experiments]
        if twice := [name for name in names if names.count(name) > 1]:
            raise CommandError(f"{self.where} has two experiments '{twice[0]}'; rename one.")
        if self.design:
            if not self.experiments:
                raise CommandError(f"{self.where} has no experiments to choose from; add [[experiments]].")
            return
        if not any(experiment.measured and not experiment.held_out for experiment in self.experiments):
            raise CommandError(
                f"{self.where} has no measured data; add them, such as "
                "--measured test.csv:lift.plant.x_L=position."
            )
        if idle := [experiment.name for experiment in self.experiments if not experiment.measured]:
            raise CommandError(
                f"the experiment '{idle[0]}' of {self.where} has no measured data; add 'measured'."
            )


def load_identification_plan(source: Source | IdentificationPlan) -> IdentificationPlan:
    """Return a plan, read from a file (.toml with `vary`), or made of a scenario.

    Raises:
        CommandError: A file cannot be read, or is not a plan.
    """
    if isinstance(source, IdentificationPlan):
        return source
    values, _ = read_plan(source, IdentificationPlan, "identification", "identification", {})
    values["experiments"] = [
        _build_experiment(list_given(table), str(position))
        for position, table in enumerate(values.get("experiments", ()), 1)
    ]
    return IdentificationPlan(**values)


def _build_experiment(values: dict[str, Any], name: str) -> Experiment:
    fields = {key: values.pop(key) for key in _EXPERIMENT.__struct_fields__ if key in values}
    return Experiment(**{"name": name, **fields}, options=values)
