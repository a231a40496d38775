"""How much of an objective the communication step makes: the best gains with half the step."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from ...run.half_step import HalfStep
from ..variants.data import VariantOutcome
from .data import Tuned
from .score import Objective, Score, format_figure

LARGEST_CHANGE = 0.01
"""Relative change of the objective above which it is reported.

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
    reasons: dict[str, str]


def score_halved(objective: Objective, outcomes: Sequence[Sequence[VariantOutcome]]) -> HalvedScore:
    """Return the score of runs with half the step, without conditions on figures that they do not have.

    Args:
        objective: The objective and the conditions.
        outcomes: The outcomes of the runs: for each case a list over seeds.
    """
    reasons = dict[str, str]()
    kept = list[int]()
    for i, (case, ours) in enumerate(zip(objective.cases, outcomes, strict=True)):
        lost = next((o for o in ours if not o.complete), None)
        if lost is None:
            kept.append(i)
        else:
            reasons[case.name] = (lost.problem or lost.status).splitlines()[0].rstrip(".")
    half = next((o.half_step for ours in outcomes for o in ours if o.half_step is not None), None)
    if half is None or any(c.weight and c.name in reasons for c in objective.cases):
        return HalvedScore(None, half, reasons)
    judged = replace(
        objective,
        cases=[objective.cases[i] for i in kept],
        required=[[r for r in objective.required[i] if r.figure in outcomes[i][0].figures] for i in kept],
    )
    return HalvedScore(judged.score([outcomes[i] for i in kept]), half, reasons)


def describe_step(start: Tuned, best: Tuned, halved: HalvedScore) -> list[str]:
    """Return remarks on what half the step changes in the score of the best gains."""
    remarks = [f"The step is not judged in the case '{case}': {why}." for case, why in halved.reasons.items()]
    score, half = halved.score, halved.half_step
    if score is None or half is None:
        return remarks
    before, change = best.training.objective, score.objective - best.training.objective
    gained = 0.0 if start.training.violation else start.training.objective - before
    relative = abs(change / before) if before else 0.0
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
    unmet = [
        f"{case}: {condition}, but it is {format_figure(worst['figure'])}"
        for case, conditions in score.worst.items()
        for condition, worst in conditions.items()
        if best.training.worst[case][condition]["met"] and not worst["met"]
    ]
    if unmet:
        remarks.append(f"With half the step, conditions do not hold: {'; '.join(unmet)}.")
    return remarks
