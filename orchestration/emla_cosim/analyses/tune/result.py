"""The result of a tuning."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import polars

from ...system.model import Value
from ..frame.confidence import describe_share
from ..frame.report import ReportedResult
from .score import Score

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Tuned:
    """A set of gains, with its score on the training and the validation seeds.

    Attributes:
        values: values that vary, by name; None for one that is not a number in the scenario.
        set: start values for `Simulation.run(set=...)`, by full name.
        training: score on the training seeds.
        validation: score on the validation seeds; None if these were not run.
        half_step: score on the training seeds with half the step, over the cases that were judged; None if
            the objective was not judged.
    """

    values: Mapping[str, Value | None]
    set: Mapping[str, Value]
    training: Score
    validation: Score | None = None
    half_step: Score | None = None

    @property
    def ratio(self) -> float:
        """Objective on the validation seeds divided by that on the training seeds, or NaN."""
        # an objective of 0 has no relative change
        if self.validation is None or not self.training.objective:
            return float("nan")
        return self.validation.objective / self.training.objective


@dataclass(frozen=True, repr=False)
class TuneResult(ReportedResult):
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
        plan: the plan as plain data.
        system: what determines the result of a run, as plain data.
        scenario: content of a scenario file, to which the gains are added; None for a scenario that exists
            only in Python.
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
    remarks: Sequence[str] = ()
    plan: Mapping[str, Any] = field(default_factory=dict)
    system: Mapping[str, Any] = field(default_factory=dict)
    scenario: Mapping[str, Any] | None = field(default=None)

    @property
    def set(self) -> dict[str, Any]:
        """Start values of the best gains, for `Simulation.run(set=...)`."""
        return dict(self.best.set)

    def problem(self) -> str | None:
        """Return why the best gains miss the requirements; None if they meet them."""
        best = self.best
        if not best.training.holds:
            return f"no gains meet the requirements; the nearest: {_describe_unmet(best.training)}."
        if best.validation is None:
            return None
        if not best.validation.holds:
            why = _describe_unmet(best.validation)
            return f"the best gains do not meet the requirements on the seeds of the validation: {why}."
        if self.tolerance is not None and not best.ratio <= 1.0 + self.tolerance:
            return (
                f"the objective is {best.ratio:.3g} times as large on the seeds of the validation; at most "
                f"{1.0 + self.tolerance:g} times is allowed."
            )
        return None

    @property
    def statement(self) -> str | None:
        """How probably other seeds meet all conditions; None without validation."""
        score = self.best.validation
        if score is None or not any(score.worst.values()):
            return None
        share = describe_share(
            score.met, len(self.seeds["validation"]), "validation seeds meet all conditions"
        )
        return f"{share[0].upper()}{share[1:]}."

    def plot(self) -> "Figure":
        """Draw the course of the search, and the first and the best gains on both kinds of seeds."""
        from .report import draw_picture  # loads what only reports need

        return draw_picture(self)

    @property
    def record(self) -> dict[str, Any]:
        """Content of `tune.json`: everything that determines the result, and the result."""
        return {
            "name": self.name,
            "status": "completed" if self.complete else "unfinished",
            "problem": self.problem(),
            "statement": self.statement,
            "notes": list(self.notes),
            "remarks": list(self.remarks),
            "plan": self.plan,
            "seeds": self.seeds,
            "start": {**asdict(self.start), "ratio": self.start.ratio},
            "best": {**asdict(self.best), "ratio": self.best.ratio},
            "units": self.units,
            "runs": self.runs,
            "wall_s": self.wall_s,
            "system": self.system,
            "version": version("emla-cosim"),
        }


def _describe_unmet(score: Score) -> str:
    return "; ".join(score.list_unmet()) or f"{score.lost} of {score.runs} runs are lost"
