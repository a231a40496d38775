"""Run a sizing with values at the ends of their tolerances, or drawn from them."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from ...base.errors import CommandError, RunError
from ...base.progress import Progress
from ...base.quantities import read_quantity
from ...run.result import Result
from ...run.scenarios.scenario import Scenario
from ...system.model import Value
from ..execution.worker_payload import Preparation
from ..frame.session import Job, Session
from ..variants.distributions import parse_distribution
from ..variants.factors import (
    ACTUATOR,
    OPTION,
    Factor,
    Target,
    merge_options,
    resolve_factors,
    select_run_options,
)
from ..variants.kinds import Distribution, ValueList
from ..variants.measures import Measures, VariantOutcome
from ..variants.sampling import sample
from .joints import Examination, describe_overload
from .limits import Utilisation, examine_heat
from .result import JointSizing, SizeResult
from .tolerances import AMBIENT, Draw, Tolerances

MOST_CORNERS = 64
"""Most combinations of ends."""

_WHERE = "the tolerances"
_PROBLEM = ""
"""Key of the reason why a run has no joints."""


@dataclass(frozen=True)
class Variation:
    """What varies: distributions by name, the number of random draws (None for the ends), and their seed."""

    vary: Mapping[str, Any]
    runs: int | None
    seed: int

    def draw(self, scenario: Scenario, progress: Progress) -> "Drawn":
        """Prepare a scenario and return the draws.

        Raises:
            CommandError: A name or a value does not fit, or there are too many combinations.
            RunError: An FMU cannot be built.
        """
        preparation = Preparation.of(scenario, progress)
        varied = {name: entry for name, entry in self.vary.items() if name != AMBIENT}
        factors = resolve_factors(varied, preparation.system, preparation.interfaces, _WHERE)
        for target in (target for factor in factors for target in factor.targets):
            # these change what is sized, not the values of one machine
            if target.kind in (OPTION, ACTUATOR) or target.name.endswith(".reference.period"):
                raise CommandError(
                    f"{target.name} is not a tolerance; vary start values, entries of data sheets, or "
                    f"{AMBIENT}. Several actuators are candidates, and the cycle is the same in all draws.",
                    name=target.name,
                )
        if AMBIENT in self.vary:
            factors.append(Factor(AMBIENT, [Target(AMBIENT)], _read_ambient(self.vary[AMBIENT]), "K"))
        distributions = [factor.distribution for factor in factors]
        if self.runs is None:
            distributions = _list_ends(distributions)
        columns = sample("grid" if self.runs is None else "random", distributions, self.runs, self.seed)
        draws = list[tuple[Mapping[str, Value], Mapping[str, Any]]]()
        for row in zip(*columns, strict=True):
            values = {factor.name: factor.value(x) for factor, x in zip(factors, row, strict=True)}
            options = merge_options(f.options(values[f.name]) for f in factors if f.name != AMBIENT)
            draws.append(({name: value for name, value in values.items() if value is not None}, options))
        units = {factor.name: factor.unit for factor in factors}
        return Drawn(preparation, draws, Tolerances(units, self.runs is not None, self.seed, ()))


def _list_ends(distributions: Sequence[Distribution]) -> list[Distribution]:
    """Return for each distribution a list of its ends; all values of a list of values.

    Raises:
        CommandError: There are more than `MOST_CORNERS` combinations.
    """
    lists = [
        d if isinstance(d, ValueList) else ValueList(list(dict.fromkeys(d.ends)), relative=d.relative)
        for d in distributions
    ]
    if (count := math.prod(len(values.values) for values in lists)) > MOST_CORNERS:
        raise CommandError(
            f"{_WHERE} have {count} combinations of their ends; the most are {MOST_CORNERS}. Set runs "
            "(--runs) for random draws, or vary less."
        )
    return [*lists]


def _read_ambient(entry: Any) -> Distribution:
    """Read the range of the ambient temperature, in K or with units."""
    label, with_units = f"'{AMBIENT}' of {_WHERE}", list[str]()

    def convert(text: str) -> float:
        with_units.append(text)
        return read_quantity(text, label, "K", readings=("degC", "degF", "K"))

    distribution = parse_distribution(entry, label, convert)
    if distribution.relative or (isinstance(entry, str) and not with_units):
        raise CommandError(
            f"{label} is '{entry}'; write temperatures with their unit, such as 20degC:45degC."
        )
    if min(map(float, distribution.ends)) <= 0.0:
        raise CommandError(f"{label} is '{entry}'; temperatures must be above 0 K.")
    return distribution


@dataclass(frozen=True)
class Drawn:
    """A prepared scenario, its draws with values by name and their options, and an empty study of them."""

    preparation: Preparation
    draws: Sequence[tuple[Mapping[str, Value], Mapping[str, Any]]]
    study: Tolerances


@dataclass(frozen=True)
class SizedRun:
    """The joints of a run, and what is needed to repeat it with other values.

    Attributes:
        joints: Sizings by joint.
        name: Name of the scenario.
        examination: What was examined.
        signals: Names of the recorded signals.
        change: Returns the scenario and what to examine with further options, of how the system is made.
        drawn: Its draws; None if nothing varies.
    """

    joints: Mapping[str, JointSizing]
    name: str
    examination: Examination
    signals: Sequence[str]
    change: Callable[[Mapping[str, Any]], tuple[Scenario, Examination]]
    drawn: Drawn | None


@dataclass(frozen=True)
class SizingMeasures(Measures):
    """The sizings of all joints, without their cycles, which would be too large to send.

    Attributes:
        examinations: What to examine, by the name of the prepared scenario.
    """

    examinations: Mapping[str, Examination] = field(default_factory=dict)

    def select_signals(self, names: Sequence[str]) -> Sequence[str]:
        """Return the signals to record: those of the joints."""
        return [name for name in names if name in self.read]

    def of(self, result: Result) -> dict[str, Any]:
        """Return the sizings by joint; the load that is too large if the run failed."""
        examination = self.examinations[result.name]
        if result.end_s < examination.stop - 1e-9:
            return {_PROBLEM: describe_overload(result)}
        sizings = examination.size(result)
        return {joint: (s.reason, s.limits, s.figures, s.winding) for joint, s in sizings.items()}


class _Jobs:
    """Different runs of prepared scenarios, and what to examine in them."""

    def __init__(self) -> None:
        self._preparations = list[Preparation]()
        self._examinations = dict[str, Examination]()
        self._signals = set[str]()
        self._groups = dict[str, int | CommandError]()
        self._jobs = dict[str, Job]()
        self._outcomes = dict[str, VariantOutcome]()

    def add(self, run: SizedRun, base: Preparation, options: Mapping[str, Any]) -> str | CommandError:
        """Add a run with further options; return its key, or why the scenario cannot have them."""
        in_run = select_run_options(options)
        system_options = {name: value for name, value in options.items() if name not in in_run}
        key = _make_key(id(run), system_options)
        if key not in self._groups:
            self._groups[key] = group = len(self._preparations)
            preparation, examination = base, run.examination
            try:
                if system_options:
                    scenario, examination = run.change(system_options)
                    preparation = Preparation.of(scenario)
            except CommandError as error:
                self._groups[key] = error
                return error
            name = f"{run.name}, {group}"  # tells the measures what to examine
            self._preparations.append(replace(preparation, name=name))
            self._examinations[name] = examination
            self._signals.update(run.signals)
        group = self._groups[key]
        if isinstance(group, CommandError):
            return group
        key = _make_key(group, in_run)
        self._jobs[key] = Job(in_run, group)
        return key

    def run(self, session: Session[SizeResult]) -> None:
        """Run all jobs.

        Raises:
            RunError: The workers are lost, or the user interrupts.
        """
        if not self._jobs:
            return
        measures = SizingMeasures(read=sorted(self._signals), examinations=self._examinations)
        jobs, progress = list(self._jobs.values()), session.progress
        progress.begin("tolerances", len(jobs), "runs")
        with session.open_runs(self._preparations) as runs:
            outcomes = runs.run(jobs, measures, lambda chunk: progress.advance(len(chunk.outcomes)))
        if not outcomes.complete:
            raise RunError(f"interrupted after {len(outcomes.by_job)} of {len(jobs)} runs.")
        self._outcomes = {key: outcomes.by_job[position] for position, key in enumerate(self._jobs)}

    def find_draw(self, joint: str, values: Mapping[str, Value], key: str | CommandError) -> Draw:
        """Return the result of a joint in a draw."""
        if isinstance(key, CommandError):
            return Draw(values, (), str(key))
        outcome = self._outcomes[key]
        if not outcome.complete or joint not in outcome.figures:
            return Draw(values, (), outcome.figures.get(_PROBLEM) or outcome.problem or "the run failed")
        limits: list[Utilisation]
        reason, limits, figures, winding = outcome.figures[joint]
        if AMBIENT in values:  # no run depends on it: draws that differ in it alone share one
            name = self._preparations[self._jobs[key].group].name
            entries = self._examinations[name].sheets[joint].values
            heat = examine_heat(entries, figures, float(values[AMBIENT]), winding)
            by_name = {x.name: x for x in heat if isinstance(x, Utilisation)}
            limits = sorted(
                (by_name.get(limit.name, limit) for limit in limits), key=lambda limit: -limit.fraction
            )
        return Draw(values, limits, reason)


def _make_key(group: int, options: Mapping[str, Any]) -> str:
    return json.dumps((group, options), sort_keys=True, default=str)


def run_draws(session: Session[SizeResult], sized: Mapping[Any, SizedRun]) -> dict[Any, SizedRun]:
    """Run all draws of runs, and return the runs with the result of each joint.

    Raises:
        CommandError: No draw can be loaded.
        RunError: The workers are lost, or the user interrupts.
    """
    jobs, results = _Jobs(), dict[Any, SizedRun]()
    tasks = {name: run.drawn for name, run in sized.items() if run.drawn is not None}
    keys = {
        name: [(values, jobs.add(sized[name], task.preparation, options)) for values, options in task.draws]
        for name, task in tasks.items()
    }
    attempts = [(task.study, values, key) for name, task in tasks.items() for values, key in keys[name]]
    if all(isinstance(key, CommandError) for *_, key in attempts):  # such as an entry that does not exist
        for study, values, error in attempts:
            raise CommandError(f"no draw can run; with {study.label(Draw(values, (), None))}: {error}")
    # the draws of all candidates together, so that no worker waits for the last run of one
    jobs.run(session)
    for name, task in tasks.items():
        joints = dict[str, JointSizing]()
        for joint, sizing in sized[name].joints.items():
            draws = [jobs.find_draw(joint, values, key) for values, key in keys[name]]
            joints[joint] = replace(sizing, tolerances=replace(task.study, draws=draws))
        results[name] = replace(sized[name], joints=joints)
    return results
