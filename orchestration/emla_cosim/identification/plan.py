"""The plan of an identification: a scenario, unknown parameters with their ranges, and experiments."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ..base.errors import CommandError, check_choice, join_names
from ..base.option import SWEEP
from ..base.values import convert_value
from ..inputs.input import Input
from ..run.options import list_options, read_option
from ..run.scenarios.scenario import Scenario
from ..run.scenarios.scenario_file import read_given_options
from ..study.loading import load
from ..sweeps.plan import Source, find_plan_scenario, flatten, read_plan_file
from ..sweeps.targets import merge_options
from ..system.model import System
from .loss import LINEAR, LOSSES

_OF_EXPERIMENT = ("name", "measured", "held_out")


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


@dataclass(frozen=True)
class IdentificationPlan:
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

    name: str
    scenario: Source
    vary: Mapping[str, Any] = field(default_factory=dict)
    experiments: Sequence[Experiment] = ()
    sigma: Mapping[str, Any] = field(default_factory=dict)
    loss: str = LINEAR
    starts: int = 1
    evaluations: int = 50
    profile: Sequence[str] = ()
    seed: int = 0
    design: bool = False
    description: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)
    where: str = "the identification"

    def updated(self, given: Mapping[str, Any]) -> "IdentificationPlan":
        """Return the plan with other values. Tables are merged, experiments added; None changes nothing.

        Raises:
            CommandError: A value has a wrong type.
        """
        found = {name: value for name, value in given.items() if value is not None}
        for name in ("vary", "sigma", "options"):
            if name in found:
                found[name] = merge_options([getattr(self, name), found[name]])
        if "experiments" in found:
            found["experiments"] = [*self.experiments, *found["experiments"]]
        changed = replace(self, **found)
        changed.check()
        return changed

    def load_scenario(self, options: Mapping[str, Any]) -> Scenario:
        """Return the scenario with the options of the plan and these."""
        given = merge_options([self.options, options])
        if isinstance(self.scenario, Scenario):
            return self.scenario.with_options(given)
        return load(self.scenario, **given)

    def check(self) -> None:
        """Raise CommandError for mistakes that can be found without the scenario."""
        for name, type_ in PLAIN.items():
            convert_value(getattr(self, name), type_, f"'{name}' of {self.where}")
        for name, least in (("starts", 1), ("evaluations", 1), ("seed", 0)):
            if getattr(self, name) < least:
                raise CommandError(
                    f"'{name}' of {self.where} is {getattr(self, name)}; it must be at least {least}."
                )
        check_choice("loss", self.loss, LOSSES)
        if not self.vary:
            raise CommandError(
                f"{self.where} has no unknown parameter; add one with its range, such as "
                "--vary lift.plant.friction.F_C=0:500."
            )
        if unknown := [name for name in self.profile if name not in self.vary]:
            raise CommandError(
                f"'{unknown[0]}' in 'profile' of {self.where} is no unknown parameter; use "
                f"{join_names(self.vary)}."
            )
        if self.profile and self.loss != LINEAR:
            raise CommandError(
                f"{self.where} has a profile and the loss '{self.loss}'; a profile needs '{LINEAR}'."
            )
        names = [one.name for one in self.experiments]
        if twice := [name for name in names if names.count(name) > 1]:
            raise CommandError(f"{self.where} has two experiments '{twice[0]}'; rename one.")
        if self.design:
            if not self.experiments:
                raise CommandError(f"{self.where} has no experiments to choose from; add [[experiments]].")
            return
        if not any(one.measured and not one.held_out for one in self.experiments):
            raise CommandError(
                f"{self.where} has no measured data; add them, such as "
                "--measured test.csv:lift.plant.x_L=position."
            )
        if idle := [one.name for one in self.experiments if not one.measured]:
            raise CommandError(
                f"the experiment '{idle[0]}' of {self.where} has no measured data; add 'measured'."
            )


PLAIN: dict[str, Any] = {
    "loss": str,
    "starts": int,
    "evaluations": int,
    "profile": Sequence[str],
    "seed": int,
    "design": bool,
    "description": str,
}
"""Types of the fields that are plain data, by name."""

_OWN = ("scenario", "vary", "sigma", "experiments", *PLAIN)


def load_identification_plan(source: Source | IdentificationPlan) -> IdentificationPlan:
    """Return a plan, read from a file (.toml with `vary`), or made of a scenario.

    Raises:
        CommandError: A file cannot be read, or is not a plan.
    """
    if isinstance(source, IdentificationPlan):
        return source
    if not isinstance(source, (str, Path)):
        if not isinstance(source, (Scenario, System)):
            raise CommandError(f"the plan is {source!r}; it must be a plan or a scenario, by name or file.")
        return IdentificationPlan(source.name if isinstance(source, Scenario) else "system", source)
    path = Path(source)
    if path.suffix.lower() == ".toml":
        content = read_plan_file(path)
        if content is not None:
            return _parse_plan(content, path.stem, f"the identification '{path}'", path.parent)
    name = path.stem if path.suffix else path.name
    return IdentificationPlan(name, source, where=f"the identification of '{source}'")


def _parse_plan(content: Mapping[str, Any], name: str, label: str, folder: Path) -> IdentificationPlan:
    """Return the plan of a file's content; paths in it are relative to `folder`. Raises CommandError."""
    scenario = find_plan_scenario(content, label, folder)
    plain = {key: content[key] for key in PLAIN if key in content}
    tables = {
        key: dict(flatten(convert_value(content.get(key, {}), Mapping[str, Any], f"'{key}' of {label}")))
        for key in ("vary", "sigma")
    }
    given = convert_value(content.get("experiments", ()), Sequence[Any], f"'experiments' of {label}")
    fields: dict[str, Any] = plain | tables
    return IdentificationPlan(
        name,
        scenario,
        **fields,
        experiments=[_experiment(one, i, label, folder) for i, one in enumerate(given, 1)],
        options=_options({n: v for n, v in content.items() if n not in _OWN}, label, folder, _OWN),
        where=label,
    )


def _experiment(content: Any, place: int, label: str, folder: Path) -> Experiment:
    of = f"experiment {place} of {label}"
    found = dict(convert_value(content, Mapping[str, Any], of))
    measured = found.get("measured", ())
    texts = convert_value(
        [measured] if isinstance(measured, (str, Mapping)) else measured, Sequence[Any], f"'measured' of {of}"
    )
    return Experiment(
        convert_value(found.get("name", str(place)), str, f"'name' of {of}"),
        [read_measured(one, f"'measured' of {of}").within(folder) for one in texts],
        _options({n: v for n, v in found.items() if n not in _OF_EXPERIMENT}, of, folder, _OF_EXPERIMENT),
        convert_value(found.get("held_out", False), bool, f"'held_out' of {of}"),
    )


def read_measured(given: Any, label: str) -> Input:
    """Return measured data as an `Input`, from one, a text as of `--measured`, or a table of a file."""
    if isinstance(given, Input):
        return given
    if isinstance(given, str):
        return Input.of_text(given)
    table = convert_value(given, Mapping[str, Any], label)
    try:
        return Input(**table)
    except TypeError as error:
        raise CommandError(f"{label} cannot be read: it may have file, signals, columns and time.") from error


def _options(given: Mapping[str, Any], label: str, folder: Path, own: Sequence[str]) -> dict[str, Any]:
    read = read_given_options(given, label, own, SWEEP)
    found = {n: read_option(n, value, f"'{n}' of {label}", folder) for n, value in read.items()}
    if wrong := [n for n in found if n not in list_options(SWEEP)]:
        raise CommandError(f"identifications do not support the option {wrong[0]}; remove it from {label}.")
    return found
