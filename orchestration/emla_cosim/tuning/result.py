"""What came out of a tuning."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import polars

from ..system.model import Value
from .score import Score

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Tuned:
    """A set of gains, and what it is worth on the seeds of training and of validation.

    `values` are those that vary, by name, None for one that is no number in the scenario; `set` are the
    start values that `Simulation.run(set=...)` takes. `validation` is None where it was not come to.
    """

    values: Mapping[str, Value | None]
    set: Mapping[str, Value]
    training: Score
    validation: Score | None = None

    @property
    def ratio(self) -> float:
        """The objective of the validation by that of the training; NaN where there is none."""
        if self.validation is None or not self.training.objective:
            return float("nan")
        return self.validation.objective / self.training.objective


@dataclass(frozen=True)
class TuneResult:
    """The gains that a tuning began with, the best it found, and everything it tried.

    `history` has a row for each set of gains that was tried: `evaluation` (its number), `generation`,
    the gains by name, `objective`, `violation` (0 where all conditions hold), `lost` (runs) and `best`
    (the least objective so far of those whose conditions hold). `seeds` are those of `training` and
    `validation`. `complete` says whether nobody ended it early; `folder` is None where it left no files.
    `notes` are sentences, without their stops, to read before the gains.
    """

    name: str
    objective: str
    start: Tuned
    best: Tuned
    history: polars.DataFrame
    units: Mapping[str, str] = field(default_factory=dict)
    seeds: Mapping[str, Sequence[int]] = field(default_factory=dict)
    tolerance: float | None = None
    complete: bool = True
    runs: int = 0
    wall_s: float = 0.0
    folder: Path | None = None
    notes: Sequence[str] = ()

    @property
    def set(self) -> dict[str, Any]:
        """The start values that bring the best gains to a run."""
        return dict(self.best.set)

    def problem(self) -> str | None:
        """A sentence that says why the best gains are not as wanted; None where they are."""
        return problem(self)

    def plot(self) -> "Figure":
        """How the search went, and the gains of start and end on the seeds of training and validation."""
        from .picture import drawn

        return drawn(self)


def problem(result: TuneResult) -> str | None:
    """See `TuneResult.problem`."""
    best = result.best
    if not best.training.holds:
        return f"no gains were found that are as required; nearest: {'; '.join(_why(best.training))}."
    if best.validation is None:
        return None
    if not best.validation.holds:
        why = "; ".join(_why(best.validation))
        return f"the best gains are not as required on the seeds of the validation: {why}."
    if result.tolerance is not None and not best.ratio <= 1.0 + result.tolerance:
        return (
            f"the objective is {best.ratio:.3g} times as large on the seeds of the validation; "
            f"{1.0 + result.tolerance:g} is allowed."
        )
    return None


def _why(score: Score) -> list[str]:
    return score.unmet() or [f"{score.lost} of {score.runs} runs are lost"]
