"""The result of a tuning."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from .data import TuneData
from .pictures import draw_picture
from .score import Score

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class TuneResult(TuneData):
    """First and best gains of a tuning, and everything it tried.

    Attributes:
        name: name of the tuning.
        objective: expression that was minimized.
        start: first gains.
        best: best gains.
        history: polars data frame with a row for each set of gains: `evaluation`, `generation`, the gains by
            name, `objective`, `violation` (0 if all conditions hold), `lost` (failed runs) and `best`
            (smallest objective so far with all conditions met).
        units: units of the gains by name.
        seeds: seeds of `training` and `validation`.
        tolerance: relative increase of the objective that is allowed on the validation seeds.
        complete: whether the tuning ended by itself.
        runs: number of runs.
        wall_s: wall time in s.
        folder: output folder; None without one.
        notes: notes to read before the gains, without full stops.
        remarks: what half the step changes, and what was not judged.
    """

    @property
    def set(self) -> dict[str, Any]:
        """Start values of the best gains, for `Simulation.run(set=...)`."""
        return dict(self.best.set)

    def problem(self) -> str | None:
        """Return why the best gains miss the requirements; None if they meet them."""
        return describe_problem(self)

    def plot(self) -> "Figure":
        """Draw the course of the search, and the first and the best gains on both kinds of seeds."""
        return draw_picture(self)


def describe_problem(result: TuneResult) -> str | None:
    """Return the text of `TuneResult.problem`."""
    best = result.best
    if not best.training.holds:
        return f"no gains meet the requirements; the nearest: {'; '.join(_describe_score(best.training))}."
    if best.validation is None:
        return None
    if not best.validation.holds:
        why = "; ".join(_describe_score(best.validation))
        return f"the best gains do not meet the requirements on the seeds of the validation: {why}."
    if result.tolerance is not None and not best.ratio <= 1.0 + result.tolerance:
        return (
            f"the objective is {best.ratio:.3g} times as large on the seeds of the validation; at most "
            f"{1.0 + result.tolerance:g} times is allowed."
        )
    return None


def _describe_score(score: Score) -> list[str]:
    return score.list_unmet() or [f"{score.lost} of {score.runs} runs are lost"]
