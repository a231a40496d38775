"""What came out of a tuning."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from .data import TuneData
from .pictures import draw_picture
from .score import Score

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class TuneResult(TuneData):
    """The gains that a tuning began with, the best it found, and everything it tried.

    `history` has a row for each set of gains that was tried: `evaluation` (its number), `generation`,
    the gains by name, `objective`, `violation` (0 where all conditions hold), `lost` (runs) and `best`
    (the least objective so far of those whose conditions hold). `seeds` are those of `training` and
    `validation`. `complete` says whether nobody ended it early; `folder` is None where it left no files.
    `notes` are sentences, without their stops, to read before the gains.
    """

    @property
    def set(self) -> dict[str, Any]:
        """The start values that bring the best gains to a run."""
        return dict(self.best.set)

    def problem(self) -> str | None:
        """A sentence that says why the best gains are not as wanted; None where they are."""
        return describe_problem(self)

    def plot(self) -> "Figure":
        """How the search went, and the gains of start and end on the seeds of training and validation."""
        return draw_picture(self)


def describe_problem(result: TuneResult) -> str | None:
    """See `TuneResult.problem`."""
    best = result.best
    if not best.training.holds:
        return (
            f"no gains were found that are as required; nearest: {'; '.join(_describe_score(best.training))}."
        )
    if best.validation is None:
        return None
    if not best.validation.holds:
        why = "; ".join(_describe_score(best.validation))
        return f"the best gains are not as required on the seeds of the validation: {why}."
    if result.tolerance is not None and not best.ratio <= 1.0 + result.tolerance:
        return (
            f"the objective is {best.ratio:.3g} times as large on the seeds of the validation; "
            f"{1.0 + result.tolerance:g} is allowed."
        )
    return None


def _describe_score(score: Score) -> list[str]:
    return score.list_unmet() or [f"{score.lost} of {score.runs} runs are lost"]
