"""Evaluate sets of gains: every case with every seed, also with half the step."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from ...run.half_step import HalfStep
from ..frame.session import Job, Runs
from ..variants.factors import merge_options
from ..variants.measures import VariantOutcome
from .preparation import TuningTask
from .result import Tuned
from .score import Objective, Score

LARGEST_CHANGE = 0.01
"""Relative change of the objective by half the step above which it is reported.

Gains are usually searched to about a percent, and a smaller change seldom decides between two of them.
"""


@dataclass(frozen=True)
class HalvedScore:
    """The score of gains with half the step.

    Attributes:
        score: The score over the cases that can be judged; None if the objective cannot.
        half_step: How these runs were made; None without a run.
        reasons: Why cases were not judged, by case.
    """

    score: Score | None
    half_step: HalfStep | None
    reasons: Mapping[str, str]


@dataclass(frozen=True)
class Evaluation:
    """Evaluates gains; margins of loops are measured for gains that meet all other conditions."""

    runs: Runs
    task: TuningTask

    def score(
        self, candidates: Sequence[Mapping[str, Any]], seeds: Sequence[int | None]
    ) -> list[Score] | None:
        """Return the score of each candidate on these seeds; None after an interrupt.

        Args:
            candidates: The options of each set of gains.
            seeds: Seeds of the random sequences; None keeps those of the scenario.

        Raises:
            RunError: The cluster is lost.
        """
        outcomes = self._run(candidates, seeds)
        if outcomes is None:
            return None
        scores = list[Score]()
        for gains, by_case in zip(candidates, outcomes, strict=True):
            # margins need further runs: not for gains that are out already
            if any(self.task.loops) and self.task.objective.meets_conditions_on_known_figures(by_case):
                if self.runs.interrupted():
                    return None
                by_case = self._add_margins(gains.get("set", {}), by_case)
            scores.append(self.task.objective.score(by_case))
        return scores

    def score_with_half_step(
        self, gains: Mapping[str, Any], seeds: Sequence[int | None]
    ) -> HalvedScore | None:
        """Return the score of gains with half the step, without margins of loops; None after an interrupt.

        Args:
            gains: The options of the gains.
            seeds: As for `score`.

        Raises:
            RunError: The cluster is lost.
        """
        # margins of loops would need further runs
        outcomes = self._run([gains], seeds, is_halved=True)
        return None if outcomes is None else _score_halved(self.task.objective, outcomes[0])

    def _run(
        self, candidates: Sequence[Mapping[str, Any]], seeds: Sequence[int | None], is_halved: bool = False
    ) -> list[list[list[VariantOutcome]]] | None:
        """Return the outcomes of each candidate by case and seed; None after an interrupt."""
        factor = self.task.seeds
        jobs = [
            Job(
                merge_options([gains, {} if factor is None else factor.options(seed), case]),
                is_halved=is_halved,
            )
            for gains, case, seed in itertools.product(candidates, self.task.cases, seeds)
        ]
        outcomes = self.runs.run(jobs, self.task.measures)
        if not outcomes.complete:
            return None
        ordered = (outcomes.by_job[position] for position in range(len(jobs)))
        return [[[next(ordered) for _ in seeds] for _ in self.task.cases] for _ in candidates]

    def _add_margins(
        self, gains: Mapping[str, Any], outcomes: Sequence[Sequence[VariantOutcome]]
    ) -> list[list[VariantOutcome]]:
        """Return the outcomes of all cases with the margins of their loops, the same for each seed."""
        extended = list[list[VariantOutcome]]()
        for loops, by_seed in zip(self.task.loops, outcomes, strict=True):
            margins = {} if loops is None else loops.measure(gains)
            extended.append([replace(outcome, figures={**outcome.figures, **margins}) for outcome in by_seed])
        return extended


def _score_halved(objective: Objective, outcomes: Sequence[Sequence[VariantOutcome]]) -> HalvedScore:
    """Return the score of runs with half the step, without conditions on figures that they do not have."""
    reasons = dict[str, str]()
    for case, by_seed in zip(objective.cases, outcomes, strict=True):
        if (failure := next((outcome for outcome in by_seed if not outcome.complete), None)) is not None:
            reasons[case.name] = (failure.problem or failure.status).splitlines()[0].rstrip(".")
    complete = [i for i, case in enumerate(objective.cases) if case.name not in reasons]
    half = next((o.half_step for by_seed in outcomes for o in by_seed if o.half_step is not None), None)
    # an objective without one of its cases does not compare with the one before
    if half is None or any(case.weight and case.name in reasons for case in objective.cases):
        return HalvedScore(None, half, reasons)
    smaller = replace(
        objective,
        cases=[objective.cases[i] for i in complete],
        required=[[r for r in objective.required[i] if r.figure in outcomes[i][0].figures] for i in complete],
    )
    return HalvedScore(smaller.score([outcomes[i] for i in complete]), half, reasons)


def describe_step(start: Tuned, best: Tuned, halved: HalvedScore) -> list[str]:
    """Return remarks on what half the step changes in the score of the best gains."""
    remarks = [f"The step is not judged in the case '{case}': {why}." for case, why in halved.reasons.items()]
    score, half = halved.score, halved.half_step
    if score is None or half is None:
        return remarks
    before, change = best.training.objective, score.objective - best.training.objective
    gained = 0.0 if start.training.violation else start.training.objective - before
    relative = abs(change / before) if before else 0.0
    # what the step changes as much as the tuning may be no gain at all
    if 0.0 < gained <= abs(change):
        remarks.append(
            f"The step, not the gains, made the difference: half the step changes the objective by "
            f"{change:+.3g}, and the tuning by {-gained:+.3g}; {half.suggest(abs(change) / gained)}."
        )
    elif relative > LARGEST_CHANGE:
        remarks.append(
            f"Half the step changes the objective by {100.0 * change / abs(before):+.2g} %; "
            f"{half.suggest(relative / LARGEST_CHANGE)}."
        )
    if unmet := score.list_unmet(best.training):
        remarks.append(f"With half the step, conditions do not hold: {'; '.join(unmet)}.")
    return remarks
