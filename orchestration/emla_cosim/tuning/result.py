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
    """The gains at the start of a tuning, the best ones found, and all that were tried.

    Attributes:
        history: A row for each tried set of gains: `evaluation` (its number), `generation`, the gains by
            name, `objective`, `violation` (0 if all conditions hold), `lost` (number of runs) and `best`
            (the smallest objective so far for which all conditions hold).
        seeds: The seeds of `training` and `validation`.
        complete: Whether the tuning ended without an interrupt.
        folder: The output folder; None if no files were written.
        notes: Remarks on the gains, without full stops.
    """

    @property
    def set(self) -> dict[str, Any]:
        """The start values that set the best gains in a run."""
        return dict(self.best.set)

    def problem(self) -> str | None:
        """Why the best gains miss the requirements; None if they meet them."""
        return describe_problem(self)

    def plot(self) -> "Figure":
        """Draw the course of the search, and the gains of start and end on both sets of seeds."""
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
