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
from ..variants.data import VariantOutcome
from ..variants.distributions import parse_distribution
from ..variants.factors import Factor, resolve_factors
from ..variants.kinds import Distribution, ValueList
from ..variants.measures import Measures
from ..variants.sampling import sample
from ..variants.targets import ACTUATOR, OPTION, Target, changed_in_run, merge_options
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

    @classmethod
    def of(cls, vary: Mapping[str, Any], runs: int | None, seed: int) -> "Variation | None":
        """Return the variation; None if nothing varies. Raise CommandError for runs without anything."""
        if not vary and runs is not None:
            raise CommandError("runs are drawn from tolerances; add 'vary' (--vary NAME=LOW:HIGH).")
        return cls(vary, runs, seed) if vary else None

    def draw(self, scenario: Scenario, progress: Progress) -> "Drawn":
        """Prepare a scenario and return the draws.

        Raises:
            CommandError: A name or a value does not fit, or there are too many combinations.
            RunError: An FMU cannot be built.
        """
        preparation = Preparation.of(scenario, progress)
        inner = {name: given for name, given in self.vary.items() if name != AMBIENT}
        factors = resolve_factors(inner, preparation.system, preparation.interfaces, _WHERE)
        for target in (target for factor in factors for target in factor.targets):
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
            columns = sample("grid", self._corners(distributions), None, 0)
        else:
            columns = sample("random", distributions, self.runs, self.seed)
        values = [map(factor.value, column) for factor, column in zip(factors, columns, strict=True)]
        return Drawn(self, preparation, factors, list(zip(*values, strict=True)))

    @staticmethod
    def _corners(distributions: Sequence[Distribution]) -> list[Distribution]:
        """Return for each distribution a list of its ends; all values of a list of values."""
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


def _read_ambient(given: Any) -> Distribution:
    """Read the range of the ambient temperature, in K or with units."""
    label = f"'{AMBIENT}' of {_WHERE}"

    with_units = list[str]()

    def convert(text: str) -> float:
        with_units.append(text)
        return read_quantity(text, label, "K", readings=("degC", "degF", "K"))

    distribution = parse_distribution(given, label, convert)
    if distribution.relative or (isinstance(given, str) and not with_units):
        raise CommandError(
            f"{label} is '{given}'; write temperatures with their unit, such as 20degC:45degC."
        )
    if min(map(float, distribution.ends)) <= 0.0:
        raise CommandError(f"{label} is '{given}'; temperatures must be above 0 K.")
    return distribution


@dataclass(frozen=True)
class Drawn:
    """The draws of a prepared scenario: factors, and their values by draw."""

    variation: Variation
    preparation: Preparation
    factors: Sequence[Factor]
    rows: Sequence[Sequence[Value]]


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

    def reading(self, names: Sequence[str]) -> Sequence[str]:
        """Return the signals to record: those of the joints."""
        return [name for name in names if name in self.read]

    def of(self, result: Result) -> dict[str, Any]:
        """Return the sizings by joint; the load that is too large if the run failed."""
        examination = self.examinations[result.name]
        if result.end_s < examination.stop - 1e-9:
            return {_PROBLEM: describe_overload(result)}
        sizings = examination.size(result)
        return {joint: (one.reason, one.limits, one.figures, one.winding) for joint, one in sizings.items()}


class _Jobs:
    """Different runs of prepared scenarios, and what to examine in them."""

    def __init__(self) -> None:
        self.preparations = list[Preparation]()
        self.examinations = dict[str, Examination]()
        self.signals = set[str]()
        self.jobs = dict[str, Job]()
        self._groups = dict[str, int | CommandError]()

    def add(self, run: SizedRun, drawn: Drawn, options: Mapping[str, Any]) -> str | CommandError:
        """Add a run with further options; return its key, or why the scenario cannot have them."""
        in_run = changed_in_run(options)
        made = {name: value for name, value in options.items() if name not in in_run}
        key = _to_key(id(run), made)
        if key not in self._groups:
            preparation, examination = drawn.preparation, run.examination
            try:
                if made:
                    scenario, examination = run.change(made)
                    preparation = Preparation.of(scenario)
            except CommandError as error:
                self._groups[key] = error
            else:
                self._groups[key] = len(self.preparations)
                name = f"{run.name}, {len(self.preparations)}"  # tells the measures what to examine
                self.preparations.append(replace(preparation, name=name))
                self.examinations[name] = examination
                self.signals.update(run.signals)
        group = self._groups[key]
        if isinstance(group, CommandError):
            return group
        job = Job(in_run, group)
        self.jobs[key := _to_key(group, in_run)] = job
        return key

    def examination(self, key: str) -> Examination:
        """Return what was examined in a run."""
        return self.examinations[self.preparations[self.jobs[key].group].name]

    def run(self, session: Session[SizeResult]) -> dict[str, VariantOutcome]:
        """Run all jobs. Raises RunError if the user interrupts."""
        if not self.jobs:
            return {}
        measures = SizingMeasures(read=sorted(self.signals), examinations=self.examinations)
        session.progress.begin("tolerances", len(self.jobs), "runs")
        with session.open_runs(self.preparations) as runs:
            outcomes = runs.run(
                list(self.jobs.values()),
                measures,
                lambda chunk: session.progress.advance(len(chunk.outcomes)),
            )
        if not outcomes.complete:
            raise RunError(f"interrupted after {len(outcomes.by_job)} of {len(self.jobs)} runs.")
        return {key: outcomes.by_job[position] for position, key in enumerate(self.jobs)}


def _to_key(group: int, options: Mapping[str, Any]) -> str:
    return json.dumps((group, options), sort_keys=True, default=str)


def run_draws(session: Session[SizeResult], sized: Mapping[Any, SizedRun]) -> dict[Any, SizedRun]:
    """Run all draws of runs, and return the runs with what became of each joint.

    Raises:
        CommandError: No draw can be loaded, because of an entry of a data sheet.
        RunError: The workers are lost, or the user interrupts.
    """
    jobs = _Jobs()
    keys = {name: _add_draws(jobs, run, run.drawn) for name, run in sized.items() if run.drawn is not None}
    outcomes = jobs.run(session)

    def judge(joint: str, values: Mapping[str, Value], key: str | CommandError) -> Draw:
        if isinstance(key, CommandError):
            return Draw(values, (), str(key))
        return _judge(joint, values, outcomes[key], jobs.examination(key))

    def complete(run: SizedRun, drawn: Drawn, draws: Sequence[tuple[Any, Any]]) -> SizedRun:
        units, variation = {factor.name: factor.unit for factor in drawn.factors}, drawn.variation
        joints = dict[str, JointSizing]()
        for joint, sizing in run.joints.items():
            found = [judge(joint, *draw) for draw in draws]
            study = Tolerances(units, variation.runs is not None, variation.seed, found)
            joints[joint] = replace(sizing, tolerances=study)
        return replace(run, joints=joints)

    return {
        name: run if run.drawn is None else complete(run, run.drawn, keys[name])
        for name, run in sized.items()
    }


def _add_draws(jobs: _Jobs, run: SizedRun, drawn: Drawn) -> list[tuple[dict[str, Value], str | CommandError]]:
    """Add the draws of a run; return the values of each with its key, or why it cannot be loaded."""
    draws = list[tuple[dict[str, Value], str | CommandError]]()
    for row in drawn.rows:
        values = {factor.name: value for factor, value in zip(drawn.factors, row, strict=True)}
        options = merge_options(f.options(values[f.name]) for f in drawn.factors if f.name != AMBIENT)
        draws.append((values, jobs.add(run, drawn, options)))
    errors = [key for _, key in draws if isinstance(key, CommandError)]
    if len(errors) == len(draws):
        raise errors[0]  # such as an entry that does not exist
    return draws


def _judge(
    joint: str, values: Mapping[str, Value], outcome: VariantOutcome, examination: Examination
) -> Draw:
    """Return what became of a joint in a draw."""
    if not outcome.complete or joint not in outcome.figures:
        return Draw(values, (), outcome.figures.get(_PROBLEM) or outcome.problem or "the run failed")
    limits: list[Utilisation]
    reason, limits, figures, winding = outcome.figures[joint]
    if AMBIENT in values:
        ambient, entries = float(values[AMBIENT]), examination.tasks[joint].sheet.values
        heat = [x for x in examine_heat(entries, figures, ambient, winding) if isinstance(x, Utilisation)]
        by_name = {one.name: one for one in heat}
        limits = [by_name.get(one.name, one) for one in limits]
    return Draw(values, limits, reason)
